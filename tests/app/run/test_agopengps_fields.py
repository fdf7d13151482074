"""Field folders of AgOpenGPS in whole runs: `run` with `[field] boundary`, and `batch --boundaries`."""

from __future__ import annotations

import json
import shutil
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyproj import Geod

from furrowmap.cli.main import command_line

ORIGIN = (53.4360564, -111.160047)
FOLDERS = ("02-agopengps-folder-in-session", "01-agopengps-plane")
SQUARE_M2 = 640_000.8
"""Of 800 m by 800 m of the plane at its origin, on the ellipsoid: README of the sample."""


def placed(east_m: float, north_m: float) -> tuple[float, float]:
    """Latitude and longitude of a place in the plane: LocalPlane.cs, with metres per degree at its own latitude."""
    at = np.radians(ORIGIN[0])
    lat_m = 111132.92 - 559.82 * np.cos(2 * at) + 1.175 * np.cos(4 * at) - 0.0023 * np.cos(6 * at)
    lat = ORIGIN[0] + north_m / lat_m
    b = np.radians(lat)
    lon_m = 111412.84 * np.cos(b) - 93.5 * np.cos(3 * b) + 0.118 * np.cos(5 * b)
    return float(lat), float(ORIGIN[1] + east_m / lon_m)


def sentence(body: str) -> str:
    return f"${body}*{reduce(lambda a, b: a ^ b, body.encode()):02X}\r\n"


def drive(path: Path, east_m: float, south_m: float) -> None:
    """A pass northward at 4 m/s from 15:00:00 to 15:03:10, fixed, as the states of the samples have it."""
    text = ""
    for k in range(951):
        lat, lon = placed(east_m, south_m + 0.8 * k)
        clock = f"15{k // 300:02d}{k / 5 % 60:05.2f}"
        place = f"{int(lat):02d}{60 * (lat % 1):010.7f},N,{int(-lon):03d}{60 * (-lon % 1):010.7f},W"
        text += sentence(f"GPZDA,{clock},12,05,2026,00,00")
        text += sentence(f"GPGGA,{clock},{place},4,14,0.6,650.0,M,-20.0,M,1.0,0001")
    path.write_text(text, newline="")


def session(shared_data: Path, sample: str, folder: Path, east_m: float, south_m: float) -> Path:
    source = shared_data / "foreign" / sample
    source = source if (source / "session.toml").exists() else source / "sessions" / "s"
    shutil.copytree(source, folder, copy_function=shutil.copyfile)
    folder.chmod(0o755)
    drive(folder / "gnss.nmea", east_m, south_m)
    return folder / "session.toml"


def value_of(found: Any, key: str) -> Any:
    """The value of a key anywhere in a report."""
    below = found.values() if isinstance(found, dict) else found if isinstance(found, list) else ()
    own = found.get(key) if isinstance(found, dict) else None
    return own if own is not None else next((one for part in below if (one := value_of(part, key)) is not None), None)


def report(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def test_sample__a_run_has_the_ground_of_the_field_folder(shared_data: Path, tmp_path: Path) -> None:
    path = session(shared_data, FOLDERS[0], tmp_path / "s", 400.0, 20.0)
    assert command_line(["run", str(path), "-o", str(tmp_path / "out")]) == 0
    found = report(tmp_path / "out" / "report.json")
    assert value_of(found, "field_area_ellipsoid_m2") == pytest.approx(SQUARE_M2, abs=0.1)
    # 187 s at 4 m/s, of 3 m
    assert value_of(found, "worked_area_ellipsoid_m2") == pytest.approx(187 * 4.0 * 3.0, rel=2e-3)
    assert {file["name"] for file in found["inputs"]} >= {"North/Boundary.txt", "North/Field.txt"}


@pytest.mark.parametrize(("north", "east_m", "south_m"), [("North", 3798.0, 3020.0), ("quarter/North", 798.0, 20.0)])
def test_sample__a_batch_finds_the_field_of_a_pass_two_metres_inside(
    north: str, east_m: float, south_m: float, shared_data: Path, tmp_path: Path
) -> None:
    session(shared_data, FOLDERS[1], tmp_path / "sessions" / "s", east_m, south_m)
    boundary = shared_data / "foreign" / FOLDERS[1] / north
    typed = ["batch", tmp_path / "sessions", "-o", tmp_path / "out", "--boundaries", boundary, "--workers", 1]
    assert command_line([str(word) for word in typed]) == 0
    found = report(next((tmp_path / "out").rglob("report.json")))
    area_m2 = value_of(found, "field_area_ellipsoid_m2")
    # metres per degree of longitude are those of each corner's latitude: by the closed form
    corners = [placed(*place) for place in corners_of(boundary)]
    lat, lon = np.array([*corners, corners[0]]).T
    exact = abs(Geod(ellps="WGS84").polygon_area_perimeter(lon, lat)[0])
    assert area_m2 == pytest.approx(exact, abs=0.2)
    assert value_of(found, "worked_area_ellipsoid_m2") == pytest.approx(187 * 4.0 * 3.0, rel=2e-3)


def corners_of(folder: Path) -> list[tuple[float, float]]:
    rows = [line.split(",") for line in (folder / "Boundary.txt").read_text().splitlines() if line.count(",") == 2]
    return [(float(east), float(north)) for east, north, _ in rows]
