"""Rendered images of soil and plates aid a trajectory: it ends where it was, with the errors that are stated."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Final

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from furrowmap.core.images.control_points import ControlPoints
from furrowmap.core.images.image_aiding import ImageAid, aid_by_images
from furrowmap.core.images.image_frames import frame_poses
from furrowmap.core.images.pinhole import unproject
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.progress import silent
from furrowmap.core.trajectory.located import Located
from furrowmap.core.trajectory.pose_errors import PoseErrors
from furrowmap.core.values.camera import Camera
from furrowmap.core.values.images import Images
from furrowmap.core.values.margins import with_margin
from furrowmap.exporters.reports.html_pages import render
from tests.core.images.test_block_adjustment import DELAY_S, NODES_S, SCALE, STATED, TRUE_TURN, Flight, true_camera

pytest.importorskip("cv2")
PIL = pytest.importorskip("PIL.Image")

FloatArray = NDArray[np.float64]

CORNER_M: Final = np.array([494.0, 794.0])
TEXEL_M: Final = 0.02
GROUND_M: Final = 60.0
PLATES_M: Final = np.array([[503.0, 799.1], [507.6, 801.2], [512.2, 798.9], [515.4, 800.7]])
HALF_M: Final = 0.3
T_S: Final = np.arange(2.0, 10.0)
FLIGHT: Final = Flight(5, places=60)


def small(camera: Camera) -> Camera:
    """The camera with half as many pixels a side."""
    half = {name: (getattr(camera, name) + 0.5) / 2.0 - 0.5 for name in ("cx", "cy")}
    return replace(camera, width=400, height=300, fx=camera.fx / 2.0, fy=camera.fy / 2.0, **half)


def soil() -> FloatArray:
    """Levels (rows, columns) of the ground: blots of some centimetres, and plates of black and white quadrants."""
    rng = np.random.default_rng(3)
    size = (700, 1600)
    levels = 110.0 + sum(60.0 * k * gaussian_filter(rng.normal(size=size), k) for k in (1.5, 3.0, 6.0))
    for east, north in (PLATES_M - CORNER_M) / TEXEL_M:
        rows, columns = (np.arange(int(v - 20), int(v + 21)) for v in (north, east))
        y, x = np.meshgrid(rows + 0.5 - north, columns + 0.5 - east, indexing="ij")
        on = np.maximum(np.abs(x), np.abs(y)) < HALF_M / TEXEL_M
        levels[np.ix_(rows, columns)] = np.where(on, np.where(x * y > 0.0, 225.0, 25.0), 110.0)
    return np.clip(levels, 0.0, 255.0)


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Images:
    folder, ground, camera = tmp_path_factory.mktemp("aid"), soil(), small(true_camera())
    poses = frame_poses(FLIGHT.truth, camera, T_S, SCALE)
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    rays = unproject(camera, np.column_stack([u.ravel(), v.ravel()]).astype(np.float64))
    paths = []
    for k in range(len(T_S)):
        ways = rays @ poses.rotation[k].T
        far = (GROUND_M - poses.xyz_m[k, 2]) / ways[:, 2]
        at = poses.xyz_m[k, :2] + SCALE * far[:, None] * ways[:, :2]
        column, row = ((at - CORNER_M) / TEXEL_M - 0.5).T
        levels = map_coordinates(ground, [row, column], order=1, mode="nearest").reshape(u.shape)
        paths.append(folder / f"{k}.png")
        PIL.fromarray(np.rint(levels).astype(np.uint8)).convert("RGB").save(paths[-1])
    return Images.sorted(paths, T_S)


def located() -> Located:
    known = PoseErrors(NODES_S, np.zeros((len(NODES_S), 6)), FLIGHT.covariance)
    told = (Notice.from_values("gnss-quality", {}), Notice.from_values("epochs-missing", {}))
    return Located(FLIGHT.block.trajectory, "imu", {}, told, pose_errors=lambda _: known)


def surveyed() -> ControlPoints:
    xyz = np.column_stack([PLATES_M, np.full(len(PLATES_M), GROUND_M)])
    return ControlPoints(tuple("ABCD"), xyz, np.full((4, 3), np.nan))


@pytest.fixture(scope="module")
def aided(images: Images) -> tuple[Located, ImageAid]:
    stages: list[tuple[str, float]] = []
    found = aid_by_images(located(), images, small(STATED), SCALE, surveyed(), lambda *stage: stages.append(stage))
    assert found.notices == ()
    assert found.aid is not None
    assert {("finding features", 1.0), ("matching images", 1.0), ("adjusting images", 1.0)} <= set(stages)
    return found.located, found.aid


def off_m(place: Located) -> FloatArray:
    """Vehicle's places at the exposures minus the true ones, (n, 3)."""
    out: FloatArray = place.trajectory.at(T_S).xyz_m - FLIGHT.truth.at(T_S).xyz_m
    return out


