"""Colours of points from the frames that see them, and true orthophotos: a surface in these colours."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.images.balance import Balance, balance_frames
from furrowmap.core.images.image_frames import Frames
from furrowmap.core.images.pinhole import pixel_of
from furrowmap.core.images.visibility import MIN_DISTANCE_M, SLACK_M, Visibility, VisibilityMaker
from furrowmap.core.readers.image_pixels import read_pixels
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.kernels import kernel, kernel_part
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.runtime.settings import threads
from furrowmap.core.surfaces.grid import Grid

BALANCE_SAMPLES: Final = 8_000
"""Points from whose colours in several frames these are balanced."""
MAX_OBSERVATIONS: Final = 400_000


class ColourMaker:
    """Takes the points of a cloud, against a local origin, in pieces, and gives what colours them from frames."""

    def __init__(self, frames: Frames, origin_m: tuple[float, float, float]) -> None:
        self._frames = frames
        self._visibility = VisibilityMaker(frames, origin_m)
        self._samples: list[FloatArray] = []
        self._every = 1
        self._next = 0
        self._count = 0

    def add(self, xyz_m: FloatArray) -> None:
        """Points (n, 3) of surfaces, which hide what is behind them, against the local origin."""
        self._visibility.add(xyz_m)
        chosen = xyz_m[self._next :: self._every]
        self._next = (self._next - len(xyz_m)) % self._every
        self._samples.append(chosen.copy())
        self._count += len(chosen)
        while self._count > 2 * BALANCE_SAMPLES:
            kept = np.concatenate(self._samples)[::2]
            self._samples = [kept]
            self._count = len(kept)
            self._every = 2 * self._every

    def finish(self, progress: Progress = silent) -> "Colours":
        """What colours the points, after stage "reading images"; the maker cannot be used any more.

        Raises OSError if the disk has no room for the images.
        """
        visibility = self._visibility.finish()
        pixels, notices = decode_frames(self._frames, progress)
        samples = np.concatenate([np.zeros((0, 3)), *self._samples])
        point, frame, at_px, levels = observations(samples, visibility, pixels, MAX_OBSERVATIONS)
        middle = 0.5 * (visibility.views.size - 1.0)
        radius = np.linalg.norm(at_px - middle, axis=1) / (0.5 * np.linalg.norm(visibility.views.size))
        balance = balance_frames(len(self._frames), point, frame, radius, levels)
        return Colours(visibility, pixels, balance, self._frames.poses.t_s, notices)


MAX_PIXEL_BYTES: Final = 6_000_000_000
"""On disk, of all frames together; larger ones are reduced by 2, 4, ... until they fit."""


class FramePixels(NamedTuple):
    """Pixels of all frames.

    Attributes:
        rgb: (n, height, width, 3) uint8; each pixel is the mean of a square of the image's.
        usable: (n,) which could be read.
        reduction: side of the squares.
    """

    rgb: NDArray[np.uint8]
    usable: NDArray[np.bool_]
    reduction: int


def decode_frames(frames: Frames, progress: Progress = silent) -> tuple[FramePixels, tuple[Notice, ...]]:
    """Decode all frames, stage "reading images"; a notice counts those that could not be read.

    Raises OSError if the disk has no room for them.
    """
    camera = frames.camera
    reduction = 1
    least = min(camera.width, camera.height)
    while 3 * len(frames) * camera.width * camera.height / reduction**2 > MAX_PIXEL_BYTES and 2 * reduction <= least:
        reduction *= 2
    small = camera.reduced(reduction)
    rgb = arrays.zeros((len(frames), small.height, small.width, 3), np.uint8)
    faults: list[str] = [""] * len(frames)

    def decode(k: int) -> None:
        try:
            pixels = read_pixels(frames.paths[k], reduction)
        except ValueError as error:
            faults[k] = str(error)
            return
        if pixels.shape[:2] == (small.height, small.width):
            rgb[k] = pixels
        else:
            height, width = pixels.shape[:2]
            faults[k] = f"{frames.paths[k]}: {width * reduction} × {height * reduction} pixels"

    with ThreadPoolExecutor(threads()) as pool:
        for k, _ in enumerate(pool.map(decode, range(len(frames)))):
            progress("reading images", (k + 1) / len(frames))
    bad = [fault for fault in faults if fault]
    notices = []
    if bad:
        notices.append(
            Notice(
                "images-not-decoded",
                bad=len(bad),
                frames=len(frames),
                width=camera.width,
                height=camera.height,
                bad_first=bad[0],
            )
        )
    return FramePixels(rgb, np.array([not fault for fault in faults], bool), reduction), tuple(notices)


TIME_S: Final = 30.0
"""A frame so much farther in time counts as twice as far in space."""
OFF_AXIS: Final = 3.0
"""Weight of the squared tangent of the angle off the axis: at 45° a frame counts as four times as far."""
BORDER_PX: Final = 1.5
"""Pixels at the border of an image that are not used."""
TO_16_BIT: Final = 257.0
"""255 becomes 65535."""
SHARPNESS: Final = 8
"""Weights of blended frames fall with this power of their distance: a seam is soft where both are nearly as good."""
NO_FRAME: Final = -1
FINER: Final = (5, 4, 2, 1)
"""Pixels of an orthophoto across a cell of the surface."""
OPAQUE: Final = 255


class ShownPart(NamedTuple):
    """The part of a surface that an orthophoto shows.

    Attributes:
        height_m: (rows, columns) float32 of the surface, or nan.
        row: the first in the picture.
        column: the first in the picture.
        corner_m: (3,) easting and northing of its upper left corner, and zero of the heights.
        finer: pixels across a cell.
    """

    height_m: NDArray[np.float32]
    row: int
    column: int
    corner_m: FloatArray
    finer: int
    pixel_m: float


@dataclass(frozen=True)
class Colours:
    """What gives points their colours: the frames at times (n,), and the balance of their exposures."""

    visibility: Visibility
    pixels: FramePixels
    balance: Balance
    t_s: FloatArray
    notices: tuple[Notice, ...]

    def of_points(self, xyz_m: FloatArray, t_s: FloatArray) -> tuple[NDArray[np.uint16], NDArray[np.int32]]:
        """The colour of each point in the best frame that sees it.

        The best is the nearest in space, angle off the optical axis and time: least is
        ``depth · (1 + 3 tan²) · (1 + |Δt| / 30 s)``.

        Args:
            xyz_m: (n, 3) against the local origin.
            t_s: (n,) UTC of the points; nan where it does not matter.

        Returns:
            (3, n) uint16 red, green, blue, at least 1 each, and 0 where no frame sees the point; (n,) int32 index of
            the frame, or −1.
        """
        rgb = np.zeros((3, len(xyz_m)), np.uint16)
        frame = np.full(len(xyz_m), NO_FRAME, np.int32)
        points = np.ascontiguousarray(xyz_m, np.float64)
        times = np.ascontiguousarray(t_s, np.float64)
        best_colours(points, times, self.t_s, self.visibility, self.pixels, self.balance, rgb, frame)
        return rgb, frame

    def pixels_a_cell(self, cell_m: float) -> int:
        """The number of pixels across a cell of a surface for which pixels are not smaller than those of the frames."""
        near = [float(np.median(known)) for one in self.visibility.depth_m if len(known := one[np.isfinite(one)])]
        if not near:
            return FINER[-1]
        on_ground_m = float(np.median(near)) * self.pixels.reduction / float(self.visibility.views.intrinsics[0])
        return next((finer for finer in FINER if cell_m / finer >= on_ground_m), FINER[-1])

    def orthophoto(
        self, wide: Grid, height_m: NDArray[np.float32], part: Grid, finer: int, origin_m: tuple[float, ...]
    ) -> NDArray[np.uint8]:
        """The true orthophoto (4, rows, columns) of a part of a surface: red, green, blue, 255; 0 where none is seen.

        Heights between the middles of cells are interpolated linearly, to `finer` pixels across each; where a cell has
        none there is no picture. Places that are hidden in all frames have none either. `wide` is the part and a margin
        of one cell, as far as the surface goes, with heights or nan.
        """
        rows, columns = part.window_in(wide)
        out = np.zeros((4, part.rows * finer, part.columns * finer), np.uint8)
        corner = np.array([part.bounds_m[0], part.bounds_m[3], 0.0]) - origin_m
        shown = ShownPart(height_m, rows.start, columns.start, corner, finer, part.cell_m / finer)
        blended_colours(shown, self.visibility, self.pixels, self.balance, out)
        return out


@kernel_part(error_model="numpy", fastmath={"contract", "arcp"})
def cell_of(east, north, index):  # type: ignore[no-untyped-def]
    """Number of the index's cell of a place; places beyond are in the outermost cells."""
    rows = (len(index.start) - 1) // index.columns
    row = min(max(int((north - index.corner_m[1]) / index.cell_m), 0), rows - 1)
    column = min(max(int((east - index.corner_m[0]) / index.cell_m), 0), index.columns - 1)
    return row * index.columns + column


