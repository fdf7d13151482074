"""Writing files whole or not at all, staging of result folders, JSON, provenance."""
