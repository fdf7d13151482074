"""The workflows of furrowmap, one file each: what the command line, the QGIS worker and notebooks call."""
