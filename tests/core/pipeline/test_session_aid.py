"""When images aid a trajectory, and what is said where they do not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from furrowmap.core.images.block_adjustment import (
    AdjustedBlock,
    ImageBlock,
    Known,
    adjust_block,
    adjusted_poses,
)
from furrowmap.core.images.control_points import ControlPoints, control_views
from furrowmap.core.images.image_aiding import (
    AidedTrajectory,
    ControlledBlock,
    aid_by_images,
    camera_notices,
    contradicting,
    doubtful,
    notices_beside,
    with_control,
)
from furrowmap.core.images.image_frames import frame_poses
from furrowmap.core.images.ties import overlapping
from furrowmap.core.pipeline import session_aid
from furrowmap.core.pipeline.session_aid import read_pixels
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.progress import silent
from furrowmap.core.session.opened import OpenSession, open_session
from furrowmap.core.trajectory.located import Located
from furrowmap.core.trajectory.pose_errors import PoseErrors
from furrowmap.core.values.camera import Camera
from furrowmap.core.values.images import Images
from tests.core.images.test_block_adjustment import NODES_S, SCALE, STATED, T_S, Flight, flown, true_camera

pytest.importorskip("cv2")
PIL = pytest.importorskip("PIL.Image")


def located() -> Located:
    zero = PoseErrors(NODES_S, np.zeros((len(NODES_S), 6)), np.eye(6 * len(NODES_S)))
    return Located(flown(), "imu", {}, (), pose_errors=lambda _: zero)


def told(images: Images, place: Located) -> str:
    found = aid_by_images(place, images, STATED, SCALE, None, silent)
    assert found.aid is None
    assert found.located is place
    return " | ".join(f"{notice.code}: {notice.text}" for notice in found.notices)


def test_blank_damaged_and_small_images__leave_the_trajectory_as_it_was(tmp_path: Path) -> None:
    paths = []
    for k in range(5):
        paths.append(tmp_path / f"{k} blank.jpg")
        PIL.new("RGB", (800, 600), (90, 120, 60)).save(paths[-1])
    images = Images.sorted(paths, T_S[:5])
    assert "images-not-adjusted: The images do not aid the trajectory: images that follow" in told(images, located())
    paths[0].write_bytes(b"\xff\xd8 no image")
    PIL.new("RGB", (400, 300)).save(paths[1])
    said = told(Images.sorted(paths[:4], T_S[:4]), located())
    assert "images-unreadable: 2 of 4 images cannot be read or are not of 800 × 600 pixels" in said
    assert "there are 2 that can be read" in said
    assert "how the errors of its poses go together" in told(images, replace(located(), pose_errors=None))
    assert "there are 0 that" in told(Images.sorted(paths, T_S[:5] + 900.0), located())


def test_pairs__are_images_of_the_same_ground() -> None:
    """Lines 4.8 m apart, images 2 m apart, 9 m of ground in an image: neighbours on both lines, not the far ends."""
    pairs = overlapping(frame_poses(flown(), true_camera(), T_S, SCALE), true_camera(), 5.6)
    assert {(k, k + 1) for k in range(8)} <= set(pairs)
    assert (0, 9) not in pairs
    assert any(b - a > 12 for a, b in pairs)


def test_pixels_of_control_points__are_read_or_refused(tmp_path: Path) -> None:
    table = tmp_path / "pixels.csv"
    table.write_text("file,name,u,v\nimages/a.jpg,C1,10.5,20\nb.jpg,C2,3,4\n")
    assert read_pixels(table, ("C2", "C1"))[0] == (("a.jpg", 1, 10.5, 20.0), ("b.jpg", 0, 3.0, 4.0))
    for text, why in (
        ("file,name\na,b\n", "no columns u, v"),
        ("file,name,u,v\na,C9,1,2\n", "line 2 names 'C9'"),
        ("file,name,u,v\na,C1,1,x\n", "line 2 has no numbers"),
    ):
        table.write_text(text)
        with pytest.raises(InputError, match=why) as refused:
            read_pixels(table, ("C1",))
        assert refused.value.code == "control-pixels-unreadable"
    with pytest.raises(InputError, match="No such file") as refused:
        read_pixels(tmp_path / "lost.csv", ("C1",))
    assert refused.value.code == "control-pixels-unreadable"


def test_views_of_control_points__that_disagree_are_left_out() -> None:
    flight = Flight(5)
    adjusted = adjust_block(flight.block, flight.ties)
    many = int(np.argmax(np.bincount(flight.ties.point)))
    own = np.flatnonzero(flight.ties.point == many)
    paths = [Path(f"{k}.jpg") for k in range(len(T_S))]
    rows = [(f"{flight.ties.frame[k]}.jpg", 0, *flight.ties.pixel[k].tolist()) for k in own]
    wrong = (rows[0][0], 0, rows[0][2] + 40.0, rows[0][3])
    points = ControlPoints(("C1", "C2"), flight.soil[[many, 0]], np.full((2, 3), np.nan), (wrong, *rows[1:]))
    views = control_views(points, flight.block, adjusted, paths)
    assert views is not None
    ties, known = views
    assert known.name == ("C1",)
    assert len(ties) == len(own) - 1
    assert (known.sigma_m == 0.005).all()
    alone = replace(points, seen=(rows[0],))
    assert control_views(alone, flight.block, adjusted, paths) is None
    found = with_control(flight.block, adjusted, alone, Images.sorted(paths, T_S))
    assert found == ControlledBlock(adjusted, notices=found.notices)
    assert [notice.code for notice in found.notices] == ["control-points-unseen"]


@pytest.mark.parametrize(
    ("names", "kept"), [((), True), (("C1", "C2"), True), (("C1", "C1", "C1"), True), (("C1", "C2", "C3"), False)]
)
def test_quality_of_positions__is_not_that_of_a_cloud_that_control_points_place(
    names: tuple[str, ...], kept: bool
) -> None:
    n = len(names)
    known = Known(np.arange(n), np.zeros((n, 3)), np.full((n, 3), 0.005), names)
    quality, other = Notice.from_values("gnss-quality", {}), Notice.from_values("epochs-missing", {})
    assert notices_beside((quality, other), known) == ((quality, other) if kept else (other,))


def adjusted_with(camera: Camera, late_s: float = 0.0) -> tuple[Flight, AdjustedBlock]:
    """The adjustment of a flight whose camera or times are stated otherwise than they are."""
    flight = Flight(1, places=300)
    block = ImageBlock(flight.block.trajectory, flight.block.errors, camera, T_S + late_s, SCALE)
    return flight, adjust_block(block, flight.ties)


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"fx": 1.1 * STATED.fx, "fy": 1.1 * STATED.fy}, "contradict GNSS and IMU"),
        ({"rpy_deg": (180.0, 0.0, 90.0)}, "do not fit its poses together"),
    ],
)
def test_wrong_focal_length_or_sign__is_a_contradiction(changed: dict[str, Any], why: str) -> None:
    _, adjusted = adjusted_with(replace(STATED, **changed))
    doubt = doubtful(adjusted)
    assert doubt is not None
    assert why in str(doubt)
    notice = contradicting(doubt)
    assert notice.code == "images-contradict"
    assert "neither for the trajectory nor for colours" in notice.text


def test_times_a_second_off__are_found_told_and_put_right() -> None:
    flight, adjusted = adjusted_with(STATED, late_s=1.0)
    assert doubtful(adjusted) is None
    (notice,) = camera_notices(adjusted, STATED)
    assert notice.code == "camera-times-off"
    assert "taken 0.980 s before the times stated" in notice.text
    _, right = adjusted_with(STATED)
    assert camera_notices(right, STATED) == []
    truth = frame_poses(flight.truth, true_camera(), T_S, SCALE).xyz_m
    for found, late_s in ((adjusted, 1.0), (right, 0.0)):
        block = replace(flight.block, t_s=T_S + late_s)
        off = adjusted_poses(block, found).xyz_m - truth
        assert np.linalg.norm(off - off.mean(axis=0), axis=1).max() < 0.2, "heading is known to 0.5 degrees only"


def test_mounting_and_intrinsics_that_are_off__are_told() -> None:
    _, adjusted = adjusted_with(replace(STATED, rpy_deg=(180.0, 20.0, -90.0)))
    (turned,) = camera_notices(adjusted, STATED)
    assert (turned.code, doubtful(adjusted)) == ("camera-mounting-off", None)
    _, adjusted = adjusted_with(replace(STATED, k1=0.0, k2=0.0))
    assert doubtful(adjusted) is None
    assert "camera-residuals" in {notice.code for notice in camera_notices(adjusted, STATED)}
    _, adjusted = adjusted_with(replace(STATED, fx=1.044 * STATED.fx, fy=1.044 * STATED.fy))
    (strained,) = camera_notices(adjusted, STATED)
    assert (strained.code, doubtful(adjusted)) == ("camera-tension", None)


def test_session__without_the_extra_goes_on_without_images(monkeypatch: pytest.MonkeyPatch, shared_data: Path) -> None:
    opened = open_session(shared_data / "uav_wheat" / "session.toml")
    monkeypatch.setattr(session_aid, "find_spec", lambda name: None if name == "cv2" else name)
    place = located()
    found = session_aid.aid_session(opened, place, SCALE, silent)
    assert (found.located, found.aid) == (place, None)
    (notice,) = found.notices
    assert 'pip install ".[photo]"' in notice.text


SESSION = """furrowmap = 1
[recording]
lidar = ["none.pcap"]
[crs]
map = "EPSG:25832"
[trajectory]
files = ["drive.csv"]
[camera]
table = "images.csv"
width = 800
height = 600
fx = 660.0
fy = 661.0
cx = 402.0
cy = 297.0
"""


def session_of(folder: Path, more: str) -> OpenSession:
    rows = "".join(f"{1_779_529_272 + k},500000,5900000,60,0,0,90\n" for k in range(3))
    (folder / "drive.csv").write_text(f"time_unix_s,e_m,n_m,h_m,roll_deg,pitch_deg,heading_deg\n{rows}")
    (folder / "none.pcap").write_bytes(b"")
    (folder / "images.csv").write_text("file,time_unix_s\n0.png,1779529273\n")
    PIL.new("RGB", (800, 600)).save(folder / "0.png")
    (folder / "points.csv").write_text("name,easting,northing,height\nC1,500000,5900000,60\n")
    (folder / "pixels.csv").write_text("file,name,u,v\n0.png,C9,1,2\n")
    (folder / "session.toml").write_text(f"{SESSION}{more}", encoding="utf-8")
    return open_session(folder / "session.toml")


def test_control_points__of_a_session_are_read_before_images_are_looked_at(tmp_path: Path) -> None:
    place = located()
    opened = session_of(tmp_path, 'control_points = "points.csv"\n')
    found = session_aid.aid_session(opened, place, SCALE, silent)
    assert (found.located, found.aid) == (place, None)
    assert "there are 0 that can be read" in found.notices[-1].text
    opened = session_of(tmp_path, 'control_points = "points.csv"\ncontrol_pixels = "pixels.csv"\n')
    with pytest.raises(InputError, match="'C9', which is none of the control points"):
        session_aid.aid_session(opened, place, SCALE, silent)
    (tmp_path / "pixels.csv").write_text("file,name,u,v\n0.png,C1,1,2\n")
    found = session_aid.aid_session(opened, place, SCALE, silent)
    assert (found.located, found.aid) == (place, None)
    (tmp_path / "points.csv").write_text("nothing\n")
    with pytest.raises(InputError, match=r"points\.csv"):
        session_aid.aid_session(opened, place, SCALE, silent)


@pytest.mark.parametrize("more", ["aid = false\n", None])
def test_images__that_are_not_to_aid_or_not_there_leave_no_word(more: str | None, tmp_path: Path) -> None:
    opened = session_of(tmp_path, more or "")
    if more is None:
        (tmp_path / "session.toml").write_text(SESSION.split("[camera]")[0], encoding="utf-8")
        opened = open_session(tmp_path / "session.toml")
    place = located()
    assert session_aid.aid_session(opened, place, SCALE, silent) == AidedTrajectory(place, None, ())
