"""Ray casting: the compiled loop over firings and lasers.

A beam is followed in two frames. The tractor's body and its tool stand still in the vehicle frame, the tool but for its
height; ground, walls and posts stand still in the local frame. The nearest counts. On the ground, blocks whose highest
point lies below the beam are skipped; elsewhere it is followed in steps shorter than a cell, and the place where it
dips into the relief is found by bisection.

Chance is drawn by number of firing and laser (SplitMix64: Steele, Lea and Flood 2014, Fast splittable pseudorandom
number generators), so that the result does not depend on how the firings are shared out among threads.
"""

import math
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from furrowmap.core.simulator.noise import Float32Array, FloatArray, random_for
from furrowmap.core.simulator.scenario import Scenario, ScenarioImplement
from furrowmap.core.simulator.site import CELL_M as CELL
from furrowmap.core.simulator.site import CROP_CELL_M as CROP_CELL
from furrowmap.core.simulator.soil_over_time import NOISE_BLOCK, Ground, ceiling_of, kernel, relief_at, tops_of


class Met(IntEnum):
    """The kind of object that a beam hits."""

    NOTHING = 0
    SOIL = 1
    TILLED = 2
    STRAW = 3
    OBJECT = 4
    IMPLEMENT = 5
    BODY = 6
    DUST = 7


_MET_SOIL: Final = int(Met.SOIL)
_MET_TILLED: Final = int(Met.TILLED)
_MET_STRAW: Final = int(Met.STRAW)
_MET_OBJECT: Final = int(Met.OBJECT)
_MET_IMPLEMENT: Final = int(Met.IMPLEMENT)
_MET_BODY: Final = int(Met.BODY)
_MET_DUST: Final = int(Met.DUST)
_BRIGHTNESS: Final = np.array([0.0, 31.0, 22.0, 54.0, 52.0, 58.0, 44.0, 12.0])
"""Reflectivity of each, in the sensor's units (255 a mirror, 100 a white sheet)."""
_BRIGHTNESS_STEP: Final = 13.0
"""Reflectivity of a wall of brightness 1."""
BOARD_DARK: Final = 6.0
"""Reflectivity of the dark quarters of a checkerboard."""

_TOOL_HEIGHT: Final = 3
_FRONT_HEIGHT: Final = 5
"""Columns of the firings with the heights of the tool, and of that in front."""
_DUST_CENTRE: Final = (-0.7, 0.6)
"""Of the dust cloud: behind the tool's line, above the ground."""
_DUST_RADII: Final = (2.1, 2.4, 1.2)
_SEPARATION_M: Final = 1.0
"""Two returns of one pulse nearer than this are one (VLP-16 User Manual 63-9243, section on return modes)."""
_CELL_SHARE: Final = 0.8
_CROP_SHARE: Final = 0.2
"""Half of a crop row's width as a share of the distance of rows."""
_ROUNDING_M: Final = 1e-6
"""Something may be met so much above the highest in a cell, which is a sum of float32."""
_FAINT: Final = 0.0082
"""Reflectivity · cos(incidence) / range² at which one pulse in e is lost: soil at 17 m from a sensor 2.4 m high."""


class Scene(NamedTuple):
    """Everything a beam may meet.

    Attributes:
        straw: share of the ground, highest, chance to stop a beam; where it stands in rows, a step across these per
            metre to the east and to the north, and its count at the local origin, else zeros.
        walls: (n, 9) east, north, cosine and sine of the direction, half length, half thickness, bottom, top,
            reflectivity.
        posts: (n, 5) east, north, radius, bottom, top.
        targets: (n, 6) discs and checkerboards on the ground: east, north, half of the diameter or side, azimuth of an
            edge in radians (nan of a disc), reflectivity of a disc or the bright quarters, of the dark quarters.
        body: (n, 6) boxes in the vehicle frame.
        tool: (n, 7) boxes in the vehicle frame, the tool in working position, and the column of the firings that has
            its height.
        dust: (6,) centre and radii of the dust cloud in the vehicle frame.
        crop: (rows, cols) height of the crop on cells of CROP_CELL_M; (0, 0) where there is none.
        extinction: of the crop, a metre of beam.
        tops: (rows, cols) highest relief ever of a cell and of the cells round it, with straw and crop.
        highest: of all ceilings of the ground.
    """

    ground: Ground
    straw: FloatArray
    walls: FloatArray
    posts: FloatArray
    targets: FloatArray
    body: FloatArray
    tool: FloatArray
    dust: FloatArray
    crop: NDArray[np.float32]
    extinction: float
    tops: Float32Array
    highest: float


