"""Solutions of RTKLIB and its descendants (CLASLIB, MADOCALIB, rtklib-py): ``.pos`` files."""
