"""The session: reading `session.toml`, opening its files, proposing one for recordings, examining files."""