@dataclass(frozen=True)
class Beams:
    """Where the k lasers of a scanner point, and how it counts their ranges.

    Attributes:
        azimuth_deg: (k,) azimuth of each laser relative to that of the firing, clockwise from above.
        height_m: (k,) height of each beam's origin above the sensor's origin.
        laser_s: (k,) firing time of each laser in the firing.
        origin_m: distance of the beams' origins from the axis, in the direction of the firing; ranges are larger by it.
        zero_deg: azimuth in the sensor's frame at which a turn begins.
    """

    elevation_deg: FloatArray
    azimuth_deg: FloatArray
    height_m: FloatArray
    laser_s: FloatArray
    step_m: float
    origin_m: float = 0.0
    zero_deg: float = 0.0


class Optics(NamedTuple):
    """The sensor and what disturbs it.

    Attributes:
        mount: (3, 4) rotation from sensor to vehicle, and origin.
        lasers: (k, 6) cosine and sine of elevation, vertical offset, range error, azimuth in radians, firing time.
        noise: range noise, its growth at grazing angles, dropout, dust a metre.
    """

    mount: FloatArray
    lasers: FloatArray
    noise: FloatArray
    reach: FloatArray
    origin_m: float
    step_m: float
    seed: int


@dataclass(frozen=True)
class Firings:
    """Successive firings and where the sensor was.

    Attributes:
        azimuth_rad: (n,) of the first laser.
        turn_radps: (n,) speed of rotation.
        xyz_m: (n, 3) vehicle frame's origin, local.
        rotation: (n, 3, 3) vehicle to local.
        dusty: (n,) 0 to 1.
        mount: (n, 3, 4) as :attr:`Optics.mount`, where it moves; (0, 3, 4) where it does not.
        front_m: (n,) height of the tool in front; (0,) where there is none.
    """

    number: int
    t_s: FloatArray
    azimuth_rad: FloatArray
    turn_radps: FloatArray
    xyz_m: FloatArray
    rotation: FloatArray
    tool_m: FloatArray
    dusty: FloatArray
    mount: FloatArray = field(default_factory=lambda: np.empty((0, 3, 4)))
    front_m: FloatArray = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True)
class Returns:
    """What came back, [strongest, last] of every firing and laser of k; the same twice where there is only one.

    Attributes:
        ticks: (2, n, k) uint32, range in the scanner's steps, 0 for none.
        met: (2, n, k) uint8, :class:`Met`.
        cell: (2, n, k) int32, row * cols + col of the ground's cell, -1 elsewhere.
    """

    ticks: NDArray[np.uint32]
    reflectivity: NDArray[np.uint8]
    met: NDArray[np.uint8]
    cell: NDArray[np.int32]


def make_scene(scenario: Scenario, ground: Ground, crop: NDArray[np.float32] | None = None) -> Scene:
    """The scene of a scenario that is laid out; `crop` are heights on cells of CROP_CELL_M."""

    def plane(e_m: float, n_m: float) -> float:
        return ground.slope_e * e_m + ground.slope_n * n_m

    walls = [
        (
            *(e, n, math.cos(math.radians(a)), math.sin(math.radians(a)), 0.5 * length, 0.5 * thick),
            *(plane(e, n) - 1.0, plane(e, n) + height, bright * _BRIGHTNESS_STEP),
        )
        for e, n, a, length, thick, height, bright in scenario.walls
    ]
    posts = [(e, n, radius, plane(e, n) - 1.0, plane(e, n) + height) for e, n, radius, height in scenario.posts]
    x, y = scenario.implement.xy_m
    tool = _tool(scenario.implement, _TOOL_HEIGHT)
    if scenario.front is not None:
        tool = np.concatenate([tool, _tool(scenario.front, _FRONT_HEIGHT)])
    soil = scenario.soil
    flight = scenario.flight
    body = scenario.tractor.body_boxes_m if flight is None else flight.body_boxes_m
    straw = np.array([soil.straw_share, soil.straw_height_m, soil.straw_hit, *_crop_rows(scenario)])
    tops = np.maximum(np.maximum(ground.before, ground.middle), ground.after)
    if crop is not None:
        row, col = (np.floor((np.arange(k) + 0.5) * (CELL / CROP_CELL)).astype(np.int64) for k in ground.before.shape)
        highest: NDArray[np.float32] = maximum_filter(crop, 3, mode="wrap")[row[:, None], col]
        tops = np.maximum(tops, ground.before + highest)
        ground = ground._replace(ceiling=ceiling_of(ground.before + highest))
    tops = tops_of(tops)
    _add_straw(tops, straw, _seed_of_beams(scenario))
    return Scene(
        ground,
        straw,
        np.array(walls, np.float64).reshape(-1, 9),
        np.array(posts, np.float64).reshape(-1, 5),
        _targets(scenario),
        np.array(body, np.float64).reshape(-1, 6),
        tool if flight is None else np.empty((0, 7)),
        np.array([x + _DUST_CENTRE[0], y, _DUST_CENTRE[1], *_DUST_RADII]),
        np.zeros((0, 0), np.float32) if crop is None else crop,
        0.0 if flight is None else flight.extinction_per_m,
        tops,
        float(ground.ceiling.max()),
    )


