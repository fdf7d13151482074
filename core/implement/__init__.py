"""Detection of the implement in scans: its shape, its height over time and its states."""
