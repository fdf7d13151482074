"""The farm base map: many sessions in one GeoPackage or PostGIS database."""