@kernel_part(error_model="numpy", fastmath={"contract", "arcp"})
def direction(east, north, up, view, k):  # type: ignore[no-untyped-def]
    """Tangents x / z and y / z, and depth z, of a point in the optical frame."""
    centre = view.centre_m
    matrix = view.matrix
    dx = east - centre[k, 0]
    dy = north - centre[k, 1]
    dz = up - centre[k, 2]
    z = matrix[k, 2, 0] * dx + matrix[k, 2, 1] * dy + matrix[k, 2, 2] * dz
    x = matrix[k, 0, 0] * dx + matrix[k, 0, 1] * dy + matrix[k, 0, 2] * dz
    y = matrix[k, 1, 0] * dx + matrix[k, 1, 1] * dy + matrix[k, 1, 2] * dz
    return x / z, y / z, z


@kernel_part(error_model="numpy", fastmath={"contract", "arcp"})
def is_seen(u, v, z, visibility, k):  # type: ignore[no-untyped-def]
    """Whether a pixel is inside the image and nothing lies before the depth z."""
    size = visibility.views.size
    if not (BORDER_PX <= u <= size[0] - 1.0 - BORDER_PX and BORDER_PX <= v <= size[1] - 1.0 - BORDER_PX):
        return False
    nearest = visibility.depth_m[k, int((v + 0.5) / visibility.cell_px), int((u + 0.5) / visibility.cell_px)]
    return z <= nearest + SLACK_M + visibility.slack[k] * nearest


