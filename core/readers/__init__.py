"""Readers: one file, one format, one class; content decides which, names only break ties."""
