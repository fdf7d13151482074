"""The command line: one module per command. `main` turns errors into messages and exit statuses."""
