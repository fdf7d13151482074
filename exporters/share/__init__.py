"""Results for people without a GIS: a web page with map, cloud and figures; and a project for QField."""
