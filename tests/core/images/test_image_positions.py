"""Positions of images: they mend a poor trajectory, check a good one, and contradict one that is elsewhere."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from furrowmap.core.geodesy.coordinates import places_on_map
from furrowmap.core.geodesy.projection import map_frame
from furrowmap.core.images.image_frames import frame_poses
from furrowmap.core.images.image_positions import held_against_images
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.trajectory.located import Located
from furrowmap.core.trajectory.pose_errors import PoseErrors
from furrowmap.core.values.images import Images
from furrowmap.core.values.session import Crs
from furrowmap.core.values.trajectory import Trajectory
from tests.core.images.test_block_adjustment import NODES_S, SCALE, STATED, T_S, Flight

FRAME = map_frame(Crs(map="EPSG:25832"))
PLACE_M = np.array([580_000.0, 5_700_000.0, 0.0])
SIGMA_M = np.array([0.012, 0.012, 0.025])


def held(place: Located, images: Images) -> tuple[Located, list[Notice]]:
    stated_m, _ = places_on_map(images.t_s, images.lon_lat_h, FRAME)
    return held_against_images(place, images, STATED, stated_m, SCALE)


def moved(trajectory: Trajectory) -> Trajectory:
    return replace(trajectory, xyz_m=trajectory.xyz_m + PLACE_M)


def located(flight: Flight, shrunk: float = 1.0) -> Located:
    """The trajectory with the flight's errors, and its covariance; both made smaller."""
    truth, wrong = moved(flight.truth), moved(flight.block.trajectory)
    xyz = truth.xyz_m + shrunk * (wrong.xyz_m - truth.xyz_m)
    known = PoseErrors(NODES_S, np.zeros((len(NODES_S), 6)), shrunk**2 * flight.covariance)
    notices = (Notice.from_values("gnss-quality", {}), Notice.from_values("epochs-missing", {}))
    return Located(replace(wrong, xyz_m=xyz), "imu", {}, notices, pose_errors=lambda _: known)


def pictured(flight: Flight, off_m: FloatArray, late_s: float = 0.0, seed: int = 1) -> Images:
    """Images with the true places of the camera, with noise and a common error."""
    rng = np.random.default_rng(seed)
    xyz = frame_poses(moved(flight.truth), STATED, T_S + late_s, SCALE).xyz_m + off_m
    xyz = xyz + np.sqrt(0.5) * SIGMA_M * (rng.normal(size=(len(T_S), 3)) + rng.normal(size=3))
    lon, lat = FRAME.to_lon_lat(xyz[:, 0], xyz[:, 1])
    paths = [Path(f"{k}.jpg") for k in range(len(T_S))]
    return Images.sorted(paths, T_S, np.column_stack([lon, lat, xyz[:, 2]]), np.tile(SIGMA_M, (len(T_S), 1)))


def off_m(place: Located, flight: Flight) -> FloatArray:
    out: FloatArray = place.trajectory.at(T_S).xyz_m - moved(flight.truth).at(T_S).xyz_m
    return out


@pytest.mark.parametrize("seed", [5, 6, 7, 8])
def test_positions__that_are_better_are_observations(seed: int) -> None:
    flight = Flight(seed, places=60)
    before = located(flight)
    after, (notice,) = held(before, pictured(flight, np.zeros(3), seed=seed))
    assert notice.key == "images-placed.used"
    assert [one.code for one in after.notices] == ["epochs-missing"]
    assert np.abs(off_m(before, flight)).max() > 0.15
    assert after.pose_errors is not None
    left = after.pose_errors(T_S)
    assert np.linalg.eigvalsh(left.covariance).min() > 0.0
    sigma = np.median(np.sqrt(np.diag(left.covariance)).reshape(-1, 6)[1:-1, :3], axis=0)
    rms = np.sqrt((off_m(after, flight) ** 2).mean(axis=0))
    assert (rms < 0.06).all()
    assert (rms < 3.0 * sigma).all()
    assert (sigma < 0.05).all()


def test_positions__that_are_no_better_are_a_check() -> None:
    flight = Flight(5, places=60)
    before = located(flight, 0.03)
    after, (notice,) = held(before, pictured(flight, np.zeros(3)))
    assert after is before
    assert notice.key == "images-placed"
    assert "24 of 24 images" in notice.text


@pytest.mark.parametrize("shift_m", [(0.0, 0.0, 45.0), (3.0, -2.0, 0.0)])
@pytest.mark.parametrize("shrunk", [1.0, 0.03])
def test_positions__elsewhere_contradict_and_are_not_used(shrunk: float, shift_m: tuple[float, ...]) -> None:
    flight = Flight(5, places=60)
    before = located(flight, shrunk)
    after, (notice,) = held(before, pictured(flight, np.array(shift_m)))
    assert after is before
    assert notice.key == "images-placed.contradict"
    assert "another datum" in notice.text


def test_times__that_are_off_are_told_from_places() -> None:
    flight = Flight(5, places=60)
    images = pictured(flight, np.zeros(3), late_s=0.6).chosen(np.flatnonzero(T_S < 9.0))
    _, (notice,) = held(located(flight, 0.03), images)
    assert notice.key == "images-placed.contradict"
    assert float(str(dict(notice.values)["late_s"])) == pytest.approx(0.6, abs=0.01)
    assert "shutter_delay_s" in notice.text


def test_positions__without_standard_deviations_are_left_alone() -> None:
    flight = Flight(5, places=60)
    images = pictured(flight, np.zeros(3))
    bare = replace(images, sigma_m=np.full_like(images.sigma_m, np.nan))
    before = located(flight)
    assert held(before, bare) == (before, [])
    assert held(replace(before, pose_errors=None), images)[1] == []
