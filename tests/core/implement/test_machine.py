"""The machine's places, learned from a scene of boxes whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.implement.learning import learn_implement
from furrowmap.core.implement.machine_voxels import MachineVoxels, learn_machine
from furrowmap.core.implement.near_scans import NearScans
from furrowmap.core.pointclouds.placed_scans import unclassified
from furrowmap.core.values.scan import PointClass, Scan

from .conftest import BODY, HINT, MOUNTING, REACH, Box, Scene


def vehicle_xyz(scan: Scan) -> NDArray[np.float64]:
    xyz: NDArray[np.float64] = scan.xyz_m @ MOUNTING.rotation.T + np.array(MOUNTING.xyz_m)
    return xyz


def inside(xyz: NDArray[np.float64], box: Box, margin_m: float = 0.06) -> NDArray[np.bool_]:
    low, high = np.array(box[::2]) - margin_m, np.array(box[1::2]) + margin_m
    within: NDArray[np.bool_] = np.all((xyz > low) & (xyz < high), axis=1)
    return within


@pytest.fixture(scope="module")
def scans() -> list[Scan]:
    return Scene().scans()


@pytest.fixture(scope="module")
def machine(scans: list[Scan]) -> MachineVoxels:
    near = NearScans(MOUNTING)
    for scan in scans:
        near.add(scan)
    moving = np.ones(len(near.scans), bool)
    seen = learn_implement(near.scans, HINT).implement
    assert seen is not None
    found = learn_machine(near.scans, moving, MOUNTING, [seen])
    assert found is not None
    return found


def test_machine__body_and_tool_are_told_from_the_ground(scans: list[Scan], machine: MachineVoxels) -> None:
    for scan in scans[::7]:
        xyz, classes = vehicle_xyz(scan), unclassified(scan)
        machine.classify(scan, classes)
        body = np.any([inside(xyz, box) for box in BODY], axis=0) & (xyz[:, 2] > 0.3)
        assert (classes[body] == PointClass.VEHICLE).mean() > 0.97
        away = ~np.any([inside(xyz, box, 0.4) for box in (*BODY, REACH)], axis=0)
        assert (classes[away] == PointClass.OTHER).all()


def test_machine__the_tool_is_known_at_every_height(scans: list[Scan], machine: MachineVoxels) -> None:
    for scan in scans[::7]:
        xyz, classes = vehicle_xyz(scan), unclassified(scan)
        machine.classify(scan, classes)
        tool = inside(xyz, (-3.0, -1.25, -0.9, 0.9, 0.2, 1.9)) & ~np.any([inside(xyz, box) for box in BODY], axis=0)
        if np.count_nonzero(tool) > 100:
            assert (classes[tool] == PointClass.IMPLEMENT).mean() > 0.9


def test_machine__is_not_known_at_a_stand(scans: list[Scan]) -> None:
    near = NearScans(MOUNTING)
    for scan in scans[:60]:
        near.add(scan)
    assert learn_machine(near.scans, np.zeros(len(near.scans), bool), MOUNTING, ()) is None
