"""Images along a trajectory: projection, and what frames show of points and surfaces."""
