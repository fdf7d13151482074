"""Files beside the recordings of a flight: the table of its images, the parcels of a trial and their treatments."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from furrowmap.core.readers.areas.polygons import IDS, open_polygons
from furrowmap.core.readers.image_pixels import image_size
from furrowmap.core.readers.image_table import is_image_table, read_image_table
from furrowmap.core.readers.text_table import read_table
from furrowmap.core.runtime.errors import FurrowmapError, InputError, Notice
from furrowmap.core.runtime.file_names import resolved
from furrowmap.core.runtime.languages.texts import Words

_TABLES: Final = (".csv", ".xlsx", ".xls", ".ods")
_MOST_TABLE_BYTES: Final = 2_000_000
"""Larger tables are no treatments."""
_VECTORS: Final = (".geojson", ".json", ".gpkg", ".fgb", ".kml", ".shp")


@dataclass(frozen=True)
class ImageTable:
    """A table of images: how many of them are there, and the size of the first in pixels where it can be read."""

    path: Path
    images: int
    size: tuple[int, int] | None


@dataclass(frozen=True)
class ParcelFile:
    """A file with several polygons; `column` has their identifiers."""

    path: Path
    parcels: int
    column: str


@dataclass(frozen=True)
class TrialFiles:
    """The first file of each kind, None where there is none, and the files among which they were looked for."""

    images: ImageTable | None = None
    parcels: ParcelFile | None = None
    treatments: Path | None = None
    notices: tuple[Notice, ...] = ()
    files: tuple[Path, ...] = ()

    @classmethod
    def among(cls, paths: Iterable[Path]) -> "TrialFiles":
        """Those among files; files of other kinds, and those that cannot be read, are passed over."""
        images: ImageTable | None = None
        parcels: ParcelFile | None = None
        treatments: Path | None = None
        notices: list[Notice] = []
        paths = tuple(paths)
        for path in paths:
            if not path.is_file():  # reading a pipe would wait for ever
                continue
            if path.suffix.lower() in _VECTORS:
                if parcels is None:
                    parcels, found = _parcels(path)
                    notices += found
            elif path.suffix.lower() in _TABLES:
                if images is None:
                    images, found = _images(path)
                    notices += found
                if treatments is None:
                    treatments, found = _treatments(path)
                    notices += found
        return cls(images, parcels, treatments, tuple(dict.fromkeys(notices)), paths)

    @property
    def titled(self) -> list[tuple[str, Path]]:
        """The files, each after what it is."""
        found = {
            "table of images": self.images.path if self.images is not None else None,
            "parcels": self.parcels.path if self.parcels is not None else None,
            "treatments of parcels": self.treatments,
        }
        return [(title, path) for title, path in found.items() if path is not None]


NO_TRIAL: Final = TrialFiles()


def _images(path: Path) -> tuple[ImageTable | None, Sequence[Notice]]:
    try:
        if path.suffix.lower() != ".csv" or not is_image_table(path):
            return None, []
        images, notices = read_image_table(path, resolved(path).parent)
    except FurrowmapError:
        return None, []
    files = images.paths
    try:
        return ImageTable(path, len(files), image_size(files[0]) if files else None), notices
    except InputError:  # without Pillow
        return ImageTable(path, len(files), None), notices


def _parcels(path: Path) -> tuple[ParcelFile | None, Sequence[Notice]]:
    try:
        polygons = open_polygons(path, None, partial(_unreadable, path))
    except FurrowmapError:
        return None, []
    rows = polygons.attributes
    columns = {name.casefold(): name for row in reversed(rows) for name in row}
    column = next((columns[name] for name in IDS if name in columns), None)
    if len(rows) < 2 or column is None:
        return None, []
    return ParcelFile(path, len(rows), column), polygons.notices


def _treatments(path: Path) -> tuple[Path | None, Sequence[Notice]]:
    try:
        if path.stat().st_size > _MOST_TABLE_BYTES:
            return None, []
        table = read_table(path, partial(_unreadable, path))
    except FurrowmapError:
        return None, []
    if "treatment" not in table.columns or table.find(IDS) is None:
        return None, []
    return path, table.notices


def _unreadable(path: Path, why: Words) -> InputError:
    return InputError("parcels-unreadable", path=path, why=why, formats="")
