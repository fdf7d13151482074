"""Septentrio SBF logs: blocks found in a stream of bytes, and one receiver's positions of them."""
