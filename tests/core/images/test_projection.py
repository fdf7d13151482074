"""Projection against OpenCV."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from furrowmap.core.images.pinhole import inside, project, unproject
from furrowmap.core.values.camera import Camera

WIDE = Camera(800, 600, 661.4, 661.9, 402.7, 296.1, k1=-0.082, k2=0.011)
BENT = Camera(1920, 1080, 1100.0, 1095.0, 951.0, 548.0, k1=-0.31, k2=0.12, k3=-0.02, p1=0.0012, p2=-0.0008)


def in_view(camera: Camera, count: int, seed: int) -> np.ndarray:
    """Points (count, 3) of the optical frame in front of the camera, most of them in the image."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-0.7, 0.7, (count, 2))
    z = rng.uniform(0.5, 50.0, count)
    return np.column_stack([xy * z[:, None], z])


@pytest.mark.parametrize("camera", [WIDE, BENT])
def test_project__is_that_of_opencv(camera: Camera) -> None:
    points = in_view(camera, 2000, 1)
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)
    found = project(camera, points)
    known = np.isfinite(found[:, 0])
    assert known.mean() > 0.9
    assert found[known] == pytest.approx(expected.reshape(-1, 2)[known], abs=1e-8)


@pytest.mark.parametrize("camera", [WIDE, BENT])
def test_unproject__is_that_of_opencv(camera: Camera) -> None:
    pixels = np.random.default_rng(2).uniform([0, 0], [camera.width - 1, camera.height - 1], (2000, 2))
    enough = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 200, 1e-13)
    undistort = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)  # one function since OpenCV 5
    expected = undistort(pixels, camera.matrix, camera.distortion, R=None, P=None, criteria=enough).reshape(-1, 2)
    found = unproject(camera, pixels)
    assert found[:, :2] == pytest.approx(expected, abs=1e-9)
    assert (found[:, 2] == 1.0).all()


@settings(max_examples=60, deadline=None)
@given(
    st.tuples(*[st.floats(-0.3, 0.3)] * 3),
    st.tuples(*[st.floats(-0.005, 0.005)] * 2),
    st.integers(0, 2**32 - 1),
)
def test_unproject__leads_back(radial: tuple[float, ...], tangential: tuple[float, ...], seed: int) -> None:
    """Within the part of the image that the polynomial does not fold."""
    camera = Camera(640, 480, 600.0, 590.0, 310.0, 250.0, *radial, *tangential)
    points = in_view(camera, 50, seed)
    points = points[np.hypot(*(points[:, :2] / points[:, 2:]).T) < 0.85 * camera.widest]
    found = unproject(camera, project(camera, points))
    assert found == pytest.approx(points / points[:, 2:], abs=1e-6)


def test_project__has_no_pixel_behind_the_camera_or_where_the_polynomial_folds_back() -> None:
    folding = Camera(800, 600, 660.0, 660.0, 400.0, 300.0, k1=-0.3)
    assert folding.widest == pytest.approx(np.sqrt(1.0 / 0.9))
    far_aside = np.array([[1.7, 0.0, 1.0], [0.3, 0.1, -1.0], [0.0, 0.0, 0.0], [0.3, 0.0, 1.0]])
    found = project(folding, far_aside)
    assert np.isnan(found[:3]).all()
    assert np.isfinite(found[3]).all()
    folded, _ = cv2.projectPoints(far_aside[:1], np.zeros(3), np.zeros(3), folding.matrix, folding.distortion)
    assert inside(folding, folded.reshape(-1, 2)).all()  # where OpenCV puts it


def test_reduced__pixels_are_means_of_blocks() -> None:
    points = in_view(WIDE, 200, 3)
    full, half = project(WIDE, points), project(WIDE.reduced(2), points)
    assert 2.0 * half + 0.5 == pytest.approx(full, nan_ok=True)


def test_colmap__has_the_same_camera_half_a_pixel_on() -> None:
    import pycolmap

    params = (1100.0, 1095.0, 951.5, 548.5, -0.31, 0.12, 0.0012, -0.0008)
    theirs = pycolmap.Camera(model="OPENCV", width=1920, height=1080, params=params)
    points = in_view(BENT, 500, 4)
    points = points[np.hypot(*(points[:, :2] / points[:, 2:]).T) < 0.5]
    ours = project(Camera.from_colmap((1920, 1080), "OPENCV", params), points)
    assert ours + 0.5 == pytest.approx(np.asarray(theirs.img_from_cam(points)), abs=1e-8)
    full = (1100.0, 1095.0, 951.5, 548.5, -0.31, 0.12, 0.0012, -0.0008, -0.02, 0.0, 0.0, 0.0)
    assert Camera.from_colmap((1920, 1080), "FULL_OPENCV", full) == BENT
    assert Camera.from_colmap((640, 480), "SIMPLE_RADIAL", (600.0, 320.0, 240.0, 0.1)) == Camera(
        640, 480, 600.0, 600.0, 319.5, 239.5, k1=0.1
    )
    for model, numbers in (("FISHEYE", ()), ("OPENCV", (1.0,)), ("FULL_OPENCV", (*full[:11], 0.1))):
        with pytest.raises(ValueError, match=model if numbers == () else "parameters|k4"):
            Camera.from_colmap((640, 480), model, numbers)
