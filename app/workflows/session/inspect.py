"""What recordings are and hold."""

from __future__ import annotations

from pathlib import Path

from furrowmap.core.session.examination import Examined


def inspect(path: str | Path) -> Examined:
    """Read a file through.

    Returns:
        What the file is and holds (`inspection`), and a reader opened on it.

    Raises:
        InputError: if no reader knows the file, or it cannot be read.
    """
    return Examined.read(Path(path))
