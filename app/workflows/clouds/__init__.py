"""Clouds of any origin: cleaning, checks, colours, features, surfaces."""
