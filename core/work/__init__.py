"""The ground that the tool worked: from a trajectory and the tool's states to polygons and figures."""
