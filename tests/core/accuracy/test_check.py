"""Clouds and surfaces against surveyed points: errors that were put in come out."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
import rasterio
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from pyproj import CRS, Transformer

from furrowmap.cli.main import command_line
from furrowmap.core.accuracy.cloud_at_points import TargetSearch
from furrowmap.core.accuracy.point_check import surface_at_points
from furrowmap.core.accuracy.product_check import Component, HeldHeights, check_product
from furrowmap.core.crops.parcel_areas import read_parcels
from furrowmap.core.pointclouds.flat_targets import TargetShape
from furrowmap.core.readers.chosen_survey import SurveyOptions
from furrowmap.core.readers.surveyed_points import read_points
from furrowmap.core.runtime.errors import FurrowmapError, InputError, RefusedError

E, N = 22_900.0, 11_600.0
SIDE_M = 24.0
SLOPE = 0.05, -0.03


def height(e: NDArray[np.float64], n: NDArray[np.float64]) -> NDArray[np.float64]:
    """A plane field."""
    return 40.0 + SLOPE[0] * (e - E) + SLOPE[1] * (n - N)


def places(count: int = 36, seed: int = 1) -> NDArray[np.float64]:
    """Points on a lattice, a few centimetres off its lines."""
    side = int(np.sqrt(count))
    line = np.linspace(3.0, SIDE_M - 3.0, side)
    grid = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    en = grid + np.random.default_rng(seed).uniform(-0.05, 0.05, grid.shape) + np.array([E, N])
    return np.column_stack([en, height(*en.T)])


def write_points(path: Path, xyz: NDArray[np.float64], sigma_m: float | None = None) -> Path:
    head = "name,e_m,n_m,h_m" + (",sigma_h_m,sigma_e_m,sigma_n_m" if sigma_m is not None else "")
    tail = f",{sigma_m},{sigma_m},{sigma_m}" if sigma_m is not None else ""
    rows = [f"P{k},{e:.4f},{n:.4f},{h:.5f}{tail}" for k, (e, n, h) in enumerate(xyz.tolist(), start=1)]
    path.write_text("\n".join([head, *rows]) + "\n")
    return path


def write_cloud(
    path: Path,
    xyz: NDArray[np.float64],
    intensity: NDArray[Any] | int = 20,
    swath: NDArray[Any] | int = 1,
    crs: str = "EPSG:6677",
    t_s: NDArray[np.float64] | None = None,
    software: str = "",
) -> Path:
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.full(3, 1e-4), np.array([E, N, 0.0])
    header.add_crs(CRS(crs))
    las = laspy.LasData(header)
    las.x, las.y, las.z = xyz.T
    las.intensity = np.full(len(xyz), intensity) if np.isscalar(intensity) else intensity
    las.point_source_id = np.full(len(xyz), swath) if np.isscalar(swath) else swath
    if t_s is not None:
        las.gps_time = t_s
    if software:
        las.header.generating_software = software
    las.return_number = las.number_of_returns = np.ones(len(xyz), np.uint8)
    las.write(path)
    return path


def returns(count: int = 120_000, seed: int = 2) -> NDArray[np.float64]:
    en = np.random.default_rng(seed).uniform(0.0, SIDE_M, (count, 2)) + np.array([E, N])
    return np.column_stack([en, height(*en.T)])


def test_cloud__a_shift_of_two_swaths_is_found_to_a_millimetre(tmp_path: Path) -> None:
    """Two swaths 3 and 5 cm high with 2 cm of noise: mean error 4 cm, between swaths 2 cm, within them 2 cm."""
    xyz = returns()
    swath = 1 + (np.arange(len(xyz)) % 2)
    xyz[:, 2] += np.where(swath == 1, 0.03, 0.05) + np.random.default_rng(3).normal(0.0, 0.02, len(xyz))
    survey = places()
    found = check_product(
        write_cloud(tmp_path / "a.las", xyz, swath=swath), write_points(tmp_path / "p.csv", survey, 0.01)
    )
    accuracy, vertical = found.accuracy, found.accuracy.vertical
    assert vertical is not None
    assert (found.kind, vertical.n, accuracy.precision.swath_pairs) == ("cloud", 36, 36)
    assert vertical.mean_m == pytest.approx(0.04, abs=1.5e-3)
    assert vertical.fit_m**2 == pytest.approx(vertical.mean_m**2 + vertical.sigma_m**2 * 35 / 36, rel=1e-9)
    assert vertical.rmse_m == pytest.approx(np.hypot(vertical.fit_m, 0.01), rel=1e-9)
    assert accuracy.precision.within_swath_m == pytest.approx(0.02, abs=1e-3)
    assert accuracy.precision.between_swath_m == pytest.approx(0.02, abs=4e-3)
    assert [notice.code for notice in found.notices if notice.code.startswith("check")] == ["check-bias"]


@pytest.mark.parametrize(
    ("own", "timed", "numbered", "swath_key", "codes"),
    [
        (True, True, True, "times", set()),
        (True, False, True, "nothing", {"check-swaths-unknown"}),
        (False, True, False, "times", set()),
        (False, False, True, "sources", set()),
        (False, False, False, "nothing", {"check-swaths-unknown"}),
    ],
)
def test_precision__swaths_are_told_apart_by_what_the_cloud_has(
    tmp_path: Path, own: bool, timed: bool, numbered: bool, swath_key: str, codes: set[str]
) -> None:
    """Two visits a minute apart, the second 3 cm higher. In furrowmap's clouds sources are passes, which change midway.

    RMS and greatest of the differences are those 3 cm; planes through 20 returns of 1 cm differ by 3 mm more.
    """
    xyz = returns()
    visit = np.arange(len(xyz)) % 2
    xyz[:, 2] += 0.03 * visit + np.random.default_rng(3).normal(0.0, 0.01, len(xyz))
    source = np.where(np.random.default_rng(4).random(len(xyz)) < 0.5, 0, 7) if own else 1 + visit
    t_s = 3e8 + 60.0 * visit + np.random.default_rng(5).uniform(0.0, 5.0, len(xyz))
    cloud = write_cloud(
        tmp_path / "a.las", xyz, swath=source if numbered else 0, t_s=t_s if timed else None,
        software="furrowmap 0.1" if own else "another",
    )  # fmt: skip
    found = check_product(cloud, write_points(tmp_path / "p.csv", places(), 0.005))
    precision = found.accuracy.precision
    assert precision.swath_key == swath_key
    assert {notice.code for notice in found.notices if "swaths" in notice.code} == codes
    if swath_key == "nothing":
        assert precision.swath_pairs == 0
        assert np.isnan(precision.between_swath_max_m)
        return
    assert precision.swath_pairs == 36
    assert precision.between_swath_m == pytest.approx(np.hypot(0.03, 0.0032), abs=2e-3)
    assert 0.03 < precision.between_swath_max_m < 0.045
    assert precision.within_swath_m == pytest.approx(0.01, abs=3e-4)
    assert 0.03 < precision.within_swath_max_m < 0.07


def test_precision__is_judged_by_the_limits_of_the_class(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """0.60, 0.80 and 1.60 of the class: with differences of 3 cm, a class of 3.75 cm, not one of 3 cm."""
    xyz = returns()
    visit = np.arange(len(xyz)) % 2
    xyz[:, 2] += 0.03 * visit - 0.015
    cloud = write_cloud(tmp_path / "a.las", xyz, swath=1 + visit)
    points = write_points(tmp_path / "p.csv", places(), 0.004)
    assert cli("check", cloud, points, "--require-vertical", "0.03", "--json", "-q") == 0
    answer = json.loads(capsys.readouterr().out)
    verdict = answer["precision"]["between_swath_m"]
    assert (verdict["found_m"], verdict["limit_m"]) == (pytest.approx(0.03, abs=1e-4), pytest.approx(0.024))
    met = {name: one["met"] for name, one in answer["precision"].items()}
    assert met == {"within_swath_max_m": True, "between_swath_m": False, "between_swath_max_m": True}
    assert "check-precision" in {notice["code"] for notice in answer["warnings"]}
    assert cli("check", cloud, points, "--require-vertical", "0.038") == 0
    told = capsys.readouterr()
    assert "(within the class limit of 0.0304 m)" in told.out
    assert "precision" not in told.err
    write_points(tmp_path / "p.csv", places(), 0.02)
    assert cli("check", cloud, points, "--require-vertical", "0.038") == 0
    assert "twice as accurate as the class of 3.8 cm" in capsys.readouterr().err


def test_precision__one_visit_says_nothing_of_others(tmp_path: Path) -> None:
    found = check_product(write_cloud(tmp_path / "a.las", returns()), write_points(tmp_path / "p.csv", places(), 0.005))
    assert "check-swaths-single" in {notice.code for notice in found.notices}


def test_cloud__noise_and_edges_and_empty_places_are_told(tmp_path: Path) -> None:
    xyz = returns()
    survey = places()
    hole, edge = survey[0, :2], survey[1, :2]
    xyz = xyz[np.hypot(*(xyz[:, :2] - hole).T) > 0.5]
    near = np.hypot(*(xyz[:, :2] - edge).T) < 0.5
    xyz[near, 2] += np.where(xyz[near, 0] > edge[0], 1.0, 0.0)
    found = check_product(write_cloud(tmp_path / "a.las", xyz), write_points(tmp_path / "p.csv", survey))
    assert found.accuracy.vertical is not None
    assert found.accuracy.vertical.n == 34
    assert found.accuracy.vertical.greatest_m < 1e-3
    assert ["returns within" in str(found.points[0].why_not), "edge" in str(found.points[1].why_not)] == [True, True]
    assert {notice.code for notice in found.notices} >= {"check-unused", "check-survey-unknown"}


@pytest.mark.parametrize(("bright", "shape"), [(200, "disc"), (3, "disc"), (200, "checkerboard")])
def test_targets__show_the_horizontal_error(tmp_path: Path, bright: int, shape: TargetShape) -> None:
    """Discs of 40 cm and boards of 36 cm lie 12 cm east and 7 cm south of where they were surveyed."""
    xyz = returns(200_000)
    survey = places(9)
    intensity = np.random.default_rng(4).normal(60.0, 8.0, len(xyz)).clip(0)
    for middle in survey[:, :2] + np.array([0.12, -0.07]):
        off = xyz[:, :2] - middle
        if shape == "disc":
            intensity[np.hypot(*off.T) < 0.2] = bright
        else:
            board = np.abs(off).max(axis=1) < 0.18
            intensity[board] = np.where(off[board].prod(axis=1) > 0.0, bright, 5.0)
    found = check_product(
        write_cloud(tmp_path / "a.las", xyz, intensity.astype(np.uint16)),
        write_points(tmp_path / "p.csv", survey, 0.005),
        search=TargetSearch("intensity", 0.4 if shape == "disc" else 0.36, shape),
    )
    easting, northing = found.accuracy.easting, found.accuracy.northing
    assert easting is not None
    assert northing is not None
    assert (easting.n, northing.n) == (9, 9)
    assert (easting.mean_m, northing.mean_m) == pytest.approx((0.12, -0.07), abs=3e-3)
    assert max(easting.sigma_m, northing.sigma_m) < (0.008 if shape == "disc" else 0.012)
    assert found.accuracy.horizontal_m == pytest.approx(np.hypot(0.12, 0.07), abs=6e-3)
    assert found.accuracy.spatial_m is not None


def test_targets__none_is_made_up_of_plain_soil(tmp_path: Path) -> None:
    xyz = returns(100_000)
    intensity = np.random.default_rng(5).normal(60.0, 8.0, len(xyz)).clip(0).astype(np.uint16)
    found = check_product(
        write_cloud(tmp_path / "a.las", xyz, intensity),
        write_points(tmp_path / "p.csv", places(9)),
        search=TargetSearch("intensity"),
    )
    assert found.accuracy.horizontal_m is None
    assert "check-targets" in {notice.code for notice in found.notices}


KINDS = ("Disc", "disk", "", "checkerboard", "chessboard", "checkerboard", "corner", "ground", "disc")
"""Of nine points; the board at the sixth and the disc at the last are not there."""


def targets_of_all_kinds(folder: Path) -> tuple[Path, Path]:
    """A cloud and the table of its points: discs of 40 cm, boards of 60 cm, a corner, all 6 cm east and 4 cm north."""
    survey = places(9)
    xyz = returns(200_000)
    intensity = np.random.default_rng(6).normal(60.0, 8.0, len(xyz)).clip(0)
    off_m = np.array([0.06, 0.04])
    for middle, kind in zip(survey[:, :2] + off_m, KINDS[:5], strict=False):
        off = xyz[:, :2] - middle
        if kind.endswith("board"):
            board = np.abs(off).max(axis=1) < 0.3
            intensity[board] = np.where(off[board].prod(axis=1) > 0.0, 200, 5)
        else:
            intensity[np.hypot(*off.T) < 0.2] = 200
    corner = np.array([*(survey[6, :2] + off_m), survey[6, 2] + 0.03])
    chance = np.random.default_rng(7)
    near = np.abs(xyz[:, :2] - corner[:2]).max(axis=1) < 1.6
    inside = near & (xyz[:, :2] < corner[:2]).all(axis=1)
    xyz[near, 2] = corner[2]
    aside = -chance.uniform(0.0, 1.4, (800, 2))
    walls = np.concatenate([aside[:400] * (1, 0), aside[400:] * (0, 1)])
    walls = corner + np.column_stack([walls, chance.uniform(0.0, 1.4, 800)])
    light = np.concatenate([intensity[~inside], np.full(800, 60.0)]).astype(np.uint16)
    cloud = write_cloud(folder / "a.las", np.concatenate([xyz[~inside], walls]), light)
    points = write_points(folder / "p.csv", survey, 0.005)
    head, *rows = points.read_text().splitlines()
    lines = [f"{head},target", *(f"{row},{kind}" for row, kind in zip(rows, KINDS, strict=True))]
    points.write_text("\n".join(lines) + "\n")
    return cloud, points


def test_targets__are_those_that_the_points_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cloud, points = targets_of_all_kinds(tmp_path)
    found = check_product(cloud, points, search=TargetSearch("intensity", 0.4, "disc", 0.6))
    assert [one.target.kind.value for one in found.points] == [
        "disc", "disc", "disc", "checkerboard", "checkerboard", "checkerboard", "corner", "ground", "disc",
    ]  # fmt: skip
    error = np.array([one.error_m for one in found.points])
    np.testing.assert_allclose(error[[0, 1, 2, 3, 4, 6], :2], [[0.06, 0.04]] * 6, atol=0.01)
    assert np.isnan(error[[5, 7, 8], :2]).all()
    assert error[6, 2] == pytest.approx(0.03, abs=0.003)
    assert np.abs(error[[0, 1, 2, 3, 4, 5, 7, 8], 2]).max() < 0.002
    command = ("check", cloud, points, "--targets", "intensity", "--diameter", "0.4", "--checkerboard", "0.6")
    assert cli(*command, "--require-horizontal", "0.08") == 0
    told = capsys.readouterr().err
    assert "Discs that were not found: 1 of 4; the diameter looked for is 0.4 m." in told
    assert "Checkerboards that were not found: 1 of 3; the side looked for is 0.6 m." in told
    points.write_text(points.read_text().replace("chessboard", "cone"))
    with pytest.raises(InputError, match="point P5 has the target 'cone'"):
        check_product(cloud, points, search=TargetSearch("intensity"))


def test_targets__corners_are_found_without_intensity_and_in_clouds_alone(tmp_path: Path) -> None:
    cloud, points = targets_of_all_kinds(tmp_path)
    points.write_text(points.read_text().replace("chessboard", "cone"))
    found = check_product(cloud, points)
    assert np.flatnonzero([np.isfinite(one.found_m[0]) for one in found.points]).tolist() == [6]
    surface = check_product(write_surface(tmp_path / "dsm.tif"), points, search=TargetSearch("intensity"))
    assert [one.name for one in surface.points if "corner" in str(one.why_not)] == ["P7"]
    assert "check-targets.surface" in {notice.key for notice in surface.notices}
    area = tmp_path / "area.csv"
    east, north, _ = found.points[6].surveyed_m
    corners = ((east - 1, north - 1), (east + 1, north - 1), (east + 1, north + 1), (east - 1, north + 1))
    area.write_text("id,e_m,n_m\n" + "".join(f"a,{e},{n}\n" for e, n in corners))
    (one,) = check_product(cloud, points, SurveyOptions(within=area)).points
    assert one.error_m == pytest.approx([0.06, 0.04, 0.03], abs=0.01)


def write_surface(path: Path, cell_m: float = 0.5, crs: str = "EPSG:6677") -> Path:
    count = int(SIDE_M / cell_m)
    e, n = E + (np.arange(count) + 0.5) * cell_m, N + SIDE_M - (np.arange(count) + 0.5) * cell_m
    heights = height(*np.meshgrid(e, n)).astype(np.float32) + np.float32(0.02)
    heights[-9:, :9] = np.nan
    transform = rasterio.Affine(cell_m, 0, E, 0, -cell_m, N + SIDE_M)
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=count,
        height=count,
        count=1,
        dtype="float32",
        crs=crs,
        transform=transform,
        nodata=np.nan,
    ) as raster:
        raster.write(heights, 1)
    return path


def test_surface__bilinear_heights_are_exact_on_a_plane(tmp_path: Path) -> None:
    found = check_product(write_surface(tmp_path / "dsm.tif"), write_points(tmp_path / "p.csv", places()))
    vertical = found.accuracy.vertical
    assert vertical is not None
    assert (found.kind, vertical.n) == ("surface", 35)
    assert vertical.mean_m == pytest.approx(0.02, abs=1e-5)
    assert vertical.sigma_m < 1e-5


def test_points__in_degrees_or_another_crs_are_brought_to_the_product(tmp_path: Path) -> None:
    survey = places(4)
    to_degrees = Transformer.from_crs("EPSG:6677", "EPSG:6668", always_xy=True)
    lon, lat = to_degrees.transform(*survey[:, :2].T)
    rows = [f"{k},{a:.10f},{b:.10f},{c:.4f}" for k, (a, b, c) in enumerate(zip(lon, lat, survey[:, 2], strict=True))]
    (tmp_path / "d.csv").write_text("id;lon;lat;z\n".replace(";", ",") + "\n".join(rows))
    points = read_points(tmp_path / "d.csv", CRS("EPSG:6677"))
    np.testing.assert_allclose(points.xyz_m, survey, rtol=0, atol=2e-4)
    utm = Transformer.from_crs("EPSG:6677", "EPSG:6690", always_xy=True).transform(*survey[:, :2].T)
    write_points(tmp_path / "u.csv", np.column_stack([*utm, survey[:, 2]]))
    points = read_points(tmp_path / "u.csv", CRS("EPSG:6677"), CRS("EPSG:6690"))
    np.testing.assert_allclose(points.xyz_m, survey, rtol=0, atol=2e-4)


def test_points__of_a_geopackage_bring_their_crs_and_heights(tmp_path: Path) -> None:
    geopandas = pytest.importorskip("geopandas")
    import shapely

    survey = places(4)
    table = geopandas.GeoDataFrame(
        {"name": list("abcd"), "sigma_h_m": [0.01] * 4}, geometry=shapely.points(survey), crs="EPSG:6677"
    )
    table.to_file(tmp_path / "p.gpkg", engine="pyogrio")
    points = read_points(tmp_path / "p.gpkg", CRS("EPSG:6677+6695"))
    assert points.name == ("a", "b", "c", "d")
    np.testing.assert_allclose(points.xyz_m, survey, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(points.sigma_m[:, 2], 0.01)
    table.to_crs("EPSG:6677+3855").to_file(tmp_path / "q.gpkg", engine="pyogrio")
    with pytest.raises(RefusedError, match="EGM2008"):
        read_points(tmp_path / "q.gpkg", CRS("EPSG:6677+6695"))


def test_points__of_a_geopackage_without_geometries_are_refused(tmp_path: Path) -> None:
    pyogrio, pandas = pytest.importorskip("pyogrio"), pytest.importorskip("pandas")
    pyogrio.write_dataframe(pandas.DataFrame({"e_m": [1.0], "n_m": [2.0], "h_m": [3.0]}), tmp_path / "p.gpkg")
    with pytest.raises(InputError, match="a table without geometries"):
        read_points(tmp_path / "p.gpkg", CRS("EPSG:6677"))
    with pytest.raises(InputError, match="a table without geometries"):
        read_parcels(tmp_path / "p.gpkg", CRS("EPSG:6677"))


def table(head: str, rows: list[tuple[str, ...]], separator: str = ",") -> str:
    return "\n".join(separator.join(row) for row in [tuple(head.split(",")), *rows]) + "\n"


@pytest.mark.parametrize(
    ("head", "separator", "encoding", "form"),
    [
        ("name,e_m,n_m,h_m", ",", "utf-8", "{:.4f}"),
        ("name,e_m,n_m,h_m", ",", "utf-8-sig", "{:.4f}"),
        ("name,e_m,n_m,h_m", "\t", "utf-16", "{:.4f}"),
        ("点名,Y座標,X座標,標高", ",", "cp932", "{:.4f}"),
        ("Name,Easting (m),Northing [m],Elevation（m）", ";", "utf-8", "{:.4f}"),
        ("name,e_m,n_m,h_m", ";", "utf-8", "comma"),
    ],
    ids=["plain", "with a mark", "UTF-16", "Shift-JIS", "units", "decimal commas"],
)
def test_points__of_any_spreadsheet_are_the_same(
    tmp_path: Path, head: str, separator: str, encoding: str, form: str
) -> None:
    survey = places(4)

    def cell(value: float) -> str:
        return f"{value:.4f}".replace(".", ",") if form == "comma" else form.format(value)

    rows = [(f"杭{k}", *map(cell, xyz)) for k, xyz in enumerate(survey.tolist())]
    (tmp_path / "p.csv").write_bytes(("# of a total station\n" + table(head, rows, separator)).encode(encoding))
    points = read_points(tmp_path / "p.csv", CRS("EPSG:6677"))
    np.testing.assert_allclose(points.xyz_m, survey, rtol=0, atol=6e-5)
    assert points.name == ("杭0", "杭1", "杭2", "杭3")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("name;e_m;n_m;h_m\na;22,900.1;11,600.2;40.0\n", "line 2 holds '22,900.1' under e_m"),
        ("name,lat,lon,h\na,140.02,36.87,40.0\n", "longitude and latitude are swapped"),
        ("P1,22900,11600,40\nP2,22901,11600,40\n", "has no column e_m, n_m, h_m"),
        ("\0\0\1\2,;", "it is binary data, not text"),
        ("one word\n", "no comma, semicolon or tab"),
    ],
)
def test_points__whose_numbers_cannot_be_meant_are_told_where(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "p.csv").write_text(text)
    with pytest.raises(FurrowmapError, match=re.escape(says)):
        read_points(tmp_path / "p.csv", CRS("EPSG:6677"))


def test_points__with_x_for_north_are_told_how_to_name_them(tmp_path: Path) -> None:
    survey = places()
    rows = [(f"P{k}", f"{n:.4f}", f"{e:.4f}", f"{h:.4f}") for k, (e, n, h) in enumerate(survey.tolist())]
    (tmp_path / "p.csv").write_text(table("name,x,y,h", rows))
    for product in (write_surface(tmp_path / "dsm.tif"), write_cloud(tmp_path / "a.las", returns(20_000))):
        with pytest.raises(FurrowmapError, match=r"swapped 3[56] points lie in it"):
            check_product(product, tmp_path / "p.csv")


def test_heights_of_another_kind_are_asked_for(tmp_path: Path) -> None:
    survey = places()
    survey[:, 2] -= 42.77
    found = check_product(write_surface(tmp_path / "dsm.tif"), write_points(tmp_path / "p.csv", survey, 0.005))
    (bias,) = [notice.text for notice in found.notices if notice.code == "check-bias"]
    assert "whether both heights are ellipsoidal" in bias


def test_heights_of_a_run__are_held_against_points(tmp_path: Path) -> None:
    """The surface is 2 cm too high everywhere: more than 4 mm explain, not more than 8 mm."""
    surface = write_surface(tmp_path / "dsm.tif")
    points = write_points(tmp_path / "p.csv", places(), 0.002)
    found, as_good = (HeldHeights.of(surface_at_points(surface, points), stated) for stated in (0.004, 0.008))
    assert (found.points, found.compared) == (36, 35)  # one lies where the surface has no heights
    assert found.off_m == pytest.approx(0.02, abs=1e-3)
    assert found.sigma_m == pytest.approx(math.hypot(0.004, 0.002), rel=0.05)
    notice = found.notice("p.csv")
    assert notice is not None
    assert notice.code == "check-points-off"
    assert as_good.notice("p.csv") is None
    few = HeldHeights.of(surface_at_points(surface, write_points(points, places()[:2])), 0.004)
    told = few.notice("p.csv")
    assert told is not None
    assert told.code == "check-points-few"


def test_cloud__in_degrees_is_brought_to_metres(tmp_path: Path) -> None:
    """The same field in longitudes and latitudes: points in metres find their returns."""
    xyz = returns(60_000)
    lon, lat = Transformer.from_crs("EPSG:6677", "EPSG:6668", always_xy=True).transform(*xyz[:, :2].T)
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.array([1e-9, 1e-9, 1e-4]), np.array([lon.min(), lat.min(), 0.0])
    header.add_crs(CRS("EPSG:6668"))
    las = laspy.LasData(header)
    las.x, las.y, las.z = lon, lat, xyz[:, 2]
    las.write(tmp_path / "d.las")
    points = write_points(tmp_path / "p.csv", places(), 0.005)
    with pytest.raises(FurrowmapError, match="has eastings and northings") as refused:
        check_product(tmp_path / "d.las", points)
    assert "--crs" in refused.value.lines[2]
    found = check_product(tmp_path / "d.las", points, SurveyOptions(CRS("EPSG:6677")))
    assert found.accuracy.vertical is not None
    assert (found.accuracy.vertical.n, found.crs.is_projected) == (36, True)
    assert found.accuracy.vertical.greatest_m < 1e-3


def test_cloud__without_a_crs_takes_that_of_the_points(tmp_path: Path) -> None:
    path = write_cloud(tmp_path / "a.las", returns(20_000))
    las = laspy.read(path)
    las.header.vlrs.clear()
    las.header.global_encoding.wkt = False
    las.write(path)
    points = write_points(tmp_path / "p.csv", places(), 0.005)
    with pytest.raises(FurrowmapError, match="states no CRS") as refused:
        check_product(path, points)
    assert "--crs" in refused.value.lines[2]
    assert check_product(path, points, SurveyOptions(CRS("EPSG:6677"))).accuracy.vertical is not None


def test_surface__that_holds_no_heights_is_refused(tmp_path: Path) -> None:
    path = write_surface(tmp_path / "change.tif")
    with rasterio.open(path, "r+") as raster:
        raster.update_tags(TIFFTAG_SOFTWARE="furrowmap 0.1.0")
        raster.descriptions = ("change",)
    with pytest.raises(FurrowmapError, match="holds 'change' and no heights"):
        check_product(path, write_points(tmp_path / "p.csv", places()))
    with rasterio.open(path, "r+") as raster:
        raster.descriptions = ("height",)
    assert check_product(path, tmp_path / "p.csv").accuracy.vertical is not None


@pytest.mark.parametrize(
    ("text", "word"),
    [("name,e,n\na,1,2\n", "h_m"), ("name,e,n,h\na,x,y,z\n", "no point"), ("", "no table"), (None, "not there")],
)
def test_points__that_are_none_end_in_three_lines(tmp_path: Path, text: str | None, word: str) -> None:
    if text is not None:
        (tmp_path / "p.csv").write_text(text)
    with pytest.raises(FurrowmapError, match=word) as refused:
        read_points(tmp_path / "p.csv", CRS("EPSG:6677"))
    assert all(refused.value.lines)


@given(
    st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=60).filter(lambda values: np.ptp(values) > 1e-6),
    st.floats(0.0, 0.1),
)
def test_component__obeys_the_identities_of_the_standard(errors: list[float], survey: float) -> None:
    error = np.array(errors)
    n = len(error)
    part = Component.from_errors(error, np.full(n, survey))
    assert part.fit_m**2 == pytest.approx(part.mean_m**2 + part.sigma_m**2 * (n - 1) / n, abs=1e-12)
    assert part.rmse_m**2 == pytest.approx(part.fit_m**2 + survey**2, abs=1e-12)
    assert part.fit_m <= part.greatest_m + 1e-12
    assert Component.from_errors(error, np.full(n, np.nan)).rmse_m == part.fit_m


def cli(*arguments: object) -> int:
    return command_line([str(argument) for argument in arguments])


def test_verb__a_class_that_is_not_met_sets_the_exit_status(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    surface, points = write_surface(tmp_path / "dsm.tif"), write_points(tmp_path / "p.csv", places(), 0.005)
    assert (
        cli("check", surface, points, "--require-vertical", "0.05", "--table", tmp_path / "t.csv", "--json", "-q") == 0
    )
    answer = json.loads(capsys.readouterr().out)
    assert answer["verdicts"]["vertical"]["met"]
    assert answer["accuracy"]["rmse_vertical_m"] == pytest.approx(np.hypot(0.02, 0.005), abs=1e-4)
    assert len((tmp_path / "t.csv").read_text().splitlines()) == 37
    assert cli("check", surface, points, "--require-vertical", "0.02") == 4
    assert "0.021 m; required is at most 0.02 m" in capsys.readouterr().err
    assert cli("check", surface, points, "--require-horizontal", "0.5") == 4
    capsys.readouterr()
    assert cli("check", tmp_path / "none.tif", points, "--table", tmp_path / "t.csv") == 4  # before any work
    assert "t.csv exists already" in capsys.readouterr().err
    assert cli("check", surface, points, "--crs", "EPSG:6691") == 3
    assert "lies where the surface has no heights" in capsys.readouterr().err
