"""Scan matching: returns of ground and walls registered to surfaces, as observations of the poses."""
