"""Strips of a flight: how far they differ, boresight of the scanner, and the adjustment of the strips."""
