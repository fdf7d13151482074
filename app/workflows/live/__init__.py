"""A session while it is recorded."""
