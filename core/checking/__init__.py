"""Clouds and surfaces against surveyed points: positional accuracy after ASPRS, Edition 2 (2023)."""
