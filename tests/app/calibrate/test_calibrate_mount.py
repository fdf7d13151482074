"""The attitude of a mount, from rendered frames of a board, against the attitudes they were rendered with."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation

import furrowmap
from furrowmap.cli.main import command_line
from furrowmap.core.images.pinhole import unproject
from furrowmap.core.readers.mount_csv import read_mount
from furrowmap.core.runtime.errors import InputError, RefusedError
from furrowmap.core.values.camera import Camera
from furrowmap.core.values.rotation import Mounting
from tests.app.told_progress import Told

FloatArray = NDArray[np.float64]

CAMERA = Camera(640, 480, 700.0, 702.0, 322.0, 238.0, k1=-0.1, k2=0.02)
BOARD = furrowmap.Board(9, 6, 0.03)
T0_S = 1_779_529_272.0
AROUND = (slice(80, 400), slice(100, 540))
"""Rows and columns around the board in all frames."""
TO_VEHICLE = Mounting(rpy_deg=(180.0, 0.0, 90.0)).rotation
"""Of the board's axes: x to the left, y forward, z down."""
AT_FIRST = Rotation.from_euler("xyz", [18.0, -12.0, 4.0], degrees=True).as_matrix()
"""The board in the optical frame, while the mount is at zero."""
ATTITUDE_DEG = np.array([[0, 0, 0], [1.5, -2.0, 0.5], [-3.0, 1.0, 2.0], [4.0, 3.0, -2.5], [0.2, -0.1, 0.05]], float)


@cache
def rays() -> list[FloatArray]:
    """Nine directions of each pixel, spread evenly over it."""
    rows, columns = np.mgrid[AROUND]
    shifts = np.array(np.meshgrid([-1, 0, 1], [-1, 0, 1])).reshape(2, -1).T / 3.0
    return [unproject(CAMERA, np.column_stack([columns.ravel() + x, rows.ravel() + y])) for x, y in shifts]


def rendered(rotation: FloatArray, rng: np.random.Generator) -> NDArray[np.uint8]:
    """A frame of the board at 0.5 m, nine rays a pixel, lens blur left out."""
    middle = 0.5 * (BOARD.columns - 1) * BOARD.square_m, 0.5 * (BOARD.rows - 1) * BOARD.square_m
    place = np.array([0.0, 0.0, 0.5]) - rotation @ [*middle, 0.0]
    levels = np.zeros((AROUND[0].stop - AROUND[0].start, AROUND[1].stop - AROUND[1].start))
    for ways in rays():
        depth = (rotation[:, 2] @ place) / (ways @ rotation[:, 2])
        at = (ways * depth[:, None] - place) @ rotation[:, :2] / BOARD.square_m
        square = np.floor(at).astype(int)
        # A white margin of one square around the squares, grey beyond; the square inside the first corner is black.
        on = (square >= -1).all(axis=1) & (square[:, 0] < BOARD.columns) & (square[:, 1] < BOARD.rows)
        margin = (at >= -2).all(axis=1) & (at[:, 0] < BOARD.columns + 1) & (at[:, 1] < BOARD.rows + 1)
        white = np.where(square.sum(axis=1) % 2 == 1, 220.0, 30.0)
        levels += np.where(on, white, np.where(margin, 220.0, 120.0)).reshape(levels.shape) / 9.0
    whole = np.full((CAMERA.height, CAMERA.width), 120.0)
    whole[AROUND] = levels
    noisy = np.clip(np.rint(whole + rng.normal(0.0, 1.5, whole.shape)), 0, 255).astype(np.uint8)
    return np.repeat(noisy[:, :, None], 3, axis=2)


