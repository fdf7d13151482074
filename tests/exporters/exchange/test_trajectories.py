"""Trajectories in formats of navigation software against geodesy done otherwise, and read again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS, Geod, Transformer
from scipy.spatial.transform import Rotation

from furrowmap import open_result
from furrowmap.core.readers.poses.csv import PoseCsv
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.runtime.errors import RefusedError, UsageError
from furrowmap.exporters.exchange.trajectories import velocity_mps
from furrowmap.workflows.share.export import export
from tests.exporters.farm.result_folders import write_result


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    # EPSG:32652 is far from its middle meridian there: grid north is two degrees off true north
    return write_result(tmp_path_factory.mktemp("trajectories") / "result", crs=CRS.from_epsg(32652))


def test_sbet__has_true_headings_and_speeds(result: Path, tmp_path: Path) -> None:
    done = export([result], "sbet", tmp_path / "flight.sbet")
    assert [path.name for path in done.files] == ["flight.sbet"]
    records = np.fromfile(done.target, "<f8").reshape(-1, 17)
    layer = open_result(result).layer("trajectory").sort_values("t_s")
    assert len(records) == len(layer)
    utc = layer["t_s"].to_numpy()
    week = 604_800 * ((utc[0] + 18 - 315_964_800) // 604_800)
    assert records[:, 0] == pytest.approx(utc + 18 - 315_964_800 - week, abs=1e-5)
    lat, lon = np.degrees(records[:, 1:3]).T
    east, north = Transformer.from_crs(4326, 32652, always_xy=True).transform(lon, lat)
    assert np.column_stack([east, north]) == pytest.approx(
        np.column_stack([layer.geometry.x, layer.geometry.y]), abs=1e-4
    )
    assert records[:, 3] == pytest.approx(layer.geometry.z.to_numpy())
    ahead = np.radians(layer["heading_deg"].to_numpy())
    there = Transformer.from_crs(32652, 4326, always_xy=True).transform(
        layer.geometry.x.to_numpy() + 10.0 * np.sin(ahead), layer.geometry.y.to_numpy() + 10.0 * np.cos(ahead)
    )
    geod = Geod(ellps="WGS84")
    azimuth, _, _ = geod.inv(lon, lat, *there)
    off = np.degrees(records[:, 9] - records[:, 10]) - azimuth
    assert np.abs((off + 180.0) % 360.0 - 180.0).max() < 1e-4
    assert np.degrees(records[:, 7:9]) == pytest.approx(layer[["roll_deg", "pitch_deg"]].to_numpy())
    course, _, way = geod.inv(lon[:-2], lat[:-2], lon[2:], lat[2:])
    speed = way / (utc[2:] - utc[:-2])
    moving = speed > 0.5
    seen = records[1:-1, 4:6][moving]
    assert np.hypot(*seen.T) == pytest.approx(speed[moving], rel=0.02)
    turned = np.degrees(np.arctan2(seen[:, 1], seen[:, 0])) - course[moving]
    assert np.abs((turned + 180.0) % 360.0 - 180.0).max() < 2.0


def test_tum__turns_the_vehicles_axes_to_those_of_the_map(result: Path, tmp_path: Path) -> None:
    table = np.loadtxt(export([result], "tum", tmp_path / "flight.tum").target)
    layer = open_result(result).layer("trajectory").sort_values("t_s")
    assert table[:, 1:4] == pytest.approx(layer.geometry.get_coordinates(include_z=True).to_numpy(), abs=1e-5)
    ahead = Rotation.from_quat(table[:, 4:]).apply([1.0, 0.0, 0.0])
    heading, pitch = np.radians(layer["heading_deg"]), np.radians(layer["pitch_deg"])
    assert ahead[:, 2] == pytest.approx(np.sin(pitch), abs=1e-6)
    assert ahead[:, :2] == pytest.approx(
        np.column_stack([np.sin(heading), np.cos(heading)]) * np.cos(pitch).to_numpy()[:, None], abs=1e-6
    )


def test_poses__are_read_again(result: Path, tmp_path: Path) -> None:
    track = PoseCsv([export([result], "poses", tmp_path / "flight.csv").target], ReadOptions()).poses()
    layer = open_result(result).layer("trajectory").sort_values("t_s")
    assert track.t_s == pytest.approx(layer["t_s"].to_numpy(), abs=1e-6)
    assert track.roll_deg == pytest.approx(layer["roll_deg"].to_numpy(), abs=1e-6)


def test_sbet__is_refused_with_other_heights_and_with_layers(tmp_path: Path, result: Path) -> None:
    above = write_result(tmp_path / "geoid", heights="EGM2008")
    with pytest.raises(RefusedError, match="above EGM2008") as error:
        export([above], "sbet", tmp_path / "wrong.sbet")
    assert error.value.code == "sbet-heights"
    assert not (tmp_path / "wrong.sbet").exists()
    assert export([above], "tum").target == tmp_path / "geoid_tum.tum"
    with pytest.raises(UsageError):
        export([result], "poses", layers=["passes"])


def test_velocity__is_the_derivative_of_the_place_and_nothing_for_one_pose() -> None:
    """Over a tenth of a degree along a parallel and a meridian, against the lengths of PROJ's geodesics."""
    t = np.linspace(0.0, 10.0, 11)
    lon, lat = 140.0 + 0.001 * t, 36.0 - 0.002 * t
    height, geod = 50.0 + 0.3 * t, Geod(ellps="GRS80")
    found = velocity_mps(t, np.column_stack([lon, lat]), height, geod)
    north = -geod.inv(140.0, 36.0, 140.0, 35.98)[2] / 10.0
    east = geod.inv(140.0, 35.99, 140.01, 35.99)[2] / 10.0
    above = 1.0 + 51.5 / 6.37e6  # ways are longer at the height of the middle
    np.testing.assert_allclose(found[5], [above * north, above * east, -0.3], rtol=1e-6)
    assert found.shape == (11, 3)
    across = velocity_mps(t, np.column_stack([(lon + 39.995 + 180.0) % 360.0 - 180.0, lat]), height, geod)
    np.testing.assert_allclose(across, found, rtol=1e-9)  # the antimeridian is no jump
    assert velocity_mps(t[:1], np.column_stack([lon, lat])[:1], height[:1], geod).tolist() == [[0.0, 0.0, 0.0]]
