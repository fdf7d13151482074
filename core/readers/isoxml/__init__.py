"""ISO 11783-10 task data: part fields, time logs with working state and width."""
