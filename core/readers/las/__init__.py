"""LAS, LAZ and COPC files of whoever wrote them, read without trusting their headers."""
