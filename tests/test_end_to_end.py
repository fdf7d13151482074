"""The whole way on the sample recordings, judged by the tools that lie beside them and by the simulated truth."""

from __future__ import annotations

import gzip
import importlib.util
import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

import geopandas as gpd
import laspy
import numpy as np
import pytest

import furrowmap
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.pipeline.run import run
from furrowmap.core.pipeline.run_result import RunResult
from furrowmap.core.pointclouds.placed_scans import PlacedScan
from furrowmap.core.session.opened import open_session

RunOnce = Callable[[str, Callable[[Path], Path]], furrowmap.Result]
TRACTORS = ("tractor_loop", "tractor_fishtail")
COUNTED = {"tractor_loop": (7_977_874, 599, 597), "tractor_fishtail": (7_807_777, 627, 625)}


class Gathered:
    """A sink that keeps what a test looks at."""

    def __init__(self) -> None:
        self.parts: list[tuple[np.ndarray, ...]] = []

    def __call__(
        self, frame: MapFrame, origin_m: tuple[float, float, float], frames: object
    ) -> Callable[[PlacedScan], None]:
        assert frame.crs.is_projected
        self.origin = np.asarray(origin_m)
        return self.add

    def add(self, placed: PlacedScan) -> None:
        scan = placed.scan
        self.parts.append((placed.xyz_m + self.origin, scan.t_s, scan.laser, scan.column))

    def columns(self) -> tuple[np.ndarray, ...]:
        return tuple(np.concatenate([part[i] for part in self.parts]) for i in range(4))


def session_folder(shared_data: Path, name: str, folder: Path, *, truth: bool, lidar: Path | None = None) -> Path:
    """The sample's session in a folder of its own, with the truth as its trajectory if asked for."""
    folder.mkdir(parents=True, exist_ok=True)
    for file in ("gnss.nmea", "boundary.geojson"):
        shutil.copy(shared_data / name / file, folder)
    if lidar is None:
        shutil.copy(shared_data / name / "recording.pcap.gz", folder)
    text = (shared_data / name / "session.toml").read_text()
    if lidar is not None:
        text = text.replace("recording.pcap.gz", lidar.name)
    if truth:
        shutil.copy(shared_data / name / "truth" / "trajectory.csv", folder)
        text += '\n[trajectory]\nfiles = ["trajectory.csv"]\n'
    (folder / "session.toml").write_text(text)
    return folder / "session.toml"


class Judge:
    """The samples' own tool, and the truth of one of them."""

    def __init__(self, shared_data: Path, name: str) -> None:
        self.tool = tool_module(shared_data, "evaluate")
        self.truth = self.tool.Truth(shared_data / name)
        self.gnss = self.tool.Gnss(shared_data / name, self.truth)

    def trajectory(self, result: Path) -> dict[str, Any]:
        found: dict[str, Any] = self.tool.judge_trajectory(result, self.truth, self.gnss)[0]
        return found

    def cloud(self, result: Path) -> dict[str, Any]:
        found: dict[str, Any] = self.tool.judge_cloud(result, self.truth)
        return found

    def surfaces(self, result: Path) -> dict[str, Any]:
        dsm: dict[str, Any] = self.tool.judge_dsm(result, self.truth)
        change: dict[str, Any] = self.tool.judge_change(result, self.truth)
        return {"dsm": dsm, **change}


def tool_module(shared_data: Path, name: str) -> ModuleType:
    """A tool that lies beside the samples, as a module."""
    path = shared_data.parent / "tools" / f"{name}.py"
    if not path.exists():
        pytest.skip(f"the samples' tool (../shared/tools/{path.name}) is not beside this checkout")
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def loop_by_the_truth(shared_data: Path, run_once: RunOnce) -> furrowmap.Result:
    """A drive by its true trajectory, of a session that states no implement."""

    def session_in(folder: Path) -> Path:
        session = session_folder(shared_data, "tractor_loop", folder, truth=True)
        session.write_text(re.sub(r"(?ms)^\[implement\].*?(?=^\[)", "", session.read_text()))
        return session

    return run_once("loop_by_the_truth", session_in)


