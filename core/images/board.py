"""Poses of a chessboard in images, and the attitude of a mount that turns against a board."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.images.pinhole import project
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import MissingExtraError, Notice, RefusedError
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.camera import Camera

PIVOT_ITERATIONS: Final = 12
PIVOT_STEP_M: Final = 1e-5
"""For slopes of the projection."""
MIN_PIVOT_FRAMES: Final = 4
"""With fewer frames no pivot is estimated."""
MAX_PIVOT_RMS_RATIO: Final = 1.3
"""Where the residuals of corners grow by more with a pivot, there is none."""
PRIOR_M: Final = 10.0
"""Standard deviation of the pivot's place, for mounts that hardly turn."""


@dataclass(frozen=True)
class Turned:
    """Poses with a common pivot.

    `rotation` (n, 3, 3) is board to optical frame; `rms_px` (n,) of the corners' distances; `sigma_deg` (n,) of the
    attitude, the largest of the three axes.
    """

    rotation: FloatArray
    rms_px: FloatArray
    sigma_deg: FloatArray


def about_pivot(
    rotation: FloatArray, place_m: FloatArray, corners: FloatArray, points_m: FloatArray, camera: Camera
) -> Turned:
    """Gauss-Newton adjustment of all attitudes, of the pivot on the board's frame, and of it in the optical frame.

    A point X of the board is at ``R (X − q) + c``, with q and c the pivot in both frames, the same for all.

    Args:
        rotation: (n, 3, 3) board to optical frame, to begin with.
        place_m: (n, 3) the board's origin in the optical frame, to begin with.
        corners: (n, m, 2) pixels.
        points_m: (m, 3) corners of the board.
    """
    count = len(rotation)
    turned = rotation.copy()
    design = np.concatenate([np.concatenate([np.eye(3), -turn], axis=1) for turn in turned])
    both = np.linalg.lstsq(
        np.concatenate([design, np.eye(6) / PRIOR_M]), np.concatenate([place_m.ravel(), np.zeros(6)]), rcond=None
    )[0]
    for _ in range(PIVOT_ITERATIONS):
        left, own, shared = _linear(turned, both, corners, points_m, camera)
        inner = np.linalg.inv(np.einsum("nkij,nkil->njl", own, own))
        cross = np.einsum("nkij,nkil->njl", own, shared)
        right = np.einsum("nkij,nki->nj", own, left)
        noise = float((left**2).mean())
        prior = np.eye(6) * noise / PRIOR_M**2
        normal = np.einsum("nkij,nkil->jl", shared, shared) + prior
        normal -= np.einsum("nji,njk,nkl->il", cross, inner, cross)
        sums = np.einsum("nkij,nki->j", shared, left) - prior @ both
        sums -= np.einsum("nji,njk,nk->i", cross, inner, right)
        step = np.linalg.solve(normal, sums)
        both = both + step
        turn = np.einsum("nij,nj->ni", inner, right - cross @ step)
        turned = Rotation.from_rotvec(turn).as_matrix() @ turned
    left, _, _ = _linear(turned, both, corners, points_m, camera)
    gain = inner @ cross
    covariance = inner + gain @ np.linalg.inv(normal) @ gain.transpose(0, 2, 1)
    noise = float((left**2).sum() / max(left.size - 3 * count - 6, 1))
    sigma = np.sqrt(noise * np.diagonal(covariance, axis1=1, axis2=2).max(axis=1))
    return Turned(turned, np.sqrt((left**2).sum(axis=2).mean(axis=1)), np.degrees(sigma))


