"""Whole recordings: everything fits together, in the file formats of the samples."""

from __future__ import annotations

import gzip
import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import geopandas as gpd
import msgspec
import numpy as np
import pandas as pd
import pyogrio
import pytest
import velodyne_decoder as vd
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.session.session_file import load_session
from furrowmap.core.simulator.scenario import (
    Noise,
    Scenario,
    ScenarioDrive,
    ScenarioField,
    ScenarioLidar,
    load_scenario,
)
from furrowmap.core.simulator.simulate import Simulated, simulate
from tests.core.simulator.conftest import SHORT


def placed(folder: Path, recording: Path, rpy_deg: Any, xyz_m: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(xyz (n, 3) on the map, times) of all returns, placed by the truth alone."""
    truth = pd.read_csv(folder / "truth" / "trajectory.csv")
    columns = ["e_m", "n_m", "h_m", "roll_deg", "pitch_deg", "heading_deg"]
    config = vd.Config(model=vd.Model.VLP16, min_range=0.0, max_range=200.0)
    first = json.loads((folder / "truth" / "figures.json").read_text())["lidar"]["first_firing_unix_s"]
    mount = Rotation.from_euler("ZYX", np.asarray(rpy_deg)[::-1], degrees=True)
    found, times, hour = [], [], np.floor(first / 3600.0) * 3600.0
    for stamp, scan in vd.read_pcap(recording, config, as_pcl_structs=True):
        device = hour + stamp.device % 3600.0
        device += 3600.0 * (device < first - 1800.0)
        t = device + scan["time"].astype(np.float64)
        at = np.column_stack([np.interp(t, truth.time_unix_s, truth[c]) for c in columns])
        turn = Rotation.from_euler("ZYX", np.column_stack([90.0 - at[:, 5], -at[:, 4], at[:, 3]]), degrees=True)
        vehicle = mount.apply(np.column_stack([scan["x"], scan["y"], scan["z"]]).astype(np.float64)) + xyz_m
        found.append(turn.apply(vehicle) + at[:, :3])
        times.append(t)
    return np.concatenate(found), np.concatenate(times)


def above_the_surface(folder: Path, xyz: NDArray[np.float64], t_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Heights of points near the ground of their moment, nan where there is none."""
    with np.load(folder / "truth" / "surface.npz") as s:
        col = np.floor((xyz[:, 0] - s["e0"]) / s["cell_m"]).astype(int)
        row = np.floor((xyz[:, 1] - s["n0"]) / s["cell_m"]).astype(int)
        inside = (row >= 0) & (col >= 0) & (row < s["before"].shape[0]) & (col < s["before"].shape[1])
        row, col = np.where(inside, row, 0), np.where(inside, col, 0)
        first, again = s["worked_time"][row, col], s["reworked_time"][row, col]
        last = np.where(np.isnan(again), first, again)
        since = t_s - s["t0_unix_s"]
        early, final = ~(since >= first - 0.03), np.isnan(first) | (since > last + 0.03)
        z = np.where(final, s["after"][row, col], s["before"][row, col]) + s["h0_m"]
    height = xyz[:, 2] - z
    return np.where(inside & (early | final) & (np.abs(height) < 0.25), height, np.nan)


def spread(values: NDArray[np.float64]) -> float:
    return float(1.4826 * np.nanmedian(np.abs(values - np.nanmedian(values))))


def test_simulate__returns_lie_on_the_ground_of_their_moment(short_drive: Simulated) -> None:
    lidar = short_drive.scenario.lidar
    xyz, t_s = placed(short_drive.folder, short_drive.recording, lidar.rpy_deg, lidar.xyz_m)
    height = above_the_surface(short_drive.folder, xyz, t_s)
    assert np.isfinite(height).mean() > 0.5
    assert abs(np.nanmedian(height)) < 0.0015
    assert 0.006 < spread(height) < 0.010
    parts = np.array_split(height, 5)
    assert np.ptp([np.nanmedian(part) for part in parts]) < 0.001  # no trend with time, across the end of the hour


def test_simulate__the_stated_mounting_may_be_wrong(tmp_path: Path) -> None:
    lidar = ScenarioLidar(start_s=0.3, rpy_deg=(0.0, 40.0, 180.0), true_rpy_deg=(0.0, 41.0, 180.0), laser_bias_m=0.0)
    noise = Noise(range_m=0.002, dropout=0.0, dust=0.0)
    made = simulate(msgspec.structs.replace(SHORT, lidar=lidar, noise=noise), tmp_path / "wrong")
    session = load_session(made.session)
    assert session.lidar.rpy_deg == (0.0, 40.0, 180.0)
    spreads = [
        spread(above_the_surface(made.folder, *placed(made.folder, made.recording, rpy, lidar.xyz_m)))
        for rpy in (lidar.true_rpy_deg, lidar.rpy_deg)
    ]
    assert spreads[0] < 0.007
    assert spreads[1] > 3.0 * spreads[0]


def test_simulate__worked_area_is_that_of_the_swept_rectangle(tmp_path: Path) -> None:
    drive = ScenarioDrive(passes=1, pass_m=(3.0,), wander_m=0.0, accel_mps2=2.0, stand_start_s=0.2, stand_end_s=0.1)
    made = simulate(msgspec.structs.replace(SHORT, drive=drive), tmp_path / "straight")
    worked = made.folder / "truth" / "worked.gpkg"
    passes = gpd.read_file(worked, layer="passes")
    assert len(passes) == 1
    row = passes.iloc[0]
    assert row.area_m2 == pytest.approx(1.70 * row.length_m, rel=1e-6)
    assert row.area_m2 == pytest.approx(row.geometry.area)
    assert row.geometry.minimum_rotated_rectangle.area == pytest.approx(row.area_m2, rel=1e-6)
    with np.load(made.folder / "truth" / "surface.npz") as surface:
        cells = np.isfinite(surface["worked_time"]).sum() * float(surface["cell_m"]) ** 2
    assert cells == pytest.approx(row.area_m2, rel=0.02)


def test_simulate__writes_the_files_of_the_samples(short_drive: Simulated, shared_data: Path) -> None:
    sample = shared_data / "tractor_loop"
    ours = {str(f.relative_to(short_drive.folder)) for f in short_drive.folder.rglob("*")}
    theirs = {str(f.relative_to(sample)).removesuffix(".gz") for f in sample.rglob("*")}
    assert ours == theirs
    for name in ("trajectory.csv", "implement.csv"):
        head = (sample / "truth" / name).read_text().splitlines()[0]
        assert (short_drive.folder / "truth" / name).read_text().splitlines()[0] == head
    with np.load(sample / "truth" / "surface.npz") as a, np.load(short_drive.folder / "truth" / "surface.npz") as b:
        assert {k: v.dtype for k, v in a.items()} == {k: v.dtype for k, v in b.items()}

    def shape(value: object) -> object:
        return {k: shape(v) for k, v in value.items()} if isinstance(value, dict) else type(value)

    assert shape(short_drive.figures) == shape(json.loads((sample / "truth" / "figures.json").read_text()))
    for layer, kind in pyogrio.list_layers(sample / "truth" / "worked.gpkg"):
        a_, b_ = (pyogrio.read_info(f / "truth" / "worked.gpkg", layer=layer) for f in (sample, short_drive.folder))
        assert list(a_["fields"]) == list(b_["fields"])
        assert list(a_["dtypes"]) == list(b_["dtypes"])
        assert kind == b_["geometry_type"]
        assert a_["crs"] == b_["crs"]


def test_simulate__session_is_furrowmaps_own(short_drive: Simulated) -> None:
    session = load_session(short_drive.session)
    assert session.name == 'A short "drive"'
    assert session.recording.lidar == ("recording.pcap",)
    assert session.antenna is not None
    assert session.antenna.xyz_m == short_drive.scenario.antenna.xyz_m
    field = gpd.read_file(short_drive.folder / "boundary.geojson").to_crs("EPSG:6677")
    assert field.area.iloc[0] == pytest.approx(short_drive.figures["field_area_m2"], rel=1e-3)
    passes = gpd.read_file(short_drive.folder / "truth" / "worked.gpkg", layer="passes")
    assert field.geometry.iloc[0].contains(passes.geometry.iloc[0])


def test_simulate__written_scenario_makes_the_same_bytes(short_drive: Simulated, tmp_path: Path) -> None:
    again = simulate(load_scenario(short_drive.folder / "scenario.toml"), tmp_path / "again")

    def digests(folder: Path) -> dict[str, str]:
        files = (f for f in sorted(folder.rglob("*")) if f.is_file())
        return {str(f.relative_to(folder)): hashlib.sha256(f.read_bytes()).hexdigest() for f in files}

    assert digests(again.folder) == digests(short_drive.folder)


def test_simulate__another_seed_without_a_receiver_packed(short_drive: Simulated, tmp_path: Path) -> None:
    lidar = ScenarioLidar(start_s=0.3, gzip=True, position_packets=False)
    other = simulate(msgspec.structs.replace(SHORT, seed=6, lidar=lidar), tmp_path / "other")
    assert other.recording.name == "recording.pcap.gz"
    assert load_session(other.session).recording.lidar == ("recording.pcap.gz",)
    raw, first = gzip.decompress(other.recording.read_bytes()), short_drive.recording.read_bytes()
    packets = other.figures["lidar"]["data_packets"]
    assert packets == short_drive.figures["lidar"]["data_packets"]
    assert len(raw) == 24 + packets * (16 + 1248)
    assert raw[:24] == first[:24]
    assert raw[24 + 16 :][:1248] != first[24 + 16 :][:1248]


def test_simulate__refuses_a_place_outside_its_map(tmp_path: Path) -> None:
    place = msgspec.structs.replace(SHORT.place, crs="EPSG:4326")
    with pytest.raises(InputError, match="projected"):
        simulate(msgspec.structs.replace(SHORT, place=place), tmp_path / "degrees")


def first_seconds(recording: Path, scans: int) -> Iterator[NDArray[Any]]:
    config = vd.Config(model=vd.Model.VLP16, min_range=0.0, max_range=200.0)
    for number, (_, scan) in enumerate(vd.read_pcap(recording, config, as_pcl_structs=True)):
        if number == scans:
            return
        if number:  # the first one is cut
            yield scan


def test_simulate__returns_are_distributed_as_in_the_sample(shared_data: Path, tmp_path: Path) -> None:
    """The first pass of tractor_loop, which another simulator made of the same scenario."""
    sample = shared_data / "tractor_loop"
    theirs = tmp_path / "theirs.pcap"
    with gzip.open(sample / "recording.pcap.gz") as packed:
        theirs.write_bytes(packed.read(9_000_000))
    scenario = load_scenario(sample / "scenario.toml")
    drive = msgspec.structs.replace(
        scenario.drive, lanes_m=(0.0,), pass_m=(9.0,), speed_factors=(1.0,), stops=(), passes=1
    )
    ours = simulate(msgspec.structs.replace(scenario, drive=drive), tmp_path / "ours").recording
    edges = [0.0, 1.2, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 14.0]
    counts = {}
    for recording in (theirs, ours):
        scans = np.concatenate(list(first_seconds(recording, 80)))
        r = np.sqrt(scans["x"].astype(float) ** 2 + scans["y"].astype(float) ** 2 + scans["z"].astype(float) ** 2)
        counts[recording] = np.histogram(r, edges)[0]
    assert counts[ours].sum() == pytest.approx(counts[theirs].sum(), rel=0.05)
    assert counts[ours] == pytest.approx(counts[theirs], rel=0.2)


def test_simulate__defaults_are_a_session_of_a_minute() -> None:
    from furrowmap.core.simulator.drive import drive_path, plan_path
    from furrowmap.core.simulator.site import lay_out

    rng = np.random.default_rng(0)
    path = plan_path(Scenario().drive, rng)
    scenario = lay_out(Scenario(), path)
    track = drive_path(path, scenario.drive, scenario.implement, rng)
    assert 50.0 < track.duration_s < 75.0
    assert (track.e_m > 10.0).all()
    assert (track.e_m < scenario.field.size_e_m - 10.0).all()
    assert np.count_nonzero(np.diff(track.down.astype(int))) == 6


def test_simulate__a_drive_that_works_no_ground_has_empty_layers(tmp_path: Path) -> None:
    drive = ScenarioDrive(
        passes=1, pass_m=(0.5,), accel_mps2=1.5, stand_start_s=0.2, stand_end_s=0.2, lead_in_m=0.1
    )  # over before the tool is down
    field = ScenarioField(size_e_m=12.0, size_n_m=12.0)
    short = simulate(Scenario(name="short", title="Short", seed=1, field=field, drive=drive), tmp_path / "short")
    assert (short.figures["passes"], short.figures["worked_area_m2"]) == (0, 0.0)
    worked = short.folder / "truth" / "worked.gpkg"
    assert {name: len(gpd.read_file(worked, layer=name)) for name in ("passes", "coverage", "overlaps")} == {
        "passes": 0, "coverage": 0, "overlaps": 0,
    }  # fmt: skip
