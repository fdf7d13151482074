"""Calibration from the recording itself: mounting, yaw ambiguity, range bow, clock offset, laser constants."""
