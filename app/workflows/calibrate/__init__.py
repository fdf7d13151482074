"""Calibration of mountings and clocks."""
