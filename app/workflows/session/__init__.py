"""What precedes a run: recordings, session files and machines."""