def _targets(scenario: Scenario) -> FloatArray:
    """(n, 6) discs and checkerboards."""
    discs = [(e, n, 0.5 * width, np.nan, bright, bright) for e, n, width, bright in scenario.discs]
    boards = [
        (e, n, 0.5 * side, np.radians(azimuth), bright, BOARD_DARK)
        for e, n, side, azimuth, bright in scenario.checkerboards
    ]
    return np.array([*discs, *boards], np.float64).reshape(-1, 6)


def _tool(implement: ScenarioImplement, column: int) -> FloatArray:
    """(n, 7) boxes of an implement, and the column with its height."""
    x, y = implement.xy_m
    boxes = np.array(implement.boxes_m).reshape(-1, 6) + np.array([x, x, y, y, 0.0, 0.0])
    return np.column_stack([boxes, np.full(len(boxes), float(column))])


def _crop_rows(scenario: Scenario) -> tuple[float, float, float]:
    """Rows per metre to the east and to the north, and their count at the local origin; wheels run between rows."""
    spacing_m = scenario.soil.crop_rows_m
    if not spacing_m:
        return 0.0, 0.0, 0.0
    lane = math.radians(90.0 - scenario.drive.lane_heading_deg)
    east = -math.sin(lane) / spacing_m
    north = math.cos(lane) / spacing_m
    x, y = scenario.drive.start_xy_m
    return east, north, 0.5 - east * x - north * y


def make_optics(scenario: Scenario, beams: Beams, mount: FloatArray) -> Optics:
    """The sensor of a scenario; `mount` (3, 3) is its true rotation to the vehicle."""
    lidar = scenario.lidar
    noise = scenario.noise
    elevation = np.radians(beams.elevation_deg)
    bias = random_for(scenario.seed, "lasers").normal(0.0, lidar.laser_bias_m, len(elevation))
    azimuth = np.radians(beams.azimuth_deg)
    return Optics(
        np.column_stack([mount, lidar.true_xyz_m]),
        np.column_stack([np.cos(elevation), np.sin(elevation), beams.height_m, bias, azimuth, beams.laser_s]),
        np.array([noise.range_m, noise.grazing, noise.dropout, noise.dust]),
        np.array([lidar.min_range_m, lidar.max_range_m]),
        beams.origin_m,
        beams.step_m,
        _seed_of_beams(scenario),
    )


def _seed_of_beams(scenario: Scenario) -> int:
    return int(random_for(scenario.seed, "beams").integers(2**62))


def cast(scene: Scene, optics: Optics, firings: Firings) -> Returns:
    """The returns of `firings`."""
    shape = (2, len(firings.t_s), len(optics.lasers))
    ticks, reflectivity, met = (np.zeros(shape, kind) for kind in (np.uint32, np.uint8, np.uint8))
    cell = np.full(shape, -1, np.int32)
    moving = np.column_stack([firings.t_s, firings.azimuth_rad, firings.turn_radps, firings.tool_m, firings.dusty])
    if len(firings.front_m):
        moving = np.column_stack([moving, firings.front_m])
    _cast(
        scene, optics, firings.number, moving, np.ascontiguousarray(firings.xyz_m),
        np.ascontiguousarray(firings.rotation), np.ascontiguousarray(firings.mount), ticks, reflectivity, met, cell,
    )  # fmt: skip
    return Returns(ticks, reflectivity, met, cell)


