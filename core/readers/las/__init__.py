"""LAS, LAZ and COPC files from any software, read without trusting their headers."""
