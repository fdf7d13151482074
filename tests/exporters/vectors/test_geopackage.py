"""`field.gpkg`: what it holds is what it was given, for GDAL, for SQLite and for QGIS."""

from __future__ import annotations

import datetime as dt
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import geopandas as gpd
import numpy as np
import pyogrio
import pytest
import shapely
from pyproj import CRS

from furrowmap.core.runtime.languages.texts import LANGUAGES
from furrowmap.core.values.gnss import Fix
from furrowmap.core.values.trajectory import Motion, ScanPoses, trajectory_from_attitude
from furrowmap.exporters.vectors.geopackage import _check, read_layer, write_field, write_layer

if TYPE_CHECKING:
    from conftest import QgisRoot

JAPAN = CRS.from_epsg(6677)
FIELDS = [
    *("scan", "time", "t_s", "roll_deg", "pitch_deg", "heading_deg", "speed_mps", "motion", "fix"),
    *("sigma_e_m", "sigma_n_m", "sigma_h_m", "sigma_roll_deg", "sigma_pitch_deg", "sigma_heading_deg"),
    *("heading_from", "position_from", "height_from", "level_from"),
    *("implement", "implement_confidence", "tool_height_m", "pass"),
]

T0_S = 1_781_141_020.300  # 2026-06-11T01:23:40.300Z


@pytest.fixture
def truth() -> dict[str, np.ndarray]:
    """Columns as a file is to have them; scan 3 has no pose, the headings cross north."""
    rng = np.random.default_rng(7)
    n = 40
    number = np.delete(np.arange(n + 1), 3)
    return {
        "scan": number,
        "t_s": T0_S + 0.1 * number,
        "xyz_m": np.array([16_650.0, 96_560.0, 271.0]) + rng.uniform(-20, 20, (n, 3)),
        "roll_deg": rng.uniform(-5, 5, n),
        "pitch_deg": rng.uniform(-5, 5, n),
        "heading_deg": (355.0 + 0.5 * np.arange(n)) % 360.0,
        "speed_mps": np.where(np.arange(n) == 5, np.nan, rng.uniform(-1, 2, n)),
        "motion": rng.integers(-1, 2, n).astype(np.int8),
        "fix": rng.choice([-1, 1, 2, 4, 5], n).astype(np.int8),
        "sigma": np.column_stack([rng.uniform(0.01, 0.1, (n, 3)), np.full((n, 3), np.nan)]),
    }


@pytest.fixture
def poses(truth: dict[str, np.ndarray]) -> ScanPoses:
    attitudes = trajectory_from_attitude(
        truth["t_s"], truth["xyz_m"], truth["roll_deg"], truth["pitch_deg"], truth["heading_deg"], max_gap_s=1.0
    )
    return ScanPoses(
        scan=truth["scan"],
        t_s=truth["t_s"],
        xyz_m=truth["xyz_m"],
        quaternion=attitudes.quaternion,
        speed_mps=truth["speed_mps"],
        motion=truth["motion"],
        fix=truth["fix"],
        sigma=truth["sigma"],
        heading_from=np.where(truth["scan"] % 2 == 0, "gnss", "antennas"),
        position_from=np.full(len(truth["scan"]), "gnss"),
        height_from=np.full(len(truth["scan"]), "ground"),
        level_from=np.full(len(truth["scan"]), "assumed"),
        points=np.full(len(truth["scan"]), 25_000),
    )


@pytest.fixture
def field(poses: ScanPoses, tmp_path: Path) -> Path:
    path = tmp_path / "field.gpkg"
    write_field(path, poses, JAPAN)
    return path


def test_trajectory__is_read_back_as_it_was_given(field: Path, truth: dict[str, np.ndarray]) -> None:
    layer = gpd.read_file(field, layer="trajectory")
    assert list(layer.columns) == [*FIELDS, "geometry"]
    np.testing.assert_array_equal(layer.geometry.get_coordinates(include_z=True).to_numpy(), truth["xyz_m"])
    for name in ("scan", "t_s", "speed_mps"):
        np.testing.assert_array_equal(layer[name], truth[name])
    for name in ("roll_deg", "pitch_deg", "heading_deg"):
        np.testing.assert_allclose(layer[name], truth[name], atol=1e-9)
    for i, name in enumerate(FIELDS[9:15]):
        np.testing.assert_array_equal(layer[name], truth["sigma"][:, i])
    assert layer["motion"].tolist() == [Motion(m).name.lower() for m in truth["motion"]]
    assert [None if v != v else v for v in layer["fix"]] == [
        None if f == -1 else Fix(f).name.lower() for f in truth["fix"]
    ]
    assert layer["heading_from"].tolist() == ["gnss" if s % 2 == 0 else "antennas" for s in truth["scan"]]
    assert layer[["position_from", "height_from", "level_from"]].drop_duplicates().to_numpy().tolist() == [
        ["gnss", "ground", "assumed"]
    ]


def test_time__is_utc_to_the_millisecond_in_the_form_of_the_standard(field: Path, truth: dict[str, np.ndarray]) -> None:
    with closing(sqlite3.connect(field)) as database:
        texts = [row[0] for row in database.execute("SELECT time FROM trajectory ORDER BY scan")]
    epoch = dt.datetime(1970, 1, 1, tzinfo=dt.UTC)
    expected = [epoch + dt.timedelta(milliseconds=round(t * 1000)) for t in truth["t_s"].tolist()]
    assert texts[0] == "2026-06-11T01:23:40.300Z"
    assert [dt.datetime.fromisoformat(text) for text in texts] == expected


