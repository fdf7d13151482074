"""Polygons that take hours and all memory unless their edges are counted first."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import shapely
from pyproj import CRS

from furrowmap.core.crops.parcel_areas import read_parcels
from furrowmap.core.readers.areas.area import read_area
from furrowmap.core.readers.areas.repair import repaired, workable
from furrowmap.core.readers.boundary_file import read_fields
from furrowmap.core.runtime.errors import InputError
from tests.core.readers.areas.nasty_polygons import CORNERS, NASTY, SIDE_M, feature, fine_outline, geojson, parcels

MAP = CRS.from_epsg(6677)
MOST_BYTES = 2_000_000_000
MOST_CPU_S = 60
READ_ALL = """
import os, resource, sys, traceback  # ru_maxrss would be that of the parent, too
from pathlib import Path
import numpy as np, shapely
from pyproj import CRS
from furrowmap.core.crops.parcel_areas import read_parcels
from furrowmap.core.readers.areas.area import read_area
from furrowmap.core.readers.boundary_file import read_fields
from furrowmap.core.runtime.errors import InputError

def read_all(path):
    crs = CRS.from_epsg(6677)
    xy = np.random.default_rng(1).uniform(-150, 150, (100_000, 2))
    for read in (
        lambda: read_area(path, crs).contains(xy),
        lambda: shapely.union_all([field.outline for field in read_fields(path)[0]]),
        lambda: read_parcels(path, crs, (0.1, 0.1)),
    ):
        try:
            read()
            print("read")
        except InputError as error:
            print(error.code)
    print(1024 * int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0]), flush=True)

for line in sys.stdin:  # each file in a process of its own, which need not import anything
    child = os.fork()
    if child == 0:
        resource.setrlimit(resource.RLIMIT_CPU, ({cpu_s}, {cpu_s}))
        try:
            read_all(Path(line.strip()))
        except BaseException:
            traceback.print_exc()
        os._exit(0)
    os.waitpid(child, 0)
    print(".", flush=True)
"""


@pytest.fixture(scope="module")
def program() -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-W", "ignore", "-c", READ_ALL.format(cpu_s=MOST_CPU_S * max(1, CORNERS // 100_000))]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as program:
        yield program


@pytest.mark.skipif(sys.platform != "linux", reason="/proc is that of Linux")
@pytest.mark.parametrize("name", NASTY)
def test_promise_10__polygons_take_a_minute_and_two_gigabytes_at_most(
    name: str, tmp_path: Path, program: subprocess.Popen[str]
) -> None:
    path = geojson([feature(NASTY[name](), id="A")], tmp_path / "nasty.geojson")
    assert program.stdin is not None
    assert program.stdout is not None
    program.stdin.write(f"{path}\n")
    program.stdin.flush()
    *answers, memory = iter(program.stdout.readline, ".\n")
    assert len(answers) == 3
    assert int(memory) < MOST_BYTES


def test_equal_holes__are_one(tmp_path: Path) -> None:
    path = geojson([feature(NASTY["equal_holes"](), id="A")], tmp_path / "holes.geojson")
    whole = shapely.Polygon([(SIDE_M, 0), (0, SIDE_M), (-SIDE_M, 0), (0, -SIDE_M)]).area - 50.0
    (parcel,) = read_parcels(path, MAP)[0]
    assert parcel.gross.area == pytest.approx(whole)
    (area,) = read_area(path, MAP).polygons
    assert area.area == pytest.approx(whole)


def test_an_outline_of_a_million_corners__keeps_its_shape_within_a_millimetre(tmp_path: Path) -> None:
    rings = fine_outline(1_000_000)
    (area,) = read_area(geojson([feature(rings)], tmp_path / "fine.geojson"), MAP).polygons
    assert shapely.get_num_coordinates(area) < 20_000
    assert area.area == pytest.approx(shapely.Polygon(rings[0]).area, abs=0.001 * 2.0 * np.pi * SIDE_M)
    some = shapely.points(np.array(rings[0])[::1000])
    assert shapely.distance(some, area.exterior).max() < 1e-3


def test_promise_17__coordinates_beyond_the_earth_are_refused(tmp_path: Path) -> None:
    path = geojson([feature(NASTY["huge_coordinates"]())], tmp_path / "huge.geojson")
    with pytest.raises(InputError, match="nowhere on the Earth"):
        read_fields(path)


@pytest.mark.parametrize(("name", "says"), [("woven", "cross each other"), ("star_of_spikes", "close together")])
def test_edges_that_meet_too_often__are_refused(name: str, says: str) -> None:
    shape = shapely.Polygon(NASTY[name]()[0])
    for use in (repaired, lambda one: workable([one], MAP)):
        with pytest.raises(ValueError, match=says):
            use(shape)


@pytest.mark.parametrize("corners", [5, 101])
def test_polygons_with_few_corners__are_unchanged(corners: int) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, corners, endpoint=False)
    shape = shapely.Polygon(np.column_stack([np.cos(angle), np.sin(angle)]))
    (kept,) = workable([shape], MAP)
    assert kept.equals_exact(shape, 0.0)


def test_thousands_of_parcels__are_read(tmp_path: Path) -> None:
    side = 316 if "KILLS" in os.environ else 100
    found = read_parcels(geojson(parcels(side), tmp_path / "parcels.geojson"), MAP, (0.2, 0.2))[0]
    assert len(found) == side**2
    assert found[7].id == "P7"
    side_m = 2.0 - 2.0 * 0.2 * 0.9999  # the inset is on the ground, and the map has that scale at its meridian
    assert found[-1].net.area == pytest.approx(side_m**2, rel=1e-6)