@kernel()
def _mix(x):  # type: ignore[no-untyped-def]
    """The next value of SplitMix64 from the state `x`."""
    z = np.uint64(x)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@kernel()
def _chance(seed, ray, draw):  # type: ignore[no-untyped-def]
    """A number from (0, 1) for a ray and a purpose."""
    state = np.uint64(seed) + np.uint64(ray * 16 + draw + 1) * np.uint64(0x9E3779B97F4A7C15)
    return (np.float64(_mix(state) >> np.uint64(11)) + 0.5) * (1.0 / 9007199254740992.0)


@kernel()
def _straw_height(seed, place, straw):  # type: ignore[no-untyped-def]
    """Height of the straw of a cell: most of it is short; plants of a crop, in rows, are nearly alike."""
    chance = _chance(seed, place, 15)
    rows_of_crop = straw[3] != 0.0 or straw[4] != 0.0
    return straw[1] * (0.8 + 0.2 * chance if rows_of_crop else chance**3)


@kernel()
def _add_straw(tops, straw, seed):  # type: ignore[no-untyped-def]
    """Raise the highest of each cell by its straw."""
    rows, cols = tops.shape
    for row in range(rows):
        for col in range(cols):
            place = row * cols + col
            if _chance(seed, place, 14) < straw[0]:
                tops[row, col] += _straw_height(seed, place, straw)


@kernel()
def _meet_box(x, y, z, dx, dy, dz, x0, x1, y0, y1, z0, z1):  # type: ignore[no-untyped-def]
    """(range, cosine of the incidence) at which a beam from outside enters a box; inf where it does not."""
    if (x > x1 and dx >= 0.0) or (x < x0 and dx <= 0.0) or (y > y1 and dy >= 0.0) or (y < y0 and dy <= 0.0):
        return math.inf, 0.0
    if (z > z1 and dz >= 0.0) or (z < z0 and dz <= 0.0):
        return math.inf, 0.0
    enter = 0.0
    leave = math.inf
    cosine = 0.0
    for axis in range(3):
        if axis == 0:
            p = x
            d = dx
            low = x0
            high = x1
        elif axis == 1:
            p = y
            d = dy
            low = y0
            high = y1
        else:
            p = z
            d = dz
            low = z0
            high = z1
        if abs(d) < 1e-12:
            if p < low or p > high:
                return math.inf, 0.0
            continue
        a = (low - p) / d
        b = (high - p) / d
        if a > b:
            a, b = b, a
        if a > enter:
            enter = a
            cosine = abs(d)
        leave = min(leave, b)
        if leave <= enter:
            return math.inf, 0.0
    if cosine == 0.0:
        return math.inf, 0.0
    return enter, cosine


@kernel()
def _meet_post(x, y, z, dx, dy, dz, post):  # type: ignore[no-untyped-def]
    """(range, cosine of the incidence) at which a beam meets the mantle of an upright post."""
    ex = x - post[0]
    ey = y - post[1]
    a = dx * dx + dy * dy
    b = ex * dx + ey * dy
    root = b * b - a * (ex * ex + ey * ey - post[2] * post[2])
    if root <= 0.0 or a == 0.0:
        return math.inf, 0.0
    s = (-b - math.sqrt(root)) / a
    height = z + s * dz
    if s <= 0.0 or height < post[3] or height > post[4]:
        return math.inf, 0.0
    return s, abs((ex + s * dx) * dx + (ey + s * dy) * dy) / post[2]


@kernel()
def _wrap(i, n):  # type: ignore[no-untyped-def]
    """The row or column of the ground that stands for `i`, the ground repeating itself beyond its edges."""
    if i >= n:
        return i - n if i < 2 * n else i % n
    if i < 0:
        return i + n if i >= -n else i % n
    return i


