"""The worked ground: passes, areas, overlaps, misses, and the soil moved."""
