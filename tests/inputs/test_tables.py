"""Every way to write a table in every place that takes one: the same values, whatever the way."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyproj import CRS

from furrowmap.core.crops.trial_tables import read_measured, read_treatments
from furrowmap.core.pipeline.session_aid import read_pixels
from furrowmap.core.readers.areas.area import read_area
from furrowmap.core.readers.boundary_file import read_fields
from furrowmap.core.readers.image_table import read_image_table
from furrowmap.core.readers.mount_csv import read_mount
from furrowmap.core.readers.reader import (
    GivesAttitude,
    GivesInertial,
    GivesPoses,
    GivesScans,
    GivesStates,
    ReadOptions,
    open_recording,
)
from furrowmap.core.readers.surveyed_points import read_points
from tests.inputs.texts import PROPERTIES, Cells, written

START_S = 1_780_000_000
MAP = CRS.from_epsg(25832)
REFUSED: tuple[str, ...] = ()
SQUARE = ((580_000.25, 5_700_000.5), (580_010.25, 5_700_000.5), (580_010.25, 5_700_020.5), (580_000.25, 5_700_020.5))
DEGREES = ((10.125, 51.5), (10.126, 51.5), (10.126, 51.501), (10.125, 51.501))


def by_time(header: str, row: Callable[[int], list[float | str]], rows: int = 12) -> Cells:
    return [["time_unix_s", *header.split()], *([f"{START_S + 0.1 * k:.2f}", *map(str, row(k))] for k in range(rows))]


def read(path: Path, kind: type[Any]) -> Any:
    reader = open_recording([path], ReadOptions())
    assert isinstance(reader, kind)
    return reader


def scans(path: Path) -> Any:
    return np.concatenate([scan.xyz_m for scan in read(path, GivesScans).scans()])


PLACES: Mapping[str, tuple[Cells, Callable[[Path], Any]]] = {
    "[implement] states": (
        [["t_s", "state"], *([f"{START_S + 10.5 * k:.2f}", word] for k, word in enumerate(["down", "up"] * 6))],
        lambda path: read(path, GivesStates).states().begin_s,
    ),
    "[trajectory] files": (
        by_time("e_m n_m h_m roll_deg pitch_deg heading_deg", lambda k: [580000.125 + k, 5.7e6, 90.5, 0.5, -0.5, 12.5]),
        lambda path: read(path, GivesPoses).poses().position,
    ),
    "[imu] files": (
        by_time(
            "gyro_x_dps gyro_y_dps gyro_z_dps accel_x_mps2 accel_y_mps2 accel_z_mps2",
            lambda k: [0.125 * k, -0.25, 0.5, 0.125, 0.25, 9.75],
        ),
        lambda path: read(path, GivesInertial).inertial().rate_radps,
    ),
    "[attitude] roll_pitch": (
        by_time("roll_deg pitch_deg heading_deg", lambda k: [0.125 * k, -0.25, 90.5]),
        lambda path: read(path, GivesAttitude).attitude().roll_deg,
    ),
    "[mount] attitude": (
        by_time("roll_deg pitch_deg yaw_deg", lambda k: [0.125 * k, -0.25, 90.5]),
        lambda path: read_mount(path, float(START_S))[0].quaternion,
    ),
    "[recording] lidar": (
        by_time("angle_deg range_m", lambda k: [-45.5 + 10.25 * (k % 6), 3.125 + k], 24),
        scans,
    ),
    "[camera] table": (
        by_time("file", lambda k: [f"image{k}.jpg"]),
        lambda path: read_image_table(path, path.parent)[0].t_s,
    ),
    "check POINTS": (
        [["name", "e_m", "n_m", "h_m"], *([f"P{k}", f"{e}", f"{n}", "90.125"] for k, (e, n) in enumerate(SQUARE))],
        lambda path: read_points(path, MAP).xyz_m,
    ),
    "--within": (
        [["id", "e_m", "n_m"], *(["A", f"{e}", f"{n}"] for e, n in SQUARE)],
        lambda path: read_area(path, MAP).polygons[0].area,
    ),
    "[field] boundary": (
        [["id", "lon_deg", "lat_deg"], *(["A", f"{lon}", f"{lat}"] for lon, lat in DEGREES)],
        lambda path: read_fields(path)[0][0].outline.area,
    ),
    "--treatments": (
        [["id", "treatment", "n_kg_ha"], *([f"{k}", f"N{k}", f"{10.5 * k}"] for k in range(1, 5))],
        lambda path: [row["n_kg_ha"] for row in read_treatments(path).rows.values()],
    ),
    "response TABLE": (
        [["id", "mean_height_m"], *([f"{k}", f"{0.125 * k}"] for k in range(1, 5))],
        lambda path: read_measured(path, "mean_height_m").value,
    ),
    "[camera] control_pixels": (
        [["file", "name", "u", "v"], *([f"image{k}.jpg", "P1", f"{100.5 + k}", "200.25"] for k in range(4))],
        lambda path: [place[2:] for place in read_pixels(path, ("P1",))[0]],
    ),
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for k in range(12):
        (tmp_path / f"image{k}.jpg").touch()
    return tmp_path


@pytest.mark.parametrize("way", PROPERTIES)
@pytest.mark.parametrize("place", PLACES)
def test_values__do_not_depend_on_how_a_table_is_written(place: str, way: str, folder: Path) -> None:
    cells, values = PLACES[place]
    plain = np.asarray(values(written(folder / "plain.csv", cells, "commas")))
    found = np.asarray(values(written(folder / "table.csv", cells, way)))
    assert plain.size
    np.testing.assert_array_equal(found, plain)