@kernel()
def _meet_ground(scene, seed, ray, x, y, z, dx, dy, dz, t, far):  # type: ignore[no-untyped-def]
    """(range, what) at which a beam, above the mean plane by z and sinking by -dz, meets soil, straw or crop."""
    ground = scene.ground
    straw = scene.straw
    crop = scene.crop
    # the optical depth of crop at which the beam is stopped
    depth = -math.log(_chance(seed, ray, 12)) if len(crop) else 0.0
    rows, cols = ground.before.shape
    block_rows, block_cols = ground.ceiling.shape
    block = NOISE_BLOCK * CELL
    cell = min(CELL, CROP_CELL) if len(crop) else CELL
    step = _CELL_SHARE * cell / max(math.hypot(dx, dy), 0.2)
    # nothing is met above the highest ceiling; a beam enters the first block from the one before
    s = max(0.0, (scene.highest + straw[1] - z) / dz - 2.0 * block / max(abs(dx), abs(dy), 0.01))
    while s < far:
        within = s + 1e-4  # a beam that stands on a border belongs to the block it goes into
        i = math.floor((y + within * dy) / block)
        j = math.floor((x + within * dx) / block)
        leave = s + 2.0 * block / max(abs(dx), abs(dy), 0.01)
        if abs(dx) > 1e-9:
            leave = min(leave, ((j + 1 if dx > 0.0 else j) * block - x) / dx)
        if abs(dy) > 1e-9:
            leave = min(leave, ((i + 1 if dy > 0.0 else i) * block - y) / dy)
        leave = max(leave, within)
        ceiling = ground.ceiling[_wrap(i, block_rows), _wrap(j, block_cols)]
        if z + leave * dz > ceiling + straw[1]:
            s = leave
            continue
        s = max(s, (ceiling + straw[1] - z) / dz)
        while s < leave and s < far:
            ahead = s + step
            e = x + ahead * dx
            n = y + ahead * dy
            height = z + ahead * dz
            row = math.floor(n / CELL)
            col = math.floor(e / CELL)
            wrapped_row = _wrap(row, rows)
            wrapped_col = _wrap(col, cols)
            if height > scene.tops[wrapped_row, wrapped_col] + _ROUNDING_M:
                s = ahead
                continue
            if height < ceiling and height < relief_at(ground, e, n, t):
                low = s
                high = ahead
                for _ in range(5):
                    middle = 0.5 * (low + high)
                    if z + middle * dz > relief_at(ground, x + middle * dx, y + middle * dy, t):
                        low = middle
                    else:
                        high = middle
                return 0.5 * (low + high), _MET_SOIL
            place = wrapped_row * cols + wrapped_col
            if len(crop) and height < ceiling:
                crop_row = math.floor(n / CROP_CELL)
                crop_col = math.floor(e / CROP_CELL)
                stand = crop[_wrap(crop_row, crop.shape[0]), _wrap(crop_col, crop.shape[1])]
                within = (stand + relief_at(ground, e, n, t) - height) if stand > 0.0 else 0.0
                if within > 0.0:
                    depth -= scene.extinction * min(step, within / max(-dz, 1e-9))
                    if depth <= 0.0:
                        return ahead + depth / scene.extinction, _MET_STRAW
            rows_of_crop = straw[3] != 0.0 or straw[4] != 0.0
            count = e * straw[3] + n * straw[4] + straw[5]
            stands = not rows_of_crop or abs(count - round(count)) < _CROP_SHARE
            if stands and _chance(seed, place, 14) < straw[0] and _chance(seed + row * 7 + col, ray, 13) < straw[2]:
                inside = 0 <= row < rows and 0 <= col < cols
                tall = _straw_height(seed, place, straw)
                bare = inside and (t >= ground.first_s[row, col] or ground.worked_earlier[row, col])
                if not bare and height < tall + relief_at(ground, e, n, t):
                    return ahead, _MET_STRAW
            s = ahead
    return math.inf, 0


@kernel()
def _of_target(target, east, north, ground):  # type: ignore[no-untyped-def]
    """Reflectivity at a place beside the middle of a disc or checkerboard; that of the ground off it."""
    half = target[2]
    if math.isnan(target[3]):
        return target[4] if math.hypot(east, north) <= half else ground
    along = math.sin(target[3]) * east + math.cos(target[3]) * north
    across = math.cos(target[3]) * east - math.sin(target[3]) * north
    if max(abs(along), abs(across)) > half:
        return ground
    return target[4] if along * across > 0.0 else target[5]


