"""The adjustment of a session, and what it calibrates: mounting, yaw, clock offset, range bow, lasers."""