def _linear(
    rotation: FloatArray, both: FloatArray, corners: FloatArray, points_m: FloatArray, camera: Camera
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Residuals (n, m, 2), and slopes of the pixels by the turn (n, m, 2, 3) and by both places (n, m, 2, 6)."""
    arm = np.einsum("nij,mj->nmi", rotation, points_m - both[3:])
    at = arm + both[:3]
    pixels = project(camera, at.reshape(-1, 3)).reshape(corners.shape)
    slopes = np.stack(
        [
            (project(camera, (at + shift).reshape(-1, 3)).reshape(corners.shape) - pixels) / PIVOT_STEP_M
            for shift in PIVOT_STEP_M * np.eye(3)
        ],
        axis=-1,
    )
    own = np.cross(arm[:, :, None, :], slopes)  # the slope by a turn δ is (R (X − q)) × slope
    shared = np.concatenate([slopes, -np.einsum("nmij,njk->nmik", slopes, rotation)], axis=-1)
    return corners - pixels, own, shared


ON_BODY: Final = "body"
ON_MOUNT: Final = "mount"
"""Where the board is; the camera is on the other."""
MIN_BOARDS: Final = 3
"""Frames with the board, from which a camera can be estimated."""
MAX_CAMERA_FRAMES: Final = 40
AMBIGUOUS_RMS_RATIO: Final = 2.0
"""Of the two poses that a plane may have, the better one is taken where the other's residuals are this much larger."""
CORNER_WINDOW: Final = 0.4
MAX_CORNER_WINDOW_PX: Final = 20
"""Half the side of the window in which a corner is refined: a share of the distance to the next one, and the most."""


@dataclass(frozen=True)
class Board:
    """A chessboard.

    Its axes: x along the rows of corners, y along the columns, z = x × y, so that x right and y down make z point away
    from a viewer. The first corner is the one whose square on the inner side is black; boards with both numbers odd or
    both even look the same turned by half, and are taken as in the first frame.

    Attributes:
        columns: inner corners in a row.
        rows: of inner corners.
        square_m: length of the sides of a square.
    """

    columns: int
    rows: int
    square_m: float

    @property
    def corners_m(self) -> FloatArray:
        """(n, 3) inner corners, row by row."""
        row, column = np.mgrid[0 : self.rows, 0 : self.columns]
        return np.column_stack([column.ravel(), row.ravel(), np.zeros(row.size)]) * self.square_m


@dataclass(frozen=True)
class BoardPoses:
    """Rotations of the board in the frames that show it.

    Attributes:
        frame: (n,) index of the frame.
        rotation: (n, 3, 3) board to optical frame.
        rms_px: (n,) root mean square of the distances of corners, in pixels.
        sigma_deg: (n,) standard deviation of the attitude, the largest of the three axes.
        estimated: whether they were estimated from the frames.
        has_pivot: whether all frames fit a mount that turns about a point, and were adjusted together.
    """

    frame: NDArray[np.intp]
    rotation: FloatArray
    rms_px: FloatArray
    sigma_deg: FloatArray
    camera: Camera
    estimated: bool
    has_pivot: bool


def expect_opencv() -> None:
    """Raise InputError where OpenCV, which looks for boards, is not installed."""
    if find_spec("cv2") is None:
        raise MissingExtraError("OpenCV", "photo", Text("Boards are found in images by it."))


def find_corners(image: NDArray[np.uint8], board: Board) -> FloatArray | None:
    """Inner corners (n, 2) of the board in an image (height, width, 3), row by row; None if they are not all found."""
    import cv2

    grey: NDArray[np.uint8] = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE
    found, corners = cv2.findChessboardCornersSB(grey, (board.columns, board.rows), flags=flags)
    if not found:
        return None
    grid = np.asarray(corners, np.float32).reshape(board.rows, board.columns, 2)
    apart = min(float(np.linalg.norm(np.diff(grid, axis=k), axis=2).min()) for k in (0, 1))
    half = max(2, min(MAX_CORNER_WINDOW_PX, int(CORNER_WINDOW * apart)))
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
    refined = cv2.cornerSubPix(grey, grid.reshape(-1, 1, 2), (half, half), (-1, -1), criteria)
    out: FloatArray = np.asarray(refined, np.float64).reshape(-1, 2)
    places = out.reshape(board.rows, board.columns, 2)
    squares = [places[:2, k : k + 2].reshape(4, 2).mean(axis=0) for k in (0, 1)]
    first, second = (float(grey[round(at[1]), round(at[0])]) for at in squares)
    # The square inside the first corner is the black one.
    return out[::-1].copy() if (board.columns + board.rows) % 2 and first > second else out


def board_poses(
    corners: Sequence[FloatArray | None], board: Board, size: tuple[int, int], camera: Camera | None
) -> BoardPoses:
    """The rotations of the board, from its corners in frames.

    The two poses that a plane may have (IPPE, Collins and Bartoli 2014) are both refined; the better one is taken, and
    where they hardly differ the one nearer to the frame before. Then all frames are adjusted with a common pivot, if
    they fit one. Raises RefusedError if the frames show the board too seldom. `corners` (n, 2) are None where the board
    was not found; without a `camera` it is estimated from the frames (Zhang 2000).
    """
    frame = np.array([k for k, found in enumerate(corners) if found is not None], np.intp)
    shown = [found for found in corners if found is not None]
    if len(shown) < (1 if camera is not None else MIN_BOARDS):
        raise RefusedError(
            "board-not-found", columns=board.columns, rows=board.rows, shown=len(shown), corners=len(corners)
        )
    used = camera if camera is not None else _estimate_camera(shown, board, size)
    poses: list[_Pose] = []
    for found in shown:
        poses.append(_pose(found, board, used, poses[-1].rotation if poses else None))
    rotation = np.array([pose.rotation for pose in poses])
    rms = np.array([pose.rms_px for pose in poses])
    if len(poses) >= MIN_PIVOT_FRAMES:
        place = np.array([pose.place_m for pose in poses])
        ordered = np.array([pose.corners for pose in poses])
        turned = about_pivot(rotation, place, ordered, board.corners_m, used)
        if np.sqrt((turned.rms_px**2).mean()) < MAX_PIVOT_RMS_RATIO * np.sqrt((rms**2).mean()):
            rotation = turned.rotation
            rms = turned.rms_px
            sigma = turned.sigma_deg
            return BoardPoses(frame, rotation, rms, sigma, used, camera is None, has_pivot=True)
    sigma = np.array([pose.sigma_deg for pose in poses])
    return BoardPoses(frame, rotation, rms, sigma, used, camera is None, has_pivot=False)


@dataclass(frozen=True)
class _Pose:
    """The board in a frame: rotation (3, 3) and place (3,) of its origin, its corners in its order, and errors."""

    rotation: FloatArray
    place_m: FloatArray
    corners: FloatArray
    rms_px: float
    sigma_deg: float


def _estimate_camera(shown: Sequence[FloatArray], board: Board, size: tuple[int, int]) -> Camera:
    """The camera by Zhang's method."""
    import cv2

    some = [shown[k] for k in np.unique(np.linspace(0, len(shown) - 1, MAX_CAMERA_FRAMES).astype(int))]
    points = [board.corners_m.astype(np.float32)] * len(some)
    flags = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
    _, matrix, bent, _, _ = cv2.calibrateCamera(
        points, [corners.astype(np.float32) for corners in some], size, None, None, flags=flags
    )
    k1, k2, p1, p2 = np.asarray(bent, np.float64).ravel()[:4].tolist()
    return Camera(*size, matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], k1=k1, k2=k2, p1=p1, p2=p2)


