"""Hesai scanners: captures of their packets, and the packets themselves wherever they come from."""
