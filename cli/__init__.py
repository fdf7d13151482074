"""The command line: one file per verb, and one place where errors become three lines."""
