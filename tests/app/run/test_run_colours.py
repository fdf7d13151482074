"""Colours on their way through a run: counts, what is left out, and what happens without images."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from furrowmap.core.images.image_frames import Frames
from furrowmap.core.pipeline import place
from furrowmap.core.pipeline.solution import FirstGuess
from furrowmap.core.pointclouds.placed_scans import PlacedScan
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.session.opened import OpenSession
from furrowmap.core.trajectory.located import Located
from furrowmap.core.values.scan import PointClass, Scan
from furrowmap.core.values.session import CameraSource
from furrowmap.core.values.trajectory import Trajectory, trajectory_from_attitude
from furrowmap.exporters.cloud.layers import ChunkColumns
from furrowmap.workflows.run.colours import RunColours
from tests.core.images.scenes import cloud, frames_above, texture

ORIGIN_M = (0.0, 0.0, 0.0)
SCALE_M = 0.001


def columns(xyz_m: np.ndarray, classes: np.ndarray) -> ChunkColumns:
    """Points as the cloud has them."""
    n = len(xyz_m)
    x, y, z = np.rint(xyz_m.T / SCALE_M).astype(np.int32)
    small = [np.zeros(n, np.uint16), np.ones(n, np.uint8), classes, np.zeros(n, np.uint16)]
    return ChunkColumns(x, y, z, *small, np.zeros(n), np.zeros((3, n), np.uint16), np.zeros((0, n), np.uint8))


def coloured(frames: Frames) -> tuple[ChunkColumns, dict[str, Any], list[Notice]]:
    """Points of the ground, some of them of the vehicle, through the colours of a run."""
    ground, board = cloud()
    whole = np.concatenate([ground, board])
    classes = np.full(len(whole), PointClass.OTHER, np.uint8)
    classes[::10] = PointClass.VEHICLE
    with RunColours(frames, ORIGIN_M) as colours:
        scan = Scan.__new__(Scan)  # its points alone matter
        colours.add(PlacedScan(scan, whole, classes, 0))
        colours.finish(lambda *_: None)
        points = columns(whole, classes)
        colours.paint(points, SCALE_M)
        figures = colours.figures()
    return points, *figures


def test_run__colours_and_counts(tmp_path: Path) -> None:
    points, figures, notices = coloured(frames_above(tmp_path, np.array([[-2.0, 0.0], [2.0, 0.0]]), np.zeros(2)))
    assert points.rgb is not None
    has = (points.rgb > 0).any(axis=0)
    of_vehicle = points.classification == PointClass.VEHICLE
    assert not has[of_vehicle].any()
    assert figures["points_coloured"] == has.sum()
    assert figures["points_left_out"] == of_vehicle.sum()
    assert figures["points_coloured"] + figures["points_not_seen"] == (~of_vehicle).sum()
    assert figures["points_not_seen"] > 0
    on_ground = has & (points.z == 0) & (np.abs(points.x) > 2000)
    xy = np.column_stack([points.x, points.y])[on_ground] * SCALE_M
    off = points.rgb[:, on_ground].T / 257.0 - texture(xy)
    assert np.sqrt((off**2).mean()) < 2.5
    assert figures["images"] == 2
    assert not notices


def test_run__without_any_colour_says_so(tmp_path: Path) -> None:
    frames = frames_above(tmp_path, np.array([[0.0, 0.0]]), np.zeros(1))
    up = replace(frames, poses=replace(frames.poses, rotation=np.eye(3)[None]))
    points, _, notices = coloured(up)
    assert points.rgb is not None
    assert not points.rgb.any()
    assert [notice.code for notice in notices] == ["nothing-coloured"]


def nowhere() -> tuple[Trajectory, FirstGuess]:
    """A trajectory of one pose, and the guess that it is of."""
    trajectory = trajectory_from_attitude(np.zeros(1), np.zeros((1, 3)), 0.0, 0.0, 0.0, max_gap_s=1.0)
    return trajectory, FirstGuess(Located(trajectory, "imu", {}, ()), None)


def test_run__without_pillow_goes_on(monkeypatch: pytest.MonkeyPatch, shared_data: Path) -> None:
    from furrowmap.core.session.opened import open_session

    opened: OpenSession = open_session(shared_data / "uav_wheat" / "session.toml")
    monkeypatch.setattr(place, "find_spec", lambda _: None)
    frames, notices = place.camera_frames(opened, *nowhere())
    assert frames is None
    assert [notice.code for notice in notices] == ["images-unused"]


def test_run__without_intrinsics_goes_on(shared_data: Path) -> None:
    from furrowmap.core.session.opened import open_session

    opened = open_session(shared_data / "uav_wheat" / "session.toml")
    bare = replace(opened, session=msgspec.structs.replace(opened.session, camera=CameraSource(table="images.csv")))
    frames, notices = place.camera_frames(bare, *nowhere())
    assert frames is None
    assert ["no intrinsics" in notice.text for notice in notices] == [True]