@kernel_part(error_model="numpy", fastmath={"contract", "arcp"})
def level(pixels, k, u, v, channel):  # type: ignore[no-untyped-def]
    """The grey level (0 to 255) of a channel at a pixel of the unreduced image, bilinear."""
    rgb = pixels.rgb
    reduction = pixels.reduction
    at_u = min(max((u - 0.5 * (reduction - 1)) / reduction, 0.0), rgb.shape[2] - 1.001)
    at_v = min(max((v - 0.5 * (reduction - 1)) / reduction, 0.0), rgb.shape[1] - 1.001)
    column = int(at_u)
    row = int(at_v)
    right = at_u - column
    down = at_v - row
    above = (1.0 - right) * rgb[k, row, column, channel] + right * rgb[k, row, column + 1, channel]
    below = (1.0 - right) * rgb[k, row + 1, column, channel] + right * rgb[k, row + 1, column + 1, channel]
    return (1.0 - down) * above + down * below


@kernel_part(error_model="numpy", fastmath={"contract", "arcp"})
def darkening(u, v, size, vignetting):  # type: ignore[no-untyped-def]
    """Logarithm of the vignetting at a pixel."""
    du = u - 0.5 * (size[0] - 1.0)
    dv = v - 0.5 * (size[1] - 1.0)
    square = 4.0 * (du * du + dv * dv) / (size[0] * size[0] + size[1] * size[1])
    return square * (vignetting[0] + square * (vignetting[1] + square * vignetting[2]))