def board_in_camera(attitude_deg: FloatArray) -> FloatArray:
    """Of a board on the vehicle and a camera on the mount: the vehicle turns the other way in the camera."""
    mount = Mounting(rpy_deg=tuple(attitude_deg)).rotation
    return AT_FIRST @ TO_VEHICLE.T @ mount.T @ TO_VEHICLE


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder, rng = tmp_path_factory.mktemp("mount") / "frames", np.random.default_rng(3)
    folder.mkdir()
    lines = ["file,time_unix_s"]
    for k, attitude in enumerate(ATTITUDE_DEG):
        Image.fromarray(rendered(board_in_camera(attitude), rng)).save(folder / f"{k}.jpg", quality=92)
        lines.append(f"{k}.jpg,{T0_S + 0.5 * k:.3f}")
    Image.new("RGB", (CAMERA.width, CAMERA.height)).save(folder / "none.jpg")
    lines.append(f"none.jpg,{T0_S + 9.0:.3f}")
    (folder / "times.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    intrinsics = "".join(f"{name} = {getattr(CAMERA, name)}\n" for name in ("fx", "fy", "cx", "cy", "k1", "k2"))
    (folder.parent / "session.toml").write_text(
        'furrowmap = 1\n[recording]\nlidar = ["a"]\ngnss = ["b"]\n[crs]\nmap = "EPSG:6677"\n'
        f'[camera]\ntable = "t.csv"\nwidth = {CAMERA.width}\nheight = {CAMERA.height}\n{intrinsics}',
        encoding="utf-8",
    )
    return folder


def off_deg(found: furrowmap.MountCalibration) -> FloatArray:
    """Angles between attitudes and truth."""
    turned = np.column_stack([found.yaw_deg, found.pitch_deg, found.roll_deg])
    truth = ATTITUDE_DEG[: len(turned), ::-1]
    both = [Rotation.from_euler("ZYX", angles, degrees=True) for angles in (turned, truth)]
    return np.degrees((both[0] * both[1].inv()).magnitude())


def test_mount__is_within_a_twentieth_of_a_degree(frames: Path, tmp_path: Path) -> None:
    told = Told()
    found = furrowmap.calibrate_mount(
        frames,
        BOARD,
        tmp_path / "mount.csv",
        camera=frames.parent / "session.toml",
        board_rpy_deg=(180.0, 0.0, 90.0),
        progress=told,
    )
    assert told.shares["looking for the board"] == pytest.approx([k / 6 for k in range(7)])
    assert found.t_s == pytest.approx(T0_S + 0.5 * np.arange(5))
    assert (off_deg(found) < 0.05).all()
    assert (found.rms_px < 0.15).all()
    # Both the first frame, which is zero, and each other have the error that is stated.
    assert (off_deg(found)[1:] < 4.0 * np.hypot(found.sigma_deg[0], found.sigma_deg[1:])).all()
    assert [notice.code for notice in found.notices] == ["board-not-in-frames"]
    motion, _ = read_mount(found.path, T0_S)
    assert motion.t_s == pytest.approx(found.t_s)
    roll, pitch, yaw = ATTITUDE_DEG[3]
    read = Rotation.from_quat(motion.quaternion[3], scalar_first=True).as_matrix()
    assert read == pytest.approx(Mounting(rpy_deg=(roll, pitch, yaw)).rotation, abs=0.002)


def test_mount__from_a_video_has_the_times_of_its_frames(frames: Path, tmp_path: Path) -> None:
    """Of 20 frames a second, every second one shows nothing."""
    path = tmp_path / "film.avi"
    film = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 20.0, (CAMERA.width, CAMERA.height))
    film.set(cv2.VIDEOWRITER_PROP_QUALITY, 100)
    for k in range(len(ATTITUDE_DEG)):
        film.write(cv2.imread(str(frames / f"{k}.jpg")))
        film.write(np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8))
    film.release()
    found = furrowmap.calibrate_mount(
        path,
        BOARD,
        camera=frames.parent / "session.toml",
        board_rpy_deg=(180.0, 0.0, 90.0),
        begin="2026-05-23T11:41:12+02:00",
        every=2,
    )
    assert (found.path, found.frames) == (tmp_path / "mount.csv", 5)
    assert found.t_s == pytest.approx(T0_S + 0.1 * np.arange(5), abs=1e-3)
    assert (off_deg(found) < 0.05).all()


@pytest.mark.parametrize(
    ("name", "begin", "code"),
    [
        ("a.mp4", None, "video-no-time"),
        ("a.mp4", "noon", "video-no-time"),
        ("a.mp4", "2026-05-23T09:41:12", "video-unreadable"),
        ("a.csv", "2026-05-23T09:41:12", "video-only"),
    ],
)
def test_video_without_its_time_or_its_frames__is_refused(
    tmp_path: Path, name: str, begin: str | None, code: str
) -> None:
    """A playlist would let FFmpeg open what it names."""
    (tmp_path / name).write_text("#EXTM3U\n#EXTINF:1,\nhttp://localhost:9/secret.ts\n", encoding="utf-8")
    with pytest.raises(InputError) as refused:
        furrowmap.calibrate_mount(tmp_path / name, BOARD, begin=begin)
    assert refused.value.code == code


def test_board_on_the_mount__turns_with_it() -> None:
    from furrowmap.core.images.board import mount_attitude

    angles = [Mounting(rpy_deg=tuple(attitude)).rotation for attitude in ATTITUDE_DEG]
    seen = np.array([AT_FIRST @ TO_VEHICLE.T @ mount @ TO_VEHICLE for mount in angles])
    assert np.column_stack(mount_attitude(seen, TO_VEHICLE, "mount")) == pytest.approx(ATTITUDE_DEG, abs=1e-9)


