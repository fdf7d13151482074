"""Control points: surveyed points that the scanner sees, and that correct the positions of a run."""
