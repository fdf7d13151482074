"""Ouster scanners: metadata of a sensor, and its packets in captures and bags."""
