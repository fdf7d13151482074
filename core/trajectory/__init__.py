"""From positions, or from poses of elsewhere, to the vehicle's trajectory in the map frame."""
