"""Crops by parcel: parcels on the map, their heights and volumes, and their response to treatments."""
