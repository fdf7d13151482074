"""Results for other programs and people."""
