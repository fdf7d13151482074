"""A scanner stated with a wrong sign, order or axis of its angles is found by the ground, and so is a clock far off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from furrowmap.core.strips.boresight import boresight, boresight_notices, held_against_mounting
from furrowmap.core.strips.strips import strip_returns
from furrowmap.core.strips.turned_mounting import turned_mountings
from furrowmap.core.values.rotation import Mounting
from tests.core.strips.test_boresight import Scene, flown

TRUE = Mounting((0.1, 0.02, -0.3), (-89.6, 34.4, -89.4))


@pytest.mark.parametrize(
    "rpy_deg", [(-90.0, -34.0, -90.0), (-90.0, -90.0, 34.0), (90.0, 34.0, -90.0), (-90.0, 34.0, 90.0)]
)
def test_mounting_with_a_wrong_sign_or_order__is_found(rpy_deg: tuple[float, float, float]) -> None:
    scene = Scene(TRUE)
    found = scene.found(Mounting(TRUE.xyz_m, rpy_deg))
    assert found.certain
    assert found.coincides
    assert found.turned_deg > 30.0
    assert (np.abs(scene.off_deg(found)) < (0.02, 0.02, 0.05)).all()
    assert found.mounting.xyz_m == TRUE.xyz_m
    assert found.clock_used_s == 0.0


@pytest.mark.parametrize("behind_s", [1.0, -18.0])
def test_clock_that_is_far_off__is_found_before_a_place(behind_s: float) -> None:
    trajectory = flown()
    scene = Scene(TRUE, behind_s=behind_s)
    found = boresight(strip_returns(scene.scans(trajectory), trajectory), trajectory, TRUE)
    assert found is not None
    if abs(behind_s) < 10.0:
        assert found.clock_used_s == pytest.approx(behind_s, abs=0.001)
        assert found.mounting.xyz_m == TRUE.xyz_m
        assert found.coincides
    else:  # most of a flight of 24 s is not under the scans then
        assert not found.coincides or found.clock_used_s == pytest.approx(behind_s, abs=0.001)


def test_mountings_that_may_be_meant__have_no_two_alike() -> None:
    listed = [TRUE.rotation, *turned_mountings(TRUE)]
    turns_deg = [
        np.degrees(np.arccos(np.clip(0.5 * (np.trace(a.T @ b) - 1.0), -1.0, 1.0)))
        for k, a in enumerate(listed)
        for b in listed[:k]
    ]
    assert min(turns_deg) > 0.9


@pytest.mark.parametrize(("behind_s", "axis"), [(0.0, 1), (7.3, 1), (0.0, 0)])
def test_ground_that_lies_apart_with_every_mounting__is_a_contradiction(behind_s: float, axis: int) -> None:
    """Points mirrored in the scanner's frame, as no mounting turns them; with a clock that is off as well."""
    trajectory = flown()
    mirror = np.where(np.arange(3) == axis, -1.0, 1.0).astype(np.float32)
    scans = [replace(scan, xyz_m=mirror * scan.xyz_m) for scan in Scene(TRUE, behind_s=behind_s).scans(trajectory)]
    found = boresight(strip_returns(scans, trajectory), trajectory, TRUE)
    assert found is not None
    assert not found.certain
    assert [notice.code for notice in boresight_notices(found, TRUE)] == ["boresight-assumed"]
    after, notice = held_against_mounting(trajectory, found)
    assert notice is not None
    assert notice.key == "contradiction.scattered-ground"
    assert f"lies {found.scatter_m[1]:.2f} m apart with every mounting" in notice.text
    assert after is trajectory


def test_scanner_that_is_turned_far_from_its_drawing__puts_the_attitude_in_doubt() -> None:
    trajectory = flown()
    found = Scene(TRUE).found(Mounting(TRUE.xyz_m, (-90.0, -34.0, -90.0)))
    after, notice = held_against_mounting(trajectory, found)
    assert notice is not None
    assert notice.key == "contradiction.turned-scanner"
    stated = np.hypot(trajectory.sigma[:, 3:], np.abs(found.correction_deg))
    np.testing.assert_allclose(after.sigma[:, 3:], stated)
    np.testing.assert_array_equal(after.sigma[:, :3], trajectory.sigma[:, :3])
    assert held_against_mounting(trajectory, found, camera_deg=0.2) == (trajectory, None)
    as_drawn = Scene(TRUE).found(TRUE)
    assert held_against_mounting(trajectory, as_drawn) == (trajectory, None)
