"""GNSS positions: evaluation and post-processing."""
