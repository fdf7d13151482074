"""From an open session to placed points and the ground worked: a run, a run without scans, a preview."""
