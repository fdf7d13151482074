"""Surfaces from points: gridding, ground classification, terrain products."""