def test_layer__is_points_with_height_in_the_sessions_crs(field: Path) -> None:
    info = pyogrio.read_info(field, layer="trajectory")
    assert (info["geometry_type"], info["crs"], info["features"]) == ("Point Z", "EPSG:6677", 40)
    with closing(sqlite3.connect(field)) as database:
        assert database.execute("SELECT z, m FROM gpkg_geometry_columns").fetchall() == [(1, 0)]


def test_unknown_numbers__are_null(field: Path) -> None:
    with closing(sqlite3.connect(field)) as database:
        nulls = database.execute(
            "SELECT count(*) - count(speed_mps), count(*) - count(sigma_roll_deg), count(*) - count(sigma_e_m) "
            "FROM trajectory"
        ).fetchone()
    assert nulls == (1, 40, 0)


def test_style__is_stored_as_the_layers_own(field: Path) -> None:
    with closing(sqlite3.connect(field)) as database:
        rows = database.execute(
            "SELECT f_table_name, f_geometry_column, useAsDefault, styleQML FROM layer_styles"
        ).fetchall()
        contents = dict(database.execute("SELECT table_name, data_type FROM gpkg_contents"))
    default, *others = (row[:3] for row in rows)
    assert default == ("trajectory", "geom", 1)
    assert others == [("trajectory", "geom", 0)] * (len(LANGUAGES) - 1)
    assert all("<qgis" in row[3] for row in rows)
    assert "RTK fixed" in rows[0][3]
    assert "単独測位" in rows[LANGUAGES.index("ja")][3]
    assert contents == {"trajectory": "features", "layer_styles": "attributes"}


def test_custom_crs__is_kept(poses: ScanPoses, tmp_path: Path) -> None:
    own = CRS.from_proj4("+proj=tmerc +lat_0=36.87 +lon_0=140.02 +k=1 +x_0=20000 +y_0=100000 +ellps=GRS80 +units=m")
    write_field(tmp_path / "field.gpkg", poses, own)
    kept = CRS.from_user_input(pyogrio.read_info(tmp_path / "field.gpkg", layer="trajectory")["crs"])
    assert kept.equals(own, ignore_axis_order=True)


def test_no_poses__give_an_empty_layer(poses: ScanPoses, tmp_path: Path) -> None:
    arrays = {name: getattr(poses, name)[:0] for name in poses.__dataclass_fields__}
    write_field(tmp_path / "field.gpkg", ScanPoses(**arrays), JAPAN)
    assert list(pyogrio.read_dataframe(tmp_path / "field.gpkg", layer="trajectory").columns) == [*FIELDS, "geometry"]


def test_file__replaces_the_old_one_and_leaves_nothing_beside(field: Path, poses: ScanPoses) -> None:
    arrays = {name: getattr(poses, name)[:7] for name in poses.__dataclass_fields__}
    write_field(field, ScanPoses(**arrays), JAPAN)
    assert pyogrio.read_info(field, layer="trajectory")["features"] == 7
    assert [path.name for path in field.parent.iterdir()] == ["field.gpkg"]


def test_scan_poses__refuse_what_is_no_pose(poses: ScanPoses) -> None:
    xyz = poses.xyz_m.copy()
    xyz[3, 2] = np.nan
    with pytest.raises(ValueError, match="xyz_m"):
        replace(poses, xyz_m=xyz)
    with pytest.raises(ValueError, match="sigma"):
        replace(poses, sigma=poses.sigma[:, :3])
    with pytest.raises(ValueError, match="increase"):
        replace(poses, scan=poses.scan[::-1].copy())


def test_qgis__opens_the_layer_in_its_style_and_time(field: Path, qgis: QgisRoot) -> None:
    (layer,) = qgis.open_layers(field)
    assert (layer["valid"], layer["crs"], layer["count"], layer["renderer"]) == (
        True,
        "EPSG:6677",
        40,
        "categorizedSymbol",
    )
    assert layer["fields"] == ["fid", *FIELDS]
    told = qgis.run("python3", Path(__file__).with_name("temporal_in_qgis.py"), field)
    assert told.splitlines()[-1] == "True time FeatureDateTimeInstantFromField 7"


def test_file__that_differs_from_what_was_written_is_an_error(poses: ScanPoses, tmp_path: Path) -> None:
    """A disk that lost something on the way: the file is read back before it takes its place."""
    path = tmp_path / "field.gpkg"
    write_field(path, poses, JAPAN)
    _check(path, {"trajectory": 40})
    with pytest.raises(OSError, match=r"field\.gpkg differs from what was written \(ok; \{'trajectory': 40\} features"):
        _check(path, {"trajectory": 41})
    with closing(sqlite3.connect(path)) as database:
        database.execute("PRAGMA journal_mode = wal")
    with pytest.raises(OSError, match="journal wal"):
        _check(path, {"trajectory": 40})


def test_read_layer__gives_back_what_was_written_but_no_coordinates_that_are_none(
    poses: ScanPoses, tmp_path: Path
) -> None:
    path = tmp_path / "field.gpkg"
    write_field(path, poses, JAPAN)
    layer = read_layer(path, "trajectory")
    assert (layer.name, layer.kind, len(layer.shapes)) == ("trajectory", "2.5D Point", 40)
    assert list(layer.columns) == FIELDS
    np.testing.assert_allclose(shapely.get_coordinates(layer.shapes, include_z=True), poses.xyz_m)
    for odd in (np.nan, np.inf):
        shapes = layer.shapes.copy()
        shapes[3] = shapely.Point(odd, 1.0, 2.0)
        write_layer(tmp_path / f"{odd}.gpkg", replace(layer, shapes=shapes), JAPAN, indexed=False)
        with pytest.raises(ValueError, match="layer 'trajectory' has coordinates that are not finite"):
            read_layer(tmp_path / f"{odd}.gpkg", "trajectory")
