"""The example notebooks that are bundled with furrowmap."""

from importlib.resources import files
from pathlib import Path

from furrowmap.exporters.files.atomic import refuse_existing


def write_notebooks(folder: Path) -> list[Path]:
    """Write the notebooks into a folder; their paths. RefusedError if one of them is there."""
    bundled = files("furrowmap").joinpath("notebooks")
    sources = {folder / source.name: source for source in bundled.iterdir() if source.name.endswith(".ipynb")}
    for path in sources:
        refuse_existing(path, overwrite=False)
    folder.mkdir(parents=True, exist_ok=True)
    for path, source in sources.items():
        path.write_bytes(source.read_bytes())
    return sorted(sources)