@kernel()
def _in_dust(x, y, z, dx, dy, dz, cloud):  # type: ignore[no-untyped-def]
    """(from, to) of a beam's way through the dust, inf where it passes by."""
    px = (x - cloud[0]) / cloud[3]
    py = (y - cloud[1]) / cloud[4]
    pz = (z - cloud[2]) / cloud[5]
    qx = dx / cloud[3]
    qy = dy / cloud[4]
    qz = dz / cloud[5]
    a = qx * qx + qy * qy + qz * qz
    b = px * qx + py * qy + pz * qz
    root = b * b - a * (px * px + py * py + pz * pz - 1.0)
    if root <= 0.0:
        return math.inf, math.inf
    root = math.sqrt(root)
    return max(0.0, (-b - root) / a), (-b + root) / a


@kernel()
def _record(optics, ray, slot, r, cosine, what, bright, laser, i, ticks, reflectivity, met):  # type: ignore[no-untyped-def]
    """Measure one return with its errors; whether it was measured at all."""
    if optics.noise[2] > 0.0:
        loss = optics.noise[2] + (1.0 - optics.noise[2]) * math.exp(-bright * cosine / (r * r * _FAINT))
        if _chance(optics.seed, ray, 4 * slot) < loss:
            return False
    growth = min(5.0, max(cosine, 1e-3) ** -optics.noise[1])
    u = _chance(optics.seed, ray, 4 * slot + 1)
    v = _chance(optics.seed, ray, 4 * slot + 2)
    normal = math.sqrt(-2.0 * math.log(u))
    r += optics.lasers[laser, 3] + normal * math.cos(2.0 * math.pi * v) * optics.noise[0] * growth
    if r < optics.reach[0] or r > optics.reach[1]:
        return False
    for k in range(slot, 2):
        ticks[k, i, laser] = np.uint32(math.floor((r + optics.origin_m) / optics.step_m + 0.5))
        reflectivity[k, i, laser] = np.uint8(
            min(255.0, max(1.0, bright + 1.0 * normal * math.sin(2.0 * math.pi * v) + 0.5))
        )
        met[k, i, laser] = what
    return True


