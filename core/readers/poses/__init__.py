"""External trajectories: CSV and SBET."""
