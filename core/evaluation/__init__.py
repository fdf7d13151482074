"""Accuracy of a receiver's positions against a reference on the same antenna or vehicle."""
