"""Crops on parcels, plots and stands."""
