"""From positions, or from external poses, to the vehicle's trajectory in the map frame."""
