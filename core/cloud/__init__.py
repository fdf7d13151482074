"""From scans and a trajectory to points in the map frame."""
