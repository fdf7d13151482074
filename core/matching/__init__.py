"""Scan matching: the trajectory that makes the ground agree with itself, held in place by GNSS."""
