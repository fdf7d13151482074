"""Logs of NovAtel and Unicore receivers."""
