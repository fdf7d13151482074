"""The farm map: its sessions, its history and its mosaic."""
