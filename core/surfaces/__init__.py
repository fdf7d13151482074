"""Surfaces from points: gridding, the ground under what stands on it, and what a surface tells."""
