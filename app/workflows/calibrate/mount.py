"""The attitude of a mount that moves, from frames of a board."""

from collections import deque
from collections.abc import Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.images.board import (
    ON_BODY,
    Board,
    board_notices,
    board_poses,
    expect_opencv,
    find_corners,
    mount_attitude,
)
from furrowmap.core.readers.csv_file import unix_time
from furrowmap.core.readers.exif import exif_images
from furrowmap.core.readers.image_pixels import expect_pillow, read_pixels
from furrowmap.core.readers.image_table import is_image_table, read_image_table
from furrowmap.core.readers.video import VIDEO_SUFFIXES, Video
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice, RefusedError
from furrowmap.core.runtime.file_names import resolved
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.runtime.settings import threads
from furrowmap.core.session.opened import open_session
from furrowmap.core.session.session_camera import camera_of
from furrowmap.core.session.session_file import load_session
from furrowmap.core.values.camera import Camera
from furrowmap.core.values.images import ImageFile
from furrowmap.core.values.rotation import Mounting
from furrowmap.exporters.files.atomic import atomic_output

IMAGE_SUFFIXES: Final = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff"})
MOUNT_HEADER: Final = "time_unix_s,roll_deg,pitch_deg,yaw_deg,sigma_deg,rms_px"
Picture: TypeAlias = ImageFile | NDArray[np.uint8]
"""An image file, or the pixels (height, width, 3) of a video's frame."""


@dataclass(frozen=True)
class MountCalibration:
    """The attitude of a mount over time.

    Attributes:
        path: CSV for `[mount] attitude`.
        t_s: (n,) UTC of the frames that show the board.
        roll_deg, pitch_deg, yaw_deg: (n,) of the mount in the vehicle frame; zero in the first frame.
        sigma_deg: (n,) standard deviation of an attitude by the scatter of the corners.
        rms_px: (n,) root mean square of the corners' distances.
        frames: number of frames looked at.
        camera: whose intrinsics were used.
    """

    path: Path
    t_s: FloatArray
    roll_deg: FloatArray
    pitch_deg: FloatArray
    yaw_deg: FloatArray
    sigma_deg: FloatArray
    rms_px: FloatArray
    frames: int
    camera: Camera
    notices: tuple[Notice, ...]

    def plain(self) -> dict[str, Any]:
        """Its figures, for JSON."""
        angles = (self.roll_deg, self.pitch_deg, self.yaw_deg)
        return {
            "frames": self.frames,
            "frames_with_board": len(self.t_s),
            "sigma_deg": round(float(np.median(self.sigma_deg)), 5),
            "rms_px": round(float(np.median(self.rms_px)), 4),
            "range_deg": [round(float(np.ptp(angle)), 4) for angle in angles],
        }