def test_plates__place_the_trajectory(aided: tuple[Located, ImageAid]) -> None:
    after, aid = aided
    before = located()
    assert np.linalg.norm(off_m(before), axis=1).min() > 0.3
    assert np.abs(off_m(after)).max() < 0.02
    assert (np.abs(off_m(after).mean(axis=0)) < 4.0 * np.array(aid.shift_sigma_m)).all()
    assert max(aid.shift_sigma_m) < 0.01
    assert aid.shift_m == pytest.approx((off_m(after) - off_m(before)).mean(axis=0), abs=0.003)
    assert aid.trajectory is after.trajectory
    assert [notice.code for notice in after.notices] == ["epochs-missing"]
    assert after.pose_errors is not None
    left = after.pose_errors(T_S)
    assert not left.value.any()
    assert left.covariance is aid.adjusted.found.covariance


def test_camera__is_the_one_that_took_the_images(aided: tuple[Located, ImageAid]) -> None:
    told = aided[1].calibration()
    off_deg = np.array(told["correction_deg"]) - np.degrees(TRUE_TURN)
    assert (np.abs(off_deg) < 4.0 * np.array(told["sigma_deg"])).all()
    assert max(told["sigma_deg"]) < 0.1
    found = replace(STATED, rpy_deg=tuple(told["rpy_deg"])).mounting.rotation
    assert found == pytest.approx(true_camera().mounting.rotation, abs=0.005)
    assert abs(told["shutter_delay_s"] - DELAY_S) < 4.0 * told["shutter_delay_sigma_s"] < 0.004


def test_figures__are_those_of_the_scene(aided: tuple[Located, ImageAid]) -> None:
    told = aided[1].plain()
    assert told["images"] == len(T_S)
    assert told["points"] > 500
    assert 2 * told["points"] <= told["observations"]
    assert 0.9 * told["observations"] < told["observations_used"] <= told["observations"]
    assert told["reprojection_rms_px"] < 0.15, "rendered without noise"
    assert told["sigma_before_m"] == pytest.approx([0.3, 0.3, 0.3], abs=0.01)
    assert max(told["sigma_after_m"]) < 0.02
    assert told["sigma_before_deg"][2] == pytest.approx(0.5, abs=0.01)
    assert told["sigma_after_deg"][2] < 0.1
    assert 0.5 < told["tension"] < 1.5
    points = told["control_points"]
    assert {point["name"] for point in points} >= {"B", "C", "D"}
    for point in points:
        assert point["images"] >= 2
        assert point["residual_px"] < 0.3
        assert np.abs(point["off_m"]).max() < 0.01
    page = render("images.html", found=SimpleNamespace(image_aid=aided[1]))
    assert f"in {told['observations_used']:,} of {told['observations']:,} views" in page
    assert page.count("control point ") == len(points)
    assert with_margin(told["shift_m"][1], told["shift_sigma_m"][1], " mm", 1000.0) in page
    assert f"{1000 * told['sigma_before_m'][2]:.1f} mm before" in page
    assert not render("images.html", found=SimpleNamespace(image_aid=None)).strip()


def test_a_camera_that_looks_up__is_a_contradiction(images: Images) -> None:
    up = replace(small(STATED), rpy_deg=(0.0, 0.0, -90.0))
    few = Images.sorted(list(images.paths[:4]), T_S[:4])
    before = located()
    found = aid_by_images(before, few, up, SCALE, None, silent)
    assert (found.located, found.aid) == (before, None)
    (notice,) = found.notices
    assert notice.code == "images-contradict"
    assert "behind the camera. Check [camera] rpy_deg" in notice.text
