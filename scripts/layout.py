"""Lays the folders of the checkout out as an installation has them, in build/typing/furrowmap, by links.

For what reads the source without importing it: mypy and mkdocstrings.
"""

from __future__ import annotations

import os
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[1]
LAYOUT = CHECKOUT / "build" / "typing" / "furrowmap"


def link(path: Path, target: Path) -> None:
    """Make a link where there is none, or another; one that is right stays, because others may be reading by it."""
    if path.exists() and path.samefile(target):
        return
    if path.is_symlink() or path.is_file():
        path.unlink()
    try:
        path.symlink_to(os.path.relpath(target, path.parent), target_is_directory=target.is_dir())
    except FileExistsError:  # made by another process meanwhile
        return
    except OSError:  # Windows, without the right to make symbolic links
        if target.is_dir():
            import _winapi

            _winapi.CreateJunction(str(target), str(path))
        else:
            os.link(target, path)


def main() -> None:
    """Make the links, and remove those of files that are gone."""
    parts = [CHECKOUT / name for name in ("core", "exporters", "cli", "plugin")]
    parts += [path for path in (CHECKOUT / "app").iterdir() if path.name != "__pycache__"]
    LAYOUT.mkdir(parents=True, exist_ok=True)
    for path in LAYOUT.iterdir():
        if path.name not in {part.name for part in parts}:
            path.unlink() if path.is_symlink() or path.is_file() else path.rmdir()  # a junction
    for part in parts:
        link(LAYOUT / part.name, part)


if __name__ == "__main__":
    main()
