"""The workflows of furrowmap, a folder each: what the command line, the QGIS worker and notebooks call."""
