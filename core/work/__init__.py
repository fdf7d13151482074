"""The implement and its work: detection in scans, height and states, polygons and figures of the worked ground."""
