"""`python -m furrowmap.cli`: the command, by an interpreter of one's choice."""

from __future__ import annotations

from furrowmap.cli.main import main

if __name__ == "__main__":
    main()
