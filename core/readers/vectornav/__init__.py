"""Readers of VectorNav IMUs: binary messages and ASCII sentences."""
