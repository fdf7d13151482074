"""Exposure times and places that DJI's drones with RTK write beside their images: `*_Timestamp.MRK`.

A line has the number of the image, GPS time of week, `[week]`, the camera's offset from the antenna (mm north, east,
down), the camera's latitude, longitude and ellipsoidal height, their standard deviations (m), and the solution: 50 to
63 fixed, 32 to 49 float, 16 single, 0 none (user manuals of Phantom 4 RTK, Matrice 4, Mavic 3M, section "Image log
file"). The number is in the name of the image, as in `DJI_20260512093005_0017_D.JPG`.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from furrowmap.core.runtime.file_names import found_beside
from furrowmap.core.values.clock import WEEK_S, gps_to_utc_s

MARKS_PATTERN: Final = "*.[Mm][Rr][Kk]"
MAX_MARKS_BYTES: Final = 1 << 25
FIXED_FROM: Final = 50
_IMAGE: Final = re.compile(r".*?_(\d{1,5})(?:_[A-Za-z]\w*)*\.\w+", re.ASCII)
_DECIMAL: Final = r"(-?\d{1,12}(?:\.\d{1,20})?)"
"""Digits are bounded: a damaged line may have any number of them."""
_MARK_LINE: Final = re.compile(
    rf"\s*(\d{{1,9}})\s+{_DECIMAL}\s+\[(\d{{1,6}})\]\s+{_DECIMAL},N\s+{_DECIMAL},E\s+{_DECIMAL},V"
    rf"\s+{_DECIMAL},Lat\s+{_DECIMAL},Lon\s+{_DECIMAL},Ellh(?:\s+{_DECIMAL},\s*{_DECIMAL},\s*{_DECIMAL})?(?:\s+(\d{{1,3}}),Q)?",
    re.ASCII,
)


@dataclass(frozen=True)
class ExposureMark:
    """One exposure.

    Attributes:
        t_s: UTC.
        lon_lat_h: place of the camera; degrees, metres above the ellipsoid; nan where the drone had no position.
        sigma_m: standard deviations of its easting, northing and height; nan where they are not stated.
        is_fixed: whether it is of a fixed solution.
    """

    t_s: float
    lon_lat_h: tuple[float, float, float]
    sigma_m: tuple[float, float, float]
    is_fixed: bool


def marks_beside(paths: Sequence[Path]) -> tuple[dict[Path, ExposureMark], list[Path]]:
    """The marks of images, by the number in their names, from the files of marks in their folders; and unused files.

    A folder with several files of marks has flights that count from 1 each: their images are told by the beginning of
    the names, and images that fit none have no mark.
    """
    found: dict[Path, ExposureMark] = {}
    unused: list[Path] = []
    for folder in dict.fromkeys(path.parent for path in paths):
        tables = {file: read_marks(file) for file in found_beside(folder, MARKS_PATTERN)}
        used: set[Path] = set()
        for path in (path for path in paths if path.parent == folder):
            number = _IMAGE.fullmatch(path.name)
            fitting = [file for file in tables if len(tables) == 1 or _is_of_flight(path, file)]
            if number is not None and len(fitting) == 1 and int(number[1]) in tables[fitting[0]]:
                found[path] = tables[fitting[0]][int(number[1])]
                used.add(fitting[0])
        unused += [file for file in tables if file not in used]
    return found, unused


def _is_of_flight(image: Path, marks: Path) -> bool:
    """Whether the names begin alike, as `100_0004_0001.JPG` and `100_0004_Timestamp.MRK` do."""
    return image.name.startswith(marks.name.rpartition("_")[0] + "_")


def read_marks(path: Path) -> dict[int, ExposureMark]:
    """The exposures of a file by the numbers of their images; lines of another form are left out.

    There are none in a file that cannot be read, or is larger than :data:`MAX_MARKS_BYTES`.
    """
    try:
        with path.open(encoding="ascii", errors="replace") as file:
            text = file.read(MAX_MARKS_BYTES + 1)
    except OSError:
        return {}
    if len(text) > MAX_MARKS_BYTES:
        return {}
    marks = {}
    for line in text.splitlines():
        match = _MARK_LINE.match(line)
        if match is None:
            continue
        number, second, week, _, _, _, lat, lon, height, north, east, up, quality = match.groups()
        sigma = _sigma_m(east), _sigma_m(north), _sigma_m(up)
        place = float(lon), float(lat), float(height)
        if place[:2] == (0.0, 0.0):
            place = sigma = (float("nan"), float("nan"), float("nan"))
        t_s = float(gps_to_utc_s(int(week) * WEEK_S + float(second)))
        marks[int(number)] = ExposureMark(t_s, place, sigma, int(quality or 0) >= FIXED_FROM)
    return marks


def _sigma_m(text: str | None) -> float:
    """A standard deviation; nan where there is none, or 0 for unknown."""
    return float(text) if text and float(text) > 0.0 else float("nan")