@kernel_part(error_model="numpy", fastmath={"contract", "arcp"})
def best_colours(xyz, t_s, frame_s, visibility, pixels, balance, out, out_frame):  # type: ignore[no-untyped-def]
    """Kernel of :meth:`Colours.of_points`."""
    view = visibility.views
    index = visibility.places
    for i in range(len(xyz)):
        cell = cell_of(xyz[i, 0], xyz[i, 1], index)
        best = np.inf
        best_k = NO_FRAME
        best_u = 0.0
        best_v = 0.0
        for at in range(index.start[cell], index.start[cell + 1]):
            k = index.frames[at]
            if not pixels.usable[k]:
                continue
            x, y, z = direction(xyz[i, 0], xyz[i, 1], xyz[i, 2], view, k)
            square = x * x + y * y
            if not (z > MIN_DISTANCE_M and square <= view.widest * view.widest):
                continue
            apart = abs(t_s[i] - frame_s[k])
            cost = z * (1.0 + OFF_AXIS * square) * (1.0 + (apart / TIME_S if apart >= 0.0 else 0.0))
            if cost >= best:
                continue
            u, v = pixel_of(view.intrinsics, x, y)
            if is_seen(u, v, z, visibility, k):
                best = cost
                best_k = k
                best_u = u
                best_v = v
        if best_k == NO_FRAME:
            continue
        bright = np.exp(-darkening(best_u, best_v, view.size, balance.vignetting)) * TO_16_BIT
        for channel in range(3):
            value = level(pixels, best_k, best_u, best_v, channel) * bright * balance.factor[best_k, channel]
            out[channel, i] = np.uint16(min(max(value + 0.5, 1.0), 65535.0))
        out_frame[i] = best_k


