"""Trajectories from elsewhere: CSV and SBET."""
