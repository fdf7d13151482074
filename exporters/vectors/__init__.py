"""GeoPackages and tables: trajectory, worked ground, fields of task data."""
