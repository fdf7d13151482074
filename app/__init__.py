"""Georeferenced point clouds, surfaces and worked ground from a vehicle's LiDAR and GNSS."""
