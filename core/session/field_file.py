"""The boundary of the field among the files beside recordings."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from furrowmap.core.readers.boundary_file import read_fields
from furrowmap.core.readers.ogr_layers import list_layers
from furrowmap.core.runtime.errors import FurrowmapError, Notice, printable
from furrowmap.core.runtime.file_names import resolved
from furrowmap.core.runtime.languages.texts import Text

VECTOR_SUFFIXES: Final = (".geojson", ".json", ".gpkg", ".fgb", ".kml", ".shp")
_BOUNDARY_WORDS: Final = ("boundary", "field", "outline", "境界", "圃場")
"""In names of files, the one first that is taken before others."""
_NEAR_FIELD_M: Final = 200.0
"""A drive is in its field, or on the way to it."""
_METRES_A_DEGREE: Final = 111_195.0
"""On a sphere with the Earth's mean radius."""
_COMPARED: Final = 200
"""Positions of a drive that are compared with a boundary."""


@dataclass(frozen=True)
class FieldFile:
    """The file of the boundary, None for none, and the notices of those that are not used, with their reasons."""

    boundary: Path | None = None
    unused: tuple[Notice, ...] = ()

    @property
    def used(self) -> list[Notice]:
        """What was found, if a boundary was."""
        named = [self.boundary] if self.boundary is not None else []
        return [Notice("recording", name=path.name, title=Text("boundary of the field")) for path in named]

    @classmethod
    def among(
        cls, paths: Iterable[Path], places_deg: NDArray[np.float64], taken: Iterable[Path], *, flies: bool
    ) -> "FieldFile":
        """The boundary among files.

        Args:
            places_deg: (n, 2) longitudes and latitudes of the drive; without any a boundary cannot be elsewhere.
            taken: files that are something else.
            flies: whether it is a flight, which has no use for a boundary.
        """
        others = set(map(resolved, taken))
        files = [path for path in dict.fromkeys(map(Path, paths)) if _is_vector(path) and resolved(path) not in others]
        unused = []
        found: Path | None = None
        for path in sorted(files, key=_rank):
            name = printable(path.name)
            if found is not None:
                unused.append(Notice("recording-unused.other-boundary", file=name, other=printable(found.name)))
                continue
            if _has_layers(path):
                unused.append(Notice("recording-unused.several-layers", file=name))
                continue
            try:
                outlines = [field.outline for field in read_fields(path)[0]]
            except FurrowmapError as error:
                if path.suffix.lower() != ".json":  # of which there are many kinds
                    unused.append(Notice("recording-unused", file=name, what=error.words("what")))
                continue
            if flies:
                unused.append(Notice("recording-unused.boundary-of-flight", file=name))
                continue
            apart_m = _apart_m(outlines, places_deg)
            if apart_m > _NEAR_FIELD_M:
                unused.append(Notice("recording-unused.boundary-elsewhere", file=name, apart_m=apart_m))
                continue
            found = path
        return cls(found, tuple(unused))


NO_FIELD: Final = FieldFile()


def _is_vector(path: Path) -> bool:
    return path.suffix.lower() in VECTOR_SUFFIXES and path.is_file()


def _has_layers(path: Path) -> bool:
    """Whether it is a database of several layers, such as a farm map."""
    if path.suffix.lower() != ".gpkg":
        return False
    try:
        return len(list_layers(path)) > 1
    except Exception:  # noqa: BLE001 the errors of GDAL have no family of their own; reading it says more
        return False


def _rank(path: Path) -> tuple[int, str]:
    """Files named as boundaries first."""
    name = path.name.casefold()
    return next((k for k, word in enumerate(_BOUNDARY_WORDS) if word in name), len(_BOUNDARY_WORDS)), name


def _apart_m(outlines: Sequence[shapely.Geometry], places_deg: NDArray[np.float64]) -> float:
    """Least distance of a drive from fields, on a sphere about the drive."""
    if not len(places_deg):
        return 0.0
    places = places_deg[:: max(1, len(places_deg) // _COMPARED)]
    metres = _METRES_A_DEGREE * np.array([np.cos(np.radians(places[:, 1].mean())), 1.0])
    drive = shapely.multipoints(places * metres)
    fields = shapely.transform(shapely.union_all(np.array(outlines, object)), lambda xy: xy * metres)
    return float(shapely.distance(fields, drive))