def test_with_the_true_trajectory_the_ground_is_as_sharp_as_the_sensor(shared_data: Path, run_once: RunOnce) -> None:
    result = loop_by_the_truth(shared_data, run_once)
    judge = Judge(shared_data, "tractor_loop")
    ground = judge.cloud(result.path)["ground_raw"]
    assert ground["nmad_m"] <= 0.009
    assert ground["abs_p90_m"] <= 0.017
    assert abs(ground["median_m"]) <= 0.0015
    found = judge.trajectory(result.path)
    raw = found["raw"]
    assert raw["horizontal_rmse_m"] < 1e-4
    assert max(raw["roll_rmse_deg"], raw["pitch_rmse_deg"], raw["heading_rmse_moving_deg"]) < 1e-3
    assert found["motion_right_share"] > 0.99


@pytest.fixture(scope="module")
def by_the_truth(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[np.ndarray, ...]:
    """Places, times, lasers and columns of all points of a recording, placed by the true trajectory."""
    sink = Gathered()
    folder = tmp_path_factory.mktemp("truth")
    run(open_session(session_folder(shared_data, "tractor_fishtail", folder, truth=True)), sink)
    return sink.columns()


def test_residuals_show_no_trend_with_time_laser_or_azimuth(
    shared_data: Path, by_the_truth: tuple[np.ndarray, ...]
) -> None:
    name = "tractor_fishtail"
    xyz, t_s, laser, column = (values[::7] for values in by_the_truth)
    dz, used = against_the_surface_of_its_moment(shared_data / name, xyz, t_s)
    laser, column, time = laser[used], column[used], t_s[used] - t_s.min()

    assert len(np.unique(laser)) == 16
    for which in np.unique(laser):
        assert abs(np.median(dz[laser == which])) <= 0.006, f"laser {which}"
    for label, value, edges in (("time", time, np.arange(0, 60, 5)), ("column", column, np.arange(0, 1850, 150))):
        for low, high in pairwise(edges):
            chosen = (value >= low) & (value < high)
            if chosen.sum() > 2000:
                assert abs(np.median(dz[chosen])) <= 0.003, f"{label} {low} to {high}"
    slope = np.polyfit(time, np.clip(dz, -0.03, 0.03), 1)[0]
    assert abs(slope) * 60 <= 0.002


def against_the_surface_of_its_moment(data: Path, xyz: np.ndarray, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Heights above the simulated soil, and which points are ground within 10 m of the vehicle."""
    s = np.load(data / "truth" / "surface.npz")
    column = np.floor((xyz[:, 0] - s["e0"]) / s["cell_m"]).astype(int)
    row = np.floor((xyz[:, 1] - s["n0"]) / s["cell_m"]).astype(int)
    inside = (row >= 0) & (column >= 0) & (row < s["before"].shape[0]) & (column < s["before"].shape[1])
    truth = np.genfromtxt(data / "truth" / "trajectory.csv", delimiter=",", names=True)
    e, n = (np.interp(t_s, truth["time_unix_s"], truth[c]) for c in ("e_m", "n_m"))
    inside &= np.hypot(xyz[:, 0] - e, xyz[:, 1] - n) < 10
    row, column, time = row[inside], column[inside], t_s[inside] - s["t0_unix_s"]
    first, again = s["worked_time"][row, column], s["reworked_time"][row, column]
    last = np.where(np.isnan(again), first, again)
    final = np.isnan(first) | (time > last + 0.02)
    early = ~np.isnan(first) & (time < first - 0.02)
    surface = np.where(final, s["after"][row, column], s["before"][row, column])
    dz = xyz[inside, 2] - s["h0_m"] - surface
    ground = (final | early) & (np.abs(dz) < 0.10)
    return dz[ground], np.flatnonzero(inside)[ground]


def test_a_recording_cut_inside_a_packet_gives_all_up_to_the_cut(
    shared_data: Path, by_the_truth: tuple[np.ndarray, ...], tmp_path: Path
) -> None:
    name = "tractor_fishtail"
    whole = gzip.decompress((shared_data / name / "recording.pcap.gz").read_bytes())
    cut = tmp_path / "cut.pcap"
    cut.write_bytes(whole[: len(whole) // 3 // 1264 * 1264 + 700])
    session = session_folder(shared_data, name, tmp_path, truth=True, lidar=cut)
    part = Gathered()

    found: RunResult = run(open_session(session), part)

    xyz, t_s, *_ = part.columns()
    expected, moments, *_ = by_the_truth
    assert 0.25 * len(expected) < len(xyz) < 0.4 * len(expected)
    np.testing.assert_array_equal(t_s, moments[: len(t_s)])
    np.testing.assert_array_equal(xyz, expected[: len(xyz)])
    assert any("cut" in notice.text or "incomplete" in notice.text for notice in found.notices)


@dataclass(frozen=True)
class Judged:
    """What the samples' tool says of a run."""

    trajectory: dict[str, Any]
    cloud: dict[str, Any]
    surfaces: dict[str, Any]
    report: dict[str, Any]


@pytest.fixture(scope="module")
def judged(shared_data: Path, run_once: RunOnce) -> Callable[[str], Judged]:
    """A sample's run as its session says, one for all tests."""

    @cache
    def run_of(name: str) -> Judged:
        result = run_once(name, lambda folder: session_folder(shared_data, name, folder, truth=False))
        judge = Judge(shared_data, name)
        found = judge.trajectory(result.path), judge.cloud(result.path), judge.surfaces(result.path)
        return Judged(*found, dict(result.report))

    return run_of


@pytest.mark.parametrize(
    ("name", "roll_deg", "pitch_deg", "height_m"),
    [("tractor_loop", 0.04, 0.04, 0.004), ("tractor_fishtail", 0.05, 0.07, 0.005)],
)
def test_matching__gives_the_shape(
    judged: Callable[[str], Judged], name: str, roll_deg: float, pitch_deg: float, height_m: float
) -> None:
    """But for one height and one tilt of the whole session, which the scans cannot know."""
    shape = judged(name).trajectory["shape"]
    assert shape["roll_rms_deg"] <= roll_deg
    assert shape["pitch_rms_deg"] <= pitch_deg
    assert shape["antenna_height_rms_m"] <= height_m


@pytest.mark.parametrize("name", TRACTORS)
def test_matching__leaves_the_absolute_to_the_positions(judged: Callable[[str], Judged], name: str) -> None:
    found = judged(name).trajectory
    absolute, oracle = found["absolute"], found["oracle"]
    assert abs(absolute["offset_m"]) <= 1.2 * abs(oracle["offset_m"]) + 0.005
    assert absolute["tilt_deg"] <= 1.2 * oracle["tilt_deg"] + 0.05


def test_matching__with_better_positions_is_absolutely_better(shared_data: Path, tmp_path: Path) -> None:
    name = "tractor_fishtail"
    session = session_folder(shared_data, name, tmp_path / "recording", truth=False)
    shutil.copy(shared_data / name / "reference.nmea", session.with_name("gnss.nmea"))
    furrowmap.run(session, tmp_path / "result")
    judge = Judge(shared_data, name)
    absolute = judge.trajectory(tmp_path / "result")["absolute"]
    assert abs(absolute["offset_m"]) <= 0.010
    assert absolute["tilt_deg"] <= 0.1
    assert judge.surfaces(tmp_path / "result")["dsm"]["rmse_m"] <= 0.018


@pytest.mark.parametrize("name", TRACTORS)
def test_surfaces__show_the_tilled_soil_and_how_much_it_rose(judged: Callable[[str], Judged], name: str) -> None:
    found = judged(name)
    dsm, change = found.surfaces["dsm"], found.surfaces["change"]
    assert dsm["cell_m"] == 0.05
    assert dsm["shape_rmse_m"] <= 0.009
    assert dsm["tilled_share_shape"] >= 0.88
    assert dsm["worked_cells_with_value_share"] <= dsm["tilled_share_best_possible"] + 0.01  # nothing is guessed
    assert abs(change["volume_error_percent"]) <= 10.0
    assert abs(change["mean_change_on_untilled_cells_m"]) <= 0.003
    moved = found.report["figures"]["soil_moved"]
    assert moved["volume_m3"] == pytest.approx(change["volume_true_m3"], rel=0.1)
    assert abs(moved["volume_m3"] - change["volume_true_m3"]) <= 2.5 * moved["volume_sigma_m3"]
    assert moved["volume_sigma_m3"] <= 0.15 * moved["volume_m3"]
    assert abs(moved["beside_passes"]["mean_change_m"]) <= 0.003


@pytest.mark.parametrize(("name", "heading_deg"), [("tractor_loop", 0.12), ("tractor_fishtail", 0.25)])
def test_matching__gives_heading_and_place(judged: Callable[[str], Judged], name: str, heading_deg: float) -> None:
    run_of = judged(name)
    found = run_of.trajectory
    raw, oracle = found["raw"], found["oracle"]
    assert raw["heading_rmse_moving_deg"] <= heading_deg
    assert raw["horizontal_rmse_m"] <= np.hypot(oracle["gnss_x_rmse_m"], oracle["gnss_y_rmse_m"])
    assert found["scans_without_pose"] == 0
    assert found["motion_right_share"] > 0.95
    hard = {key for key in found if key.startswith(("outage", "float"))}
    assert len(hard) == (2 if name == "tractor_fishtail" else 0)
    for key in hard:
        assert found[key]["horizontal_rmse_m"] <= 0.04, key
    codes = {warning["code"] for warning in run_of.report["warnings"]}
    assert not codes & {"level-assumed", "gaps"}


@pytest.mark.parametrize("name", TRACTORS)
def test_matching__has_sigmas_that_cover_the_errors(judged: Callable[[str], Judged], name: str) -> None:
    for key, ratio in judged(name).trajectory["error_over_sigma"].items():
        assert ratio["rms_error_over_sigma"] < 1.5, key
        assert ratio["share_within_2_sigma"] > 0.85, key


@pytest.mark.parametrize("name", TRACTORS)
def test_cloud__has_every_return_at_its_time(judged: Callable[[str], Judged], name: str) -> None:
    found = judged(name)
    figures = found.report["figures"]
    assert found.cloud["points"] == figures["points"]
    assert (figures["points"], figures["scans"], figures["scans_whole"]) == COUNTED[name]
    assert found.cloud["ground_points_at_odd_times"] == 0
    assert found.report["clocks"]["lidar"][0]["clock"] == "sensor-gps"


@pytest.mark.parametrize("name", TRACTORS)
def test_matching__makes_the_ground_sharp_and_its_passes_meet(judged: Callable[[str], Judged], name: str) -> None:
    cloud = judged(name).cloud
    assert cloud["ground_shape"]["nmad_m"] <= 0.0085
    assert cloud["seams"]["all"]["abs_median_m"] <= 0.004


def test_a_scanner_stated_half_a_turn_wrong_comes_out_as_the_right_one(shared_data: Path, tmp_path: Path) -> None:
    """The first two passes and the turn between them show it."""
    session = session_folder(shared_data, "tractor_fishtail", tmp_path / "in", truth=False)
    text = session.read_text()
    assert "rpy_deg = [-0.6, 38.7, 181.2]" in text
    text = text.replace("rpy_deg = [-0.6, 38.7, 181.2]", "rpy_deg = [-0.6, 38.7, 1.2]")
    session.write_text(text.replace("[recording]\n", "[recording]\nto = 2026-06-11T02:00:13Z\n"))
    report = furrowmap.run(session, tmp_path / "out").report
    shape = Judge(shared_data, "tractor_fishtail").trajectory(tmp_path / "out")["shape"]
    assert shape["roll_rms_moving_deg"] <= 0.05
    assert shape["pitch_rms_moving_deg"] <= 0.07
    assert shape["heading_rms_moving_deg"] <= 0.15
    assert "mounting-off" in {warning["code"] for warning in report["warnings"]}
    assert report["figures"]["implement"]["transitions"] == 4
    assert report["figures"]["passes"] == 2


def rover_session(shared_data: Path, folder: Path, *, poses: bool) -> Path:
    folder.mkdir(parents=True)
    for file in ("leo_rover_vlp16.pcap.gz", "gnss.nmea", "reference_poses.csv"):
        shutil.copy(shared_data / "rover_real" / file, folder)
    text = (
        'furrowmap = 1\nname = "rover"\n[recording]\nlidar = ["leo_rover_vlp16.pcap.gz"]\ngnss = ["gnss.nmea"]\n'
        '[crs]\nmap = "EPSG:32634"\n'
    )
    places = "[antenna]\nxyz_m = [0, 0, 0]\n[lidar]\nxyz_m = [0, 0, 0]\nrpy_deg = [0, 0, 0]\n"
    (folder / "session.toml").write_text(
        text + ('[trajectory]\nfiles = ["reference_poses.csv"]\n' if poses else places)
    )
    return folder / "session.toml"


@pytest.fixture(scope="module")
def rover(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The products and the report of the real drive by its GNSS log alone."""
    folder = tmp_path_factory.mktemp("rover")
    return folder / "out", furrowmap.run(rover_session(shared_data, folder / "in", poses=False), folder / "out").report


def rover_spread(shared_data: Path, products: Path) -> tuple[float, int]:
    """How thick the ground is within 6 m of the track, and in how many cells."""
    las = laspy.read(products / "cloud.copc.laz")
    track = gpd.read_file(products / "field.gpkg", layer="trajectory")
    index = np.full((int(las["scan"].max()) + 1, 2), np.nan)
    index[track["scan"]] = np.column_stack([track.geometry.x, track.geometry.y])
    spread = tool_module(shared_data, "ground_spread").spread
    median, _, cells = spread(
        np.asarray(las.x), np.asarray(las.y), np.asarray(las.z), np.asarray(las["scan"]).astype(int), 6.0, index
    )
    return median, cells


def test_a_real_drive(shared_data: Path, rover: tuple[Path, dict[str, Any]]) -> None:
    """The scanner faces backwards, which the session does not state."""
    products, report = rover
    median, cells = rover_spread(shared_data, products)
    assert median <= 0.005
    assert cells > 10_000
    assert report["figures"]["points_read"] == 5_395_453
    codes = {warning["code"] for warning in report["warnings"]}
    assert {"clock-recorder", "mounting-off"} <= codes
    assert not {"level-assumed", "clock-offset", "antenna-unknown"} & codes


def test_a_real_drive_by_its_reference_poses(shared_data: Path, run_once: RunOnce) -> None:
    """As it stands the ground is 3.3 cm thick, with the scanner turned round and levelled to them 0.8 cm."""
    result = run_once("rover", lambda folder: rover_session(shared_data, folder, poses=True))
    report = result.report
    median, cells = rover_spread(shared_data, result.path)
    assert median <= 0.035
    assert cells > 10_000
    assert report["figures"]["points_read"] == 5_395_453
    codes = {warning["code"] for warning in report["warnings"]}
    assert {"clock-recorder", "mounting-identity"} <= codes
    assert not {"antenna-unknown", "mounting-off", "level-assumed", "clock-offset"} & codes


def test_a_real_drive_leans_as_its_reference_says(shared_data: Path, rover: tuple[Path, dict[str, Any]]) -> None:
    """But for one roll and one pitch: how the reference's body frame lies against the scanner's nobody states."""
    track = gpd.read_file(rover[0] / "field.gpkg", layer="trajectory")
    reference = np.genfromtxt(shared_data / "rover_real" / "reference_poses.csv", delimiter=",", names=True)
    t = reference["time_unix_s"]
    inside = track[(track["t_s"] > t[0]) & (track["t_s"] < t[-1])]
    assert len(inside) > 200
    for angle in ("roll_deg", "pitch_deg"):
        off = inside[angle].to_numpy() - np.interp(inside["t_s"], t, reference[angle])
        off -= off.mean()
        ratio = np.abs(off) / inside[f"sigma_{angle}"].to_numpy()
        assert off.std() <= 0.35, angle
        assert np.diff(off).std() <= 0.12, angle
        assert np.sqrt((ratio**2).mean()) < 1.5, angle
        assert (ratio < 2.0).mean() > 0.85, angle
