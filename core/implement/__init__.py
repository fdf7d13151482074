"""The implement: detection in scans, height, and states."""
