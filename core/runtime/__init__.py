"""How the program runs: errors and notices, languages, progress, threads, background work, scratch files, limits."""
