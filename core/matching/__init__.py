"""Scan matching: ground and walls as observations of the poses; the adjustment of a drive and what it calibrates."""