@kernel()
def _cast(scene, optics, number, moving, xyz, rotation, mounts, ticks, reflectivity, met, cell):  # type: ignore[no-untyped-def]
    ground = scene.ground
    mount = optics.mount
    lasers = len(optics.lasers)
    rows, cols = ground.before.shape
    for i in range(len(moving)):
        t = moving[i, 0]
        turn = rotation[i]
        if len(mounts):
            mount = mounts[i]
        for laser in range(lasers):
            ray = (number + i) * lasers + laser
            azimuth = moving[i, 1] + moving[i, 2] * optics.lasers[laser, 5] + optics.lasers[laser, 4]
            cosine = optics.lasers[laser, 0]
            sine = optics.lasers[laser, 1]
            offset = optics.lasers[laser, 2]
            a = cosine * math.cos(azimuth)
            b = -cosine * math.sin(azimuth)
            c = sine
            # the beam in the vehicle frame, and in the local one
            vx = mount[0, 0] * a + mount[0, 1] * b + mount[0, 2] * c
            vy = mount[1, 0] * a + mount[1, 1] * b + mount[1, 2] * c
            vz = mount[2, 0] * a + mount[2, 1] * b + mount[2, 2] * c
            u = optics.origin_m * math.cos(moving[i, 1])
            v = -optics.origin_m * math.sin(moving[i, 1])
            px = mount[0, 3] + mount[0, 0] * u + mount[0, 1] * v + mount[0, 2] * offset
            py = mount[1, 3] + mount[1, 0] * u + mount[1, 1] * v + mount[1, 2] * offset
            pz = mount[2, 3] + mount[2, 0] * u + mount[2, 1] * v + mount[2, 2] * offset
            dx = turn[0, 0] * vx + turn[0, 1] * vy + turn[0, 2] * vz
            dy = turn[1, 0] * vx + turn[1, 1] * vy + turn[1, 2] * vz
            dz = turn[2, 0] * vx + turn[2, 1] * vy + turn[2, 2] * vz
            x = xyz[i, 0] + turn[0, 0] * px + turn[0, 1] * py + turn[0, 2] * pz
            y = xyz[i, 1] + turn[1, 0] * px + turn[1, 1] * py + turn[1, 2] * pz
            z = xyz[i, 2] + turn[2, 0] * px + turn[2, 1] * py + turn[2, 2] * pz
            best = optics.reach[1] + 1.0
            incidence = 0.0
            what = 0
            bright = 0.0
            hit = -1
            for k in range(len(scene.body)):
                box = scene.body[k]
                r, q = _meet_box(px, py, pz, vx, vy, vz, box[0], box[1], box[2], box[3], box[4], box[5])
                if r < best:
                    best = r
                    incidence = q
                    what = _MET_BODY
                    bright = _BRIGHTNESS[_MET_BODY]
            for k in range(len(scene.tool)):
                box = scene.tool[k]
                lift = moving[i, int(box[6])]
                r, q = _meet_box(px, py, pz - lift, vx, vy, vz, box[0], box[1], box[2], box[3], box[4], box[5])
                if r < best:
                    best = r
                    incidence = q
                    what = _MET_IMPLEMENT
                    bright = _BRIGHTNESS[_MET_IMPLEMENT]
            for k in range(len(scene.walls)):
                w = scene.walls[k]
                ex = x - w[0]
                ey = y - w[1]
                r, q = _meet_box(
                    w[2] * ex + w[3] * ey, w[2] * ey - w[3] * ex, z, w[2] * dx + w[3] * dy, w[2] * dy - w[3] * dx, dz,
                    -w[4], w[4], -w[5], w[5], w[6], w[7],
                )  # fmt: skip
                if r < best:
                    best = r
                    incidence = q
                    what = _MET_OBJECT
                    bright = w[8]
            for k in range(len(scene.posts)):
                r, q = _meet_post(x, y, z, dx, dy, dz, scene.posts[k])
                if r < best:
                    best = r
                    incidence = q
                    what = _MET_OBJECT
                    bright = _BRIGHTNESS[_MET_OBJECT]
            sinking = dz - ground.slope_e * dx - ground.slope_n * dy
            if sinking < -1e-4:
                height = z - ground.slope_e * x - ground.slope_n * y
                r, kind = _meet_ground(scene, optics.seed, ray, x, y, height, dx, dy, sinking, t, best)
                if r < best:
                    best = r
                    what = kind
                    incidence = -sinking / math.sqrt(1.0 + ground.slope_e**2 + ground.slope_n**2)
                    row = math.floor((y + r * dy) / CELL)
                    col = math.floor((x + r * dx) / CELL)
                    if kind == _MET_SOIL and 0 <= row < rows and 0 <= col < cols:
                        hit = row * cols + col
                        if t >= ground.first_s[row, col] or ground.worked_earlier[row, col]:
                            what = _MET_TILLED
                    if kind == _MET_STRAW:
                        incidence = 1.0
                    bright = _BRIGHTNESS[what]
                    for k in range(len(scene.targets)):
                        target = scene.targets[k]
                        east = x + r * dx - target[0]
                        north = y + r * dy - target[1]
                        if kind == _MET_SOIL and math.hypot(east, north) <= math.sqrt(2.0) * target[2]:
                            bright = _of_target(target, east, north, bright)
            slot = 0
            if moving[i, 4] > 0.0 and optics.noise[3] > 0.0:
                enter, leave = _in_dust(px, py, pz, vx, vy, vz, scene.dust)
                leave = min(leave, best)
                if enter < leave and -math.log(_chance(optics.seed, ray, 8)) < optics.noise[3] * moving[i, 4] * (
                    leave - enter
                ):
                    r = enter + (leave - enter) * _chance(optics.seed, ray, 9)
                    # the cloud thins out towards its rim
                    rim = 0.0
                    for k in range(3):
                        p, d = (px, vx) if k == 0 else (py, vy) if k == 1 else (pz, vz)
                        rim += ((p + r * d - scene.dust[k]) / scene.dust[3 + k]) ** 2
                    if _chance(optics.seed, ray, 10) > rim and _record(
                        optics, ray, 0, r, 1.0, _MET_DUST, _BRIGHTNESS[_MET_DUST], laser, i, ticks, reflectivity, met
                    ):
                        slot = 1
                        if best - r < _SEPARATION_M:
                            continue
            if what and _record(optics, ray, slot, best, incidence, what, bright, laser, i, ticks, reflectivity, met):
                for k in range(slot, 2):
                    cell[k, i, laser] = hit
