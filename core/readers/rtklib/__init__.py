"""Solution files (``.pos``) of RTKLIB and its descendants (CLASLIB, MADOCALIB, rtklib-py)."""
