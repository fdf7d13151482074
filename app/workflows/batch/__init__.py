"""A batch: many sessions, each run once."""
