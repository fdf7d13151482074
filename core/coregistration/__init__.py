"""Dates of one field: their surfaces coregistered by the ground that no tool touched between them."""
