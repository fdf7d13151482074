"""Worked ground: polygons and figures from a trajectory and the states of the tool."""
