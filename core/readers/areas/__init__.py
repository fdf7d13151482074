"""Polygons of files on the map, and the points in them."""