def _pose(corners: FloatArray, board: Board, camera: Camera, before: FloatArray | None) -> _Pose:
    """The board in a frame."""
    import cv2

    points = board.corners_m
    matrix = camera.matrix
    bent = camera.distortion
    turned = [corners] if before is None or (board.columns + board.rows) % 2 else [corners, corners[::-1].copy()]
    tried: list[tuple[float, _Pose]] = []
    for each in turned:
        _, ways, shifts, _ = cv2.solvePnPGeneric(points, each, matrix, bent, flags=cv2.SOLVEPNP_IPPE)
        for way, shift in zip(ways, shifts, strict=True):
            refined, at = cv2.solvePnPRefineLM(points, each, matrix, bent, way, shift)
            seen, slopes = cv2.projectPoints(points, refined, at, matrix, bent)
            error = float(np.sqrt(((seen.reshape(-1, 2) - each) ** 2).sum(axis=1).mean()))
            rotation = Rotation.from_rotvec(np.asarray(refined).ravel()).as_matrix()
            apart = 0.0 if before is None else float(Rotation.from_matrix(rotation @ before.T).magnitude())
            covariance = 0.5 * error**2 * np.linalg.pinv(slopes[:, :6].T @ slopes[:, :6])
            sigma_deg = float(np.degrees(np.sqrt(np.diag(covariance)[:3].max())))
            tried.append((apart, _Pose(rotation, np.asarray(at, np.float64).ravel(), each, error, sigma_deg)))
    least = min(pose.rms_px for _, pose in tried)
    likely = [one for one in tried if one[1].rms_px <= AMBIGUOUS_RMS_RATIO * least]
    return min(likely, key=lambda one: (one[0], one[1].rms_px))[1]


def mount_attitude(
    rotation: FloatArray, board_rotation: FloatArray, where: str
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Roll, pitch and yaw (n,) of a mount in the vehicle frame, in degrees; zero in the first frame.

    `rotation` (n, 3, 3) is board to optical frame, `board_rotation` (3, 3) the board's axes to the vehicle's in the
    first frame; `where` is "body" for a board on the vehicle and a camera on the mount, "mount" for the reverse.
    """
    since = rotation[0].T @ rotation  # of a board on the mount, in the board's own axes of the first frame
    if where == ON_BODY:
        since = since.transpose(0, 2, 1)
    turned = board_rotation @ since @ board_rotation.T
    yaw, pitch, roll = Rotation.from_matrix(turned).as_euler("ZYX", degrees=True).T
    return roll, pitch, yaw


def board_notices(found: BoardPoses, count: int) -> list[Notice]:
    """What to know of the result: frames without the board, and a camera that was estimated."""
    notices = []
    if len(found.frame) < count:
        missing = count - len(found.frame)
        notices.append(Notice("board-not-in-frames", missing=missing, count=count))
    if found.estimated:
        camera = found.camera
        notices.append(
            Notice(
                "camera-estimated", fx=camera.fx, fy=camera.fy, cx=camera.cx, cy=camera.cy, k1=camera.k1, k2=camera.k2
            )
        )
    return notices
