"""A run of a session, and the preview of one."""
