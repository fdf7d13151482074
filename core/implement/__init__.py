"""From scans to the state of the tool: what moves up and down in the vehicle's frame, how high it stands, and when."""
