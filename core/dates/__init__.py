"""Dates of one field: their surfaces tied to each other by the ground that no tool touched between them."""
