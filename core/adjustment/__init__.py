"""The adjustment of a session: its input, the schedule of its stages, and the result."""
