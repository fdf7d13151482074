"""Accuracy of clouds and surfaces at surveyed points (ASPRS, Edition 2), and of receivers against a reference."""