def test_command__estimates_the_camera_where_none_is_stated(
    frames: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "mount.csv"
    words = ["calibrate", "mount", str(frames), "--board", "9x6", "--square-m", "0.03", "-o", str(out)]
    assert command_line([*words, "--board-rpy", "180,0,90"]) == 0
    told = capfd.readouterr()
    assert "5 of 6 frames show the board" in told.out
    assert "camera-estimated" in told.err or "The camera was estimated" in told.err
    rows = np.loadtxt(out, delimiter=",", skiprows=1)
    assert np.abs(rows[:, 1:4] - ATTITUDE_DEG).max() < 0.05
    assert command_line(words) == 4  # it exists


@pytest.mark.parametrize(("board", "status"), [("9", 2), ("2x9", 2), ("7x5", 4)])
def test_boards__that_are_none_or_others_are_refused(
    frames: Path, tmp_path: Path, board: str, status: int, capfd: pytest.CaptureFixture[str]
) -> None:
    words = ["calibrate", "mount", str(frames), "--square-m", "0.03", "-o", str(tmp_path / "m.csv")]
    assert command_line([*words, "--board", board]) == status
    assert ("inner corners" if status == 2 else "board of 7 x 5") in capfd.readouterr().err
    assert not (tmp_path / "m.csv").exists()


def test_frames__without_times_or_pixels_are_refused(frames: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError) as refused:
        furrowmap.calibrate_mount(tmp_path / "empty", BOARD)
    assert refused.value.code == "no-images"
    (tmp_path / "bad.jpg").write_bytes(b"no image")
    (tmp_path / "times.csv").write_text("file,time_unix_s\nbad.jpg,1.0\n", encoding="utf-8")
    with pytest.raises(InputError) as refused:
        furrowmap.calibrate_mount(tmp_path / "times.csv", BOARD)
    assert refused.value.code == "no-images"
    (tmp_path / "s.toml").write_text(
        'furrowmap = 1\n[recording]\nlidar = ["a"]\ngnss = ["b"]\n[crs]\nmap = "EPSG:6677"\n', encoding="utf-8"
    )
    with pytest.raises(InputError) as refused:
        furrowmap.calibrate_mount(frames, BOARD, tmp_path / "m.csv", camera=tmp_path / "s.toml")
    assert refused.value.code == "no-camera"
    with pytest.raises(RefusedError) as existing:
        furrowmap.calibrate_mount(frames, BOARD, tmp_path / "s.toml")
    assert existing.value.code == "output-exists"


def test_mount__without_a_pivot_is_taken_frame_by_frame() -> None:
    """A board that is held by hand: its place does not follow from how it is turned."""
    from furrowmap.core.images.board import board_poses
    from furrowmap.core.images.pinhole import project

    rng = np.random.default_rng(5)
    turns = Rotation.from_euler("xyz", rng.uniform(-30.0, 30.0, (8, 3)), degrees=True).as_matrix()
    places = np.column_stack([rng.uniform(-0.15, 0.0, (8, 2)), rng.uniform(0.4, 0.7, 8)])
    seen = [project(CAMERA, BOARD.corners_m @ turn.T + place) for turn, place in zip(turns, places, strict=True)]
    noisy = [pixels + rng.normal(0.0, 0.03, pixels.shape) for pixels in seen]
    found = board_poses([*noisy, None], BOARD, (CAMERA.width, CAMERA.height), CAMERA)
    assert not found.has_pivot
    assert found.frame.tolist() == list(range(8))
    off = Rotation.from_matrix(found.rotation @ turns.transpose(0, 2, 1)).magnitude()
    assert (np.degrees(off) < 5.0 * found.sigma_deg).all()
    # The same turns about a point, and a board that looks the same turned by half: the order of its corners may change.
    about = [turn @ np.array([0.1, 0.05, 0.02]) + [0.0, 0.0, 0.5] for turn in turns]
    even = furrowmap.Board(8, 6, 0.03)
    places = [np.array([0.0, 0.0, 1.0]) - place for place in about]
    shown = [project(CAMERA, even.corners_m @ turn.T + place) for turn, place in zip(turns, places, strict=True)]
    shown = [pixels[::-1].copy() if k % 2 else pixels for k, pixels in enumerate(shown)]
    found = board_poses(shown, even, (CAMERA.width, CAMERA.height), CAMERA)
    assert found.has_pivot
    assert found.rotation == pytest.approx(turns, abs=1e-6)


@pytest.mark.parametrize("angles", ["180,0", "a,b,c", "nan,0,0"])
def test_command__refuses_angles_that_are_not_three_numbers(angles: str, capfd: pytest.CaptureFixture[str]) -> None:
    words = ["calibrate", "mount", "frames", "--board", "9x6", "--square-m", "0.03", "--board-rpy", angles]
    assert command_line(words) == 2
    assert "is not ROLL,PITCH,YAW" in capfd.readouterr().err