@kernel(error_model="numpy", fastmath={"contract", "arcp"})
def blended_colours(shown, visibility, pixels, balance, out):  # type: ignore[no-untyped-def]
    """Kernel of :meth:`Colours.orthophoto`."""
    finer = shown.finer
    rise = np.empty((finer, finer))
    sums = np.empty((finer, finer, 4))
    for row in range(out.shape[1] // finer):
        for column in range(out.shape[2] // finer):
            blend_cell(row, column, shown, visibility, pixels, balance, rise, sums, out)


@kernel_part(error_model="numpy", fastmath={"contract", "arcp"})
def blend_cell(row, column, shown, visibility, pixels, balance, rise, sums, out):  # type: ignore[no-untyped-def]
    """The pixels of a cell; the weights of the frames are those of its middle. `rise` and `sums` are room for it."""
    view = visibility.views
    index = visibility.places
    finer = shown.finer
    pixel_m = shown.pixel_m
    middle = 0.5 * (finer - 1.0)
    own = shown.height_m[shown.row + row, shown.column + column]
    e_m = shown.corner_m[0] + (column + 0.5) * finer * pixel_m
    n_m = shown.corner_m[1] - (row + 0.5) * finer * pixel_m
    cell = cell_of(e_m, n_m, index)
    if not np.isfinite(own) or index.start[cell] == index.start[cell + 1]:
        return
    rise_within(shown.height_m, shown.row + row, shown.column + column, rise)
    sums[:] = 0.0
    for at in range(index.start[cell], index.start[cell + 1]):
        k = index.frames[at]
        if not pixels.usable[k]:
            continue
        x, y, z = direction(e_m, n_m, own + shown.corner_m[2], view, k)
        square = x * x + y * y
        if not (z > MIN_DISTANCE_M and square <= view.widest * view.widest):
            continue
        u, v = pixel_of(view.intrinsics, x, y)
        if not is_seen(u, v, -np.inf, visibility, k):
            continue
        # It fades out towards the border of the image, where a frame begins or ends.
        size = view.size
        edge = min(min(u, size[0] - 1.0 - u) / size[0], min(v, size[1] - 1.0 - v) / size[1])
        weight = min(1.0, 20.0 * edge) / (z * (1.0 + OFF_AXIS * square)) ** SHARPNESS
        bright = weight * np.exp(-darkening(u, v, size, balance.vignetting))
        for a in range(finer):
            for b in range(finer):
                at_e = e_m + (b - middle) * pixel_m
                at_n = n_m + (middle - a) * pixel_m
                up = own + shown.corner_m[2] + rise[a, b]
                at_x, at_y, at_z = direction(at_e, at_n, up, view, k)
                at_u, at_v = pixel_of(view.intrinsics, at_x, at_y)
                if not is_seen(at_u, at_v, at_z, visibility, k):
                    continue
                sums[a, b, 3] += weight
                for channel in range(3):
                    grey = level(pixels, k, at_u, at_v, channel)
                    sums[a, b, channel] += grey * bright * balance.factor[k, channel]
    for a in range(finer):
        for b in range(finer):
            if sums[a, b, 3] > 0.0:
                i = row * finer + a
                j = column * finer + b
                out[3, i, j] = OPAQUE
                for channel in range(3):
                    out[channel, i, j] = np.uint8(min(sums[a, b, channel] / sums[a, b, 3], 255.0) + 0.5)


@kernel_part()
def rise_within(height, row, column, out):  # type: ignore[no-untyped-def]
    """Heights of the pixels (n, n) of a cell above its own, linear between the middles of known cells."""
    n = len(out)
    for a in range(n):
        down = (a + 0.5) / n - 0.5
        next_row = min(max(row + (1 if down > 0.0 else -1), 0), height.shape[0] - 1)
        for b in range(n):
            right = (b + 0.5) / n - 0.5
            next_column = min(max(column + (1 if right > 0.0 else -1), 0), height.shape[1] - 1)
            known = sums = 0.0
            for i in range(2):
                for j in range(2):
                    beside = height[next_row if i else row, next_column if j else column]
                    if np.isfinite(beside):
                        share = (abs(down) if i else 1.0 - abs(down)) * (abs(right) if j else 1.0 - abs(right))
                        known += share
                        sums += share * (beside - height[row, column])
            out[a, b] = sums / known


@kernel(error_model="numpy", fastmath={"contract", "arcp"})
def observations(xyz, visibility, pixels, most):  # type: ignore[no-untyped-def]
    """Every frame's levels of points: point, frame, pixel (m, 2) and levels (m, 3); at most `most`."""
    view = visibility.views
    index = visibility.places
    point = np.empty(most, np.int32)
    frame = np.empty(most, np.int32)
    at_px = np.empty((most, 2))
    levels = np.empty((most, 3))
    count = 0
    for i in range(len(xyz)):
        cell = cell_of(xyz[i, 0], xyz[i, 1], index)
        for at in range(index.start[cell], index.start[cell + 1]):
            k = index.frames[at]
            if not pixels.usable[k] or count == most:
                continue
            x, y, z = direction(xyz[i, 0], xyz[i, 1], xyz[i, 2], view, k)
            if not (z > MIN_DISTANCE_M and x * x + y * y <= view.widest * view.widest):
                continue
            u, v = pixel_of(view.intrinsics, x, y)
            if not is_seen(u, v, z, visibility, k):
                continue
            point[count] = i
            frame[count] = k
            at_px[count, 0] = u
            at_px[count, 1] = v
            for channel in range(3):
                levels[count, channel] = level(pixels, k, u, v, channel)
            count += 1
    return point[:count], frame[:count], at_px[:count], levels[:count]