def calibrate_mount(
    frames: str | Path,
    board: Board,
    out: str | Path | None = None,
    *,
    camera: str | Path | None = None,
    board_rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0),
    board_on: str = ON_BODY,
    begin: str | None = None,
    every: int = 1,
    overwrite: bool = False,
    progress: Progress = silent,
) -> MountCalibration:
    """The attitude of a mount as a time series, from frames of a chessboard, written for `[mount] attitude`.

    The board is on the vehicle and the camera on the mount, or the other way round. The mount's attitude in the first
    frame with the board is zero: `[lidar]` states the scanner in the vehicle frame as it is then.

    Args:
        frames: folder of images, a table of their files and times, or a video. In a folder, such a table gives the
            times, else the EXIF data.
        board: its inner corners and squares.
        out: the CSV; by default mount.csv beside the folder or in that of the table.
        camera: session file whose `[camera]` has the intrinsics; without it they are estimated from the frames.
        board_rpy_deg: roll, pitch, yaw of the board's axes in the vehicle frame, in the first frame.
        board_on: "body" or "mount".
        begin: of a video, the time of its first frame in ISO 8601 (UTC, or with a zone); the others follow by the
            times in the video.
        every: use every n-th frame.

    Raises:
        InputError: if frames, table or camera cannot be read, or a video comes without its time.
        RefusedError: if the frames show the board too seldom, or the file exists.
    """
    expect_opencv()
    expect_pillow()
    source = Path(frames)
    target = Path(out) if out is not None else resolved(source).with_name("mount.csv")
    if target.exists() and not overwrite:
        raise RefusedError("output-exists", target=target)
    stated = None
    if camera is not None:
        table = load_session(Path(camera)).camera
        if table is None or not table.is_known:
            raise InputError("no-camera", session_file=Path(camera))
        stated = camera_of(table) if table.has_intrinsics else open_session(Path(camera)).camera()
    looked_at, count, notices = _frames(source, begin, every)
    times_s, corners, size = _corners(looked_at, count, board, progress)
    if size is None:
        raise InputError("no-images.none-readable", paths=source, images=len(times_s))
    found = board_poses(corners, board, size, stated)
    turned = mount_attitude(found.rotation, Mounting(rpy_deg=board_rpy_deg).rotation, board_on)
    t_s = times_s[found.frame] + found.camera.shutter_delay_s
    with atomic_output(target) as unfinished:
        rows = np.column_stack([t_s, *turned, found.sigma_deg, found.rms_px])
        np.savetxt(unfinished, rows, ["%.6f", *["%.5f"] * 4, "%.4f"], ",", header=MOUNT_HEADER, comments="")
    notices += board_notices(found, len(times_s))
    return MountCalibration(
        target, t_s, *turned, found.sigma_deg, found.rms_px, len(times_s), found.camera, tuple(notices)
    )


def _frames(source: Path, begin: str | None, every: int) -> tuple[Iterable[tuple[float, Picture]], int, list[Notice]]:
    """UTC and picture of the frames to look at, their number, which is an estimate for some videos, and notices."""
    if source.suffix.lower() in VIDEO_SUFFIXES and source.is_file():
        if begin is None:
            raise InputError("video-no-time", path=source)
        try:
            begin_s = unix_time(begin)
        except ValueError:
            raise InputError("video-no-time.not-a-time", path=source, text=begin) from None
        video = Video(source)
        return ((begin_s + at_s, pixels) for at_s, pixels in video.frames(every)), -(-video.count // every), []
    if begin is not None:
        raise InputError("video-only", source=source)
    if source.is_dir():
        tables = [path for path in sorted(source.glob("*.csv")) if is_image_table(path)]
        files = [path for path in sorted(source.iterdir()) if path.suffix.lower() in IMAGE_SUFFIXES]
        images, notices = read_image_table(tables[0], source) if tables else exif_images(files)
    else:
        images, notices = read_image_table(source, resolved(source).parent)
    if not len(images):
        raise InputError("no-images", source=source)
    some = list(zip(images.t_s.tolist(), images.paths, strict=True))[::every]
    return some, len(some), notices


def _corners(
    frames: Iterable[tuple[float, Picture]], count: int, board: Board, progress: Progress
) -> tuple[FloatArray, list[FloatArray | None], tuple[int, int] | None]:
    """The times (n,) of the frames, the corners in each, and the size of the frames; None if none can be read."""

    def look(image: Picture) -> tuple[FloatArray | None, tuple[int, int] | None]:
        try:
            pixels = image if isinstance(image, np.ndarray) else read_pixels(image, 1)
        except ValueError:
            return None, None
        return find_corners(pixels, board), (pixels.shape[1], pixels.shape[0])

    times_s = []
    found = []
    waiting: deque[Future[tuple[FloatArray | None, tuple[int, int] | None]]] = deque()

    def take() -> None:
        found.append(waiting.popleft().result())
        progress("looking for the board", min(len(found) / max(count, 1), 1.0))

    with ThreadPoolExecutor(threads()) as pool:
        for at_s, image in frames:
            times_s.append(at_s)
            waiting.append(pool.submit(look, image))
            if len(waiting) > 2 * threads():  # the frames of a video do not fit into memory
                take()
        while waiting:
            take()
    size = next((size for _, size in found if size is not None), None)
    return np.array(times_s), [corners if at == size else None for corners, at in found], size
