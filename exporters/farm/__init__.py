"""The farm map: many sessions in one GeoPackage or PostGIS database, with mosaics and a QGIS project."""
