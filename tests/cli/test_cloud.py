from __future__ import annotations

import json
from pathlib import Path

import laspy
import numpy as np
import pyproj
import pytest
from scipy.spatial import cKDTree

from furrowmap.cli.main import command_line
from furrowmap.core.pointclouds import cleaning as cloud_cleaning
from furrowmap.core.surfaces.ground_filter import classify_ground

WEST, SOUTH = 500_000.0, 5_300_000.0


def call(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    status = command_line([str(word) for word in arguments])
    captured = capsys.readouterr()
    return status, captured.out, captured.err


def table(path: Path) -> np.ndarray:
    """Every point with all it carries, in one order."""
    las = laspy.read(path)
    names = ["intensity", "return_number", "number_of_returns", "classification", "point_source_id", "gps_time"]
    rows = np.column_stack([las.xyz.round(4), *(las[name] for name in [*names, "red", "green", "blue"])])
    return rows[np.lexsort(rows.T[::-1])]


def field(path: Path, corner: float, seed: int, software: str = "a program") -> Path:
    """30 by 20 m of gentle soil that begins at `corner`, with boxes of 2 m on it, and 15 points alone in the air."""
    chance = np.random.default_rng(seed)
    n = 12_000
    x, y = chance.uniform(corner, corner + 30, n), chance.uniform(0, 20, n)
    box = (np.floor(x / 2) % 5 == 1) & (np.floor(y / 2) % 4 == 1)
    z = 100 + 0.02 * x + np.where(box, 2.0, 0.0)
    x[:15], y[:15] = chance.permutation(np.arange(15)) * 2.0 + corner + 0.5, chance.uniform(0, 20, 15)
    z[:15] = 130 + 5.0 * np.arange(15)
    header = laspy.LasHeader(version="1.4", point_format=7)
    header.scales, header.offsets = np.full(3, 0.001), np.array([WEST, SOUTH, 0])
    header.generating_software = software
    header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
    header.add_crs(pyproj.CRS.from_epsg(32633))
    las = laspy.LasData(header)
    las.x, las.y, las.z = WEST + x, SOUTH + y, z
    las.gps_time = 4.6e8 + np.arange(n) * 0.25
    las.intensity = chance.integers(0, 65_536, n)
    las.number_of_returns = chance.integers(1, 6, n)
    las.return_number = np.minimum(chance.integers(1, 6, n), las.number_of_returns)
    las.point_source_id = np.full(n, seed)
    las.classification = np.where(np.arange(n) < 15, 1, np.where(np.arange(n) % 100 == 0, 64, 5)).astype(np.uint8)
    las.red, las.green, las.blue = chance.integers(0, 65_536, (3, n))
    las.write(path)
    return path


@pytest.fixture(scope="module")
def clouds(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two files side by side across the border of a block of 128 m (500,096)."""
    folder = tmp_path_factory.mktemp("clouds")
    return [field(folder / "west.laz", 70.0, 1), field(folder / "east.las", 100.0, 2)]


def sources(clouds: list[Path]) -> np.ndarray:
    rows = np.concatenate([table(path) for path in clouds])
    return rows[np.lexsort(rows.T[::-1])]


CLASS = 6
"""Column of the class in a table."""


def test_cloud__passes_everything_on(clouds: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = call(capsys, "cloud", *clouds, "-o", tmp_path / "all.copc.laz", "--json")
    assert status == 0
    answer = json.loads(out)
    assert answer["figures"]["points"] == answer["figures"]["points_read"] == 24_000
    assert answer["warnings"] == []
    np.testing.assert_array_equal(table(tmp_path / "all.copc.laz"), sources(clouds))
    with laspy.CopcReader.open(tmp_path / "all.copc.laz") as reader:
        assert reader.header.parse_crs().to_epsg() == 32633
        words = next(vlr for vlr in reader.header.vlrs if vlr.record_id == 3).record_data_bytes().decode()
    assert all(f"{record['name']} sha256:{record['sha256']}" in words for record in answer["inputs"])
    assert "OUTLIERS: none" in words


def test_cloud__ground_and_noise(clouds: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Told of all at once by the same filters, and by how the field was made; block by block nothing differs."""
    made = tmp_path / "clean.copc.laz"
    arguments = ["cloud", *clouds, "-o", made, "--outliers", "radius", "--ground", "smrf", "--json"]
    status, out, _ = call(capsys, *arguments)
    assert status == 0
    before, after = sources(clouds), table(made)
    places = [0, 1, 2, 8]
    assert np.array_equal(np.delete(before, CLASS, 1)[:, places], np.delete(after, CLASS, 1)[:, places])
    alone = before[:, 2] > 120
    tree = cKDTree(before[:, :3] - before[0, :3])
    lonely = np.array([len(near) < 4 for near in tree.query_ball_point(before[:, :3] - before[0, :3], 0.5)])
    assert lonely[alone].all()
    assert np.array_equal(after[:, CLASS] == 7, lonely)
    ground = np.zeros(len(before), bool)
    ground[~lonely] = classify_ground(before[~lonely, :3])
    assert np.array_equal(after[:, CLASS] == 2, ground)
    soil = np.abs(before[:, 2] - 100 - 0.02 * (before[:, 0] - WEST)) < 0.01
    assert np.mean(ground[soil & ~lonely]) > 0.99
    assert not ground[~soil].any()
    assert json.loads(out)["figures"]["points_by_class"] == {
        str(number): int(np.sum(after[:, CLASS] == number)) for number in (1, 2, 7)
    }
    again = tmp_path / "again.copc.laz"
    assert call(capsys, *arguments[:3], "-o", again, *arguments[5:])[0] == 0
    assert np.array_equal(laspy.read(again).points.array, laspy.read(made).points.array)


@pytest.mark.parametrize("outliers", ["radius", "statistical"])
def test_cloud__small_blocks_make_no_difference(
    clouds: list[Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    outliers: str,
) -> None:
    options = ["--outliers", outliers, "--ground", "smrf", "--voxel", "0.3"]
    assert call(capsys, "cloud", *clouds, "-o", tmp_path / "large.copc.laz", *options)[0] == 0
    monkeypatch.setattr(cloud_cleaning, "BLOCK_POINTS", 1)
    assert call(capsys, "cloud", *clouds, "-o", tmp_path / "small.copc.laz", *options)[0] == 0
    assert np.array_equal(table(tmp_path / "large.copc.laz"), table(tmp_path / "small.copc.laz"))


def test_cloud__drops_noise_and_classes_and_what_lies_outside(
    clouds: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    box = f"{WEST + 80},{SOUTH + 5},{WEST + 110},{SOUTH + 15}"
    made = tmp_path / "part.copc.laz"
    status, _, _ = call(
        capsys,
        *("cloud", *clouds, "-o", made, "--outliers", "statistical", "--drop-noise"),
        *("--without-class", "64,65", "--bbox", box),
    )
    assert status == 0
    before, after = sources(clouds), table(made)
    inside = (before[:, 0] >= WEST + 80) & (before[:, 0] <= WEST + 110) & (before[:, 1] >= SOUTH + 5)
    wanted = before[inside & (before[:, 1] <= SOUTH + 15) & (before[:, CLASS] != 64)]
    kept = {tuple(row) for row in after}
    assert kept < {tuple(row) for row in wanted}
    assert after[:, 2].max() < 120 < wanted[:, 2].max()
    assert len(after) > 0.9 * len(wanted)


def test_cloud__one_point_a_cube_is_the_nearest_to_its_middle(
    clouds: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = tmp_path / "thin.copc.laz"
    assert call(capsys, "cloud", *clouds, "-o", made, "--voxel", "0.7")[0] == 0
    before, after = sources(clouds)[:, :3], table(made)[:, :3]
    cube = np.floor(after / 0.7)
    assert len(np.unique(cube, axis=0)) == len(after) == len(np.unique(np.floor(before / 0.7), axis=0))
    nearest: dict[tuple[float, ...], float] = {}
    for place, away in zip(np.floor(before / 0.7), np.linalg.norm(before / 0.7 % 1 - 0.5, axis=1), strict=True):
        nearest[tuple(place)] = min(nearest.get(tuple(place), 9.0), away)
    away = np.linalg.norm(after / 0.7 % 1 - 0.5, axis=1)
    np.testing.assert_allclose(away, [nearest[tuple(place)] for place in cube], atol=1e-5)


def test_cloud__every_nth_across_files(clouds: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(capsys, "cloud", *clouds, "-o", tmp_path / "few.copc.laz", "--every", "7")[0] == 0
    places = np.concatenate([laspy.read(path).xyz for path in clouds])[::7].round(4)
    assert {tuple(row) for row in table(tmp_path / "few.copc.laz")[:, :3]} == {tuple(row) for row in places}


def test_cloud__machine_of_our_own_clouds_is_never_ground(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    own = field(tmp_path / "own.laz", 0.0, 3, software="furrowmap 1")
    assert call(capsys, "cloud", own, "-o", tmp_path / "o.copc.laz", "--ground", "smrf")[0] == 0
    before, after = sources([own]), table(tmp_path / "o.copc.laz")
    assert np.array_equal(after[:, CLASS] == 64, before[:, CLASS] == 64)


def test_cloud__of_feet_moves_and_says_what_is_lost(
    shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = shared_data / "las" / "good" / "las12_pf3_autzen_trim.laz"
    made = tmp_path / "autzen.copc.laz"
    status, _, err = call(capsys, "cloud", source, "-o", made)
    assert (status, len(err.splitlines())) == (3, 3)
    assert not made.exists()
    marked = ["--outliers", "statistical", "--ground", "smrf"]  # some squares hold nothing but what is alone
    status, out, _ = call(
        capsys, "cloud", source, "-o", made, "--dst-crs", "EPSG:32610", "--every", "20", "--json", *marked
    )
    assert status == 0
    answer = json.loads(out)
    there, here = laspy.read(source), laspy.read(made)
    assert len(here.points) == answer["figures"]["points"] == -(-len(there.points) // 20)
    heights, colours = np.sort(there.z[::20]) * 0.3048, np.sort(there.red[::20])
    np.testing.assert_allclose(np.sort(here.z), heights, atol=0.001)
    assert np.array_equal(np.sort(here.red), colours)
    assert "heights-in-feet" in {warning["code"] for warning in answer["warnings"]}
    assert "times-of-week-lost" not in {warning["code"] for warning in answer["warnings"]}
    assert here.header.global_encoding.gps_time_type == laspy.header.GpsTimeType.WEEK_TIME
    np.testing.assert_array_equal(np.sort(here.gps_time), np.sort(there.gps_time[::20]))


def test_cloud__times_of_a_week_beside_named_days_are_lost_and_reported(
    clouds: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    las = laspy.read(clouds[0])
    las.header.global_encoding.gps_time_type = laspy.header.GpsTimeType.WEEK_TIME
    las.gps_time = np.arange(len(las.points)) * 0.01
    las.write(tmp_path / "week.laz")
    made = tmp_path / "both.copc.laz"
    status, out, _ = call(capsys, "cloud", tmp_path / "week.laz", clouds[1], "-o", made, "--json")
    assert status == 0
    assert [warning["code"] for warning in json.loads(out)["warnings"]] == ["times-of-week-lost"]
    here = laspy.read(made)
    assert here.header.global_encoding.gps_time_type == laspy.header.GpsTimeType.STANDARD
    assert np.count_nonzero(here.gps_time == 0.0) == len(las.points)


@pytest.mark.parametrize(
    ("arguments", "status", "word"),
    [
        (["-o", "cloud.las"], 2, "cloud.copc.laz"),
        (["-o", "there.laz"], 4, "--overwrite"),
        (["-o", "o.laz", "--voxel", "0"], 2, "voxel"),
        (["-o", "o.laz", "--without-class", "machine"], 2, "numbers"),
        (["-o", "o.laz", "--bbox", "0,0,1,1"], 3, "is selected"),
        (["-o", "o.laz", "--ground", "class"], 2, "ground"),
    ],
)
def test_cloud__wrong_arguments_are_told_and_nothing_is_written(
    clouds: list[Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    status: int,
    word: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("there.laz").write_bytes(b"there")
    answer, out, err = call(capsys, "cloud", *clouds, *arguments)
    assert (answer, out) == (status, "")
    assert len(err.splitlines()) == 3
    assert word in err
    assert [path.name for path in tmp_path.iterdir()] == ["there.laz"]
    assert Path("there.laz").read_bytes() == b"there"


def test_cloud__never_replaces_what_it_reads(clouds: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    before = clouds[0].read_bytes()
    status, _, err = call(capsys, "cloud", clouds[0], "-o", clouds[0], "--overwrite")
    assert (status, len(err.splitlines())) == (4, 3)
    assert clouds[0].read_bytes() == before
