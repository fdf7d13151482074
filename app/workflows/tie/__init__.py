"""Dates of one field tied to each other."""
