"""Simulated yards with a truth for each point: ground, shed, fences, posts, wires, trees, hedges, seen by a scanner.

Rays are cast at rectangles, cylinders and discs (the leaves of plants) above an undulating ground, so that shadows,
densities by range and angle, and points on the rims of things are those of a scanner. It shares no code with what it
judges.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum
from itertools import pairwise
from typing import Any, Final

import numba
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class Kind(IntEnum):
    """What a surface is, in truth."""

    GROUND = 0
    HORIZONTAL = 1
    VERTICAL = 2
    LINE = 3
    SCATTER = 4


NOISE_M: Final = 0.015
"""Standard deviation of a range."""
BEAM_M: Final = 0.012
"""Added to the radius of thin things: a beam of 2 mrad is hit in part."""
NOTHING: Final = -1


@dataclass
class Scene:
    """What stands in a yard; colours are red, green, blue from 0 to 1.

    Attributes:
        size_m: side of the square.
        waves: (k, 4) amplitude, wave numbers in x and y, phase of the ground.
        ditch: middle in x, depth, half width; depth 0 for none.
        rectangles: corner (3), two sides (3 each), kind, colour (3).
        cylinders: begin (3), end (3), radius, kind, colour (3).
        leaves: middle (3), normal (3), radius, colour (3).
        plants: (k, 8) box of each plant, first leaf and end.
    """

    size_m: float
    waves: FloatArray
    ditch: tuple[float, float, float]
    rectangles: list[list[float]] = field(default_factory=list)
    cylinders: list[list[float]] = field(default_factory=list)
    leaves: list[FloatArray] = field(default_factory=list)
    plants: list[list[float]] = field(default_factory=list)

    def arrays(self) -> tuple[FloatArray, ...]:
        """As the kernel takes it."""
        return (
            self.waves,
            np.array(self.ditch),
            np.array(self.rectangles).reshape(-1, 13),
            np.array(self.cylinders).reshape(-1, 11),
            np.concatenate([np.zeros((0, 10)), *self.leaves]),
            np.array(self.plants).reshape(-1, 8),
        )

    def ground_m(self, x: float, y: float) -> float:
        """Height of the ground."""
        return float(_ground(x, y, self.waves, np.array(self.ditch)))


@dataclass(frozen=True)
class Yard:
    """A scanned yard.

    Attributes:
        xyz_m: (n, 3).
        kind: (n,) :class:`Kind`.
        rgb: (n, 3) colour from 0 to 1, as a camera sees it.
        scene: what was scanned.
    """

    xyz_m: FloatArray
    kind: NDArray[np.int8]
    rgb: FloatArray
    scene: Scene


def yard(seed: int, size_m: float = 32.0, density: float = 1.0) -> Yard:
    """A yard of its own for each seed.

    Args:
        seed: of everything random.
        size_m: side of the square; below 24 m there is one of each thing, with one tree.
        density: of the rays; 1 gives some 400 points a square metre.
    """
    rng = np.random.default_rng(seed)
    scene = _scene(rng, size_m)
    begin, way = _rays(rng, size_m, density)
    range_m, kind, rgb = cast(begin, way, *scene.arrays())
    seen = np.isfinite(range_m)
    xyz = begin[seen] + way[seen] * (range_m[seen] + rng.normal(0.0, NOISE_M, np.count_nonzero(seen)))[:, None]
    inside = np.all((xyz[:, :2] > 0.0) & (xyz[:, :2] < size_m), axis=1)
    xyz, kind, rgb = xyz[inside], kind[seen][inside], rgb[seen][inside]
    rgb = np.clip(rgb + rng.normal(0.0, 0.03, rgb.shape), 0.0, 1.0)
    return Yard(xyz, kind, rgb, scene)


def _scene(rng: np.random.Generator, size: float) -> Scene:
    waves = np.array([[rng.uniform(0.02, 0.12), *rng.uniform(-0.5, 0.5, 2), rng.uniform(0, 6)] for _ in range(4)])
    ditch = (size * 0.93, rng.uniform(0.35, 0.6) if size >= 24.0 else 0.0, rng.uniform(0.8, 1.2))
    scene = Scene(size, waves, ditch)
    cells = [(i, j) for i in range(3) for j in range(3)]
    rng.shuffle(cells)
    side = size * 0.9 / 3.0

    def middle(at: int) -> tuple[float, float]:
        i, j = cells[at]
        return (i + 0.5) * side + rng.uniform(-0.5, 0.5), (j + 0.5) * side + rng.uniform(-0.5, 0.5)

    small = size < 24.0
    _shed(scene, rng, *middle(0), most=side * 0.75)
    _wire_fence(scene, rng, *middle(1), length=side * 0.9)
    _board_fence(scene, rng, *middle(2), length=side * 0.8)
    _hedge(scene, rng, *middle(3), length=side * 0.8)
    for _ in range(1 if small else 2):
        _tree(scene, rng, *(m + rng.uniform(-0.3, 0.3) * side for m in middle(4)))
    _tree(scene, rng, *middle(5))
    _table(scene, rng, *middle(6))
    _poles(scene, rng, *middle(7), length=side)
    for _ in range(4 if small else 8):
        x, y = (m + rng.uniform(-0.45, 0.45) * side for m in middle(8))
        _bush(scene, rng, x, y)
    return scene


def _rectangle(scene: Scene, corner: Any, u: Any, v: Any, kind: Kind, colour: Any) -> None:
    scene.rectangles.append([*corner, *u, *v, float(kind), *colour])


def _cylinder(scene: Scene, begin: Any, end: Any, radius: float, colour: Any) -> None:
    scene.cylinders.append([*begin, *end, radius, float(Kind.LINE), *colour])


def _turned(rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Two level axes at right angles, in a random direction."""
    angle = rng.uniform(0.0, math.tau)
    along = np.array([math.cos(angle), math.sin(angle), 0.0])
    return along, np.array([-along[1], along[0], 0.0])


def _shed(scene: Scene, rng: np.random.Generator, x: float, y: float, most: float) -> None:
    along, across = _turned(rng)
    length, width = min(rng.uniform(4.5, 8.0), most), min(rng.uniform(3.0, 5.0), most)
    height, rise = rng.uniform(2.3, 3.2), rng.uniform(0.0, 0.45)
    base = scene.ground_m(x, y) - 0.3
    middle = np.array([x, y, base])
    up = np.array([0.0, 0.0, height + 0.3])
    wall = rng.choice([[0.75, 0.72, 0.66], [0.55, 0.35, 0.25], [0.6, 0.62, 0.65], [0.35, 0.5, 0.4]])
    roof = rng.choice([[0.4, 0.4, 0.45], [0.55, 0.25, 0.2], [0.3, 0.35, 0.5]])
    for side in (-0.5, 0.5):
        _rectangle(
            scene, middle + side * width * across - 0.5 * length * along, length * along, up, Kind.VERTICAL, wall
        )
        _rectangle(
            scene, middle + side * length * along - 0.5 * width * across, width * across, up, Kind.VERTICAL, wall
        )
    eaves = middle + up
    over = 0.25
    corner = eaves - (0.5 * length + over) * along - (0.5 * width + over) * across
    half = np.array([0.0, 0.0, rise * (0.5 * width + over)])
    low = corner - np.array([0.0, 0.0, rise * over])
    slope = (0.5 * width + over) * across + half
    _rectangle(scene, low, (length + 2 * over) * along, slope, Kind.HORIZONTAL, roof)
    other = low + (width + 2 * over) * across
    _rectangle(scene, other, (length + 2 * over) * along, slope * [-1.0, -1.0, 1.0], Kind.HORIZONTAL, roof)


def _wire_fence(
    scene: Scene, rng: np.random.Generator, x: float, y: float, length: float, along: FloatArray | None = None
) -> None:
    if along is None:
        along, _ = _turned(rng)
    spacing, height = rng.uniform(2.0, 3.0), rng.uniform(1.1, 1.5)
    wires = int(rng.integers(2, 5))
    posts = [np.array([x, y, 0.0]) + s * along for s in np.arange(-length / 2, length / 2, spacing)]
    for post in posts:
        post[2] = scene.ground_m(post[0], post[1])
        _cylinder(
            scene, post - [0, 0, 0.1], post + np.array([0.0, 0.0, height]), rng.uniform(0.04, 0.06), (0.5, 0.42, 0.33)
        )
    for a, b in pairwise(posts):
        for k in range(wires):
            rise = np.array([0.0, 0.0, height - 0.08 - k * (height - 0.35) / wires])
            _cylinder(scene, a + rise, b + rise, 0.003 + BEAM_M, (0.55, 0.55, 0.55))


def _board_fence(scene: Scene, rng: np.random.Generator, x: float, y: float, length: float) -> None:
    along, _ = _turned(rng)
    height = rng.uniform(1.2, 1.9)
    corner = np.array([x, y, 0.0]) - 0.5 * length * along
    corner[2] = scene.ground_m(x, y) - 0.4
    _rectangle(scene, corner, length * along, [0.0, 0.0, height + 0.4], Kind.VERTICAL, (0.55, 0.42, 0.3))


def _table(scene: Scene, rng: np.random.Generator, x: float, y: float) -> None:
    along, across = _turned(rng)
    length, width, height = rng.uniform(2.0, 4.0), rng.uniform(1.2, 2.0), rng.uniform(0.7, 1.1)
    corner = np.array([x, y, scene.ground_m(x, y) + height]) - 0.5 * length * along - 0.5 * width * across
    _rectangle(scene, corner, length * along, width * across, Kind.HORIZONTAL, (0.45, 0.45, 0.42))
    for s in (0.03, 0.97):
        for t in (0.05, 0.95):
            top = corner + s * length * along + t * width * across
            _cylinder(scene, top - [0, 0, height + 0.1], top - [0, 0, 0.02], 0.05, (0.4, 0.4, 0.4))


def _poles(scene: Scene, rng: np.random.Generator, x: float, y: float, length: float) -> None:
    along, _ = _turned(rng)
    height = rng.uniform(4.0, 6.5)
    feet = [np.array([x, y, 0.0]) + s * length * along for s in (-0.45, 0.45)]
    tops = []
    for foot in feet:
        foot[2] = scene.ground_m(foot[0], foot[1])
        _cylinder(
            scene, foot - [0, 0, 0.1], foot + np.array([0.0, 0.0, height]), rng.uniform(0.08, 0.14), (0.5, 0.47, 0.43)
        )
        tops.append(foot + np.array([0.0, 0.0, height - 0.2]))
    sag, s = rng.uniform(0.1, 0.4), np.linspace(0.0, 1.0, 9)
    path = tops[0] + s[:, None] * (tops[1] - tops[0]) - np.outer(4.0 * s * (1.0 - s) * sag, [0.0, 0.0, 1.0])
    for a, b in pairwise(path):
        _cylinder(scene, a, b, 0.008 + BEAM_M, (0.2, 0.2, 0.2))


def _leaves(scene: Scene, rng: np.random.Generator, middle: FloatArray, radius: FloatArray, green: FloatArray) -> None:
    """A plant of leaves at places (n, 3)."""
    n = len(middle)
    normal = rng.normal(size=(n, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    colour = np.clip(green + rng.normal(0.0, 0.03, (n, 3)), 0.0, 1.0)
    first = sum(map(len, scene.leaves))
    low, high = (middle - radius[:, None]).min(axis=0), (middle + radius[:, None]).max(axis=0)
    scene.leaves.append(np.column_stack([middle, normal, radius, colour]))
    scene.plants.append([*low, *high, first, first + n])


def _ball(rng: np.random.Generator, n: int) -> FloatArray:
    """Places in the unit ball, denser towards its surface, as leaves are."""
    way = rng.normal(size=(n, 3))
    return way / np.linalg.norm(way, axis=1)[:, None] * rng.uniform(0.0, 1.0, (n, 1)) ** 0.25


def _tree(scene: Scene, rng: np.random.Generator, x: float, y: float) -> None:
    ground = scene.ground_m(x, y)
    trunk, wide, tall = rng.uniform(1.4, 2.2), rng.uniform(1.0, 2.2), rng.uniform(1.0, 2.0)
    _cylinder(scene, (x, y, ground - 0.1), (x, y, ground + trunk), rng.uniform(0.07, 0.15), (0.35, 0.28, 0.22))
    n = int(500 * wide * tall)
    place = _ball(rng, n) * [wide, wide, tall] + [x, y, ground + trunk + 0.75 * tall]
    green = np.array([0.2, 0.42, 0.14]) + rng.uniform(-0.05, 0.05, 3)
    _leaves(scene, rng, place, rng.uniform(0.05, 0.12, n), green)


def _bush(scene: Scene, rng: np.random.Generator, x: float, y: float) -> None:
    wide, tall = rng.uniform(0.25, 0.7), rng.uniform(0.25, 0.8)
    n = int(400 * (wide + tall) ** 2)
    place = _ball(rng, n) * [wide, wide, 0.5 * tall] + [x, y, scene.ground_m(x, y) + 0.55 * tall]
    _leaves(scene, rng, place, rng.uniform(0.03, 0.06, n), np.array([0.3, 0.45, 0.18]) + rng.uniform(-0.05, 0.05, 3))


def _hedge(scene: Scene, rng: np.random.Generator, x: float, y: float, length: float) -> None:
    """A clipped hedge: leaves near the faces of a box, with a roughness of some centimetres."""
    along, across = _turned(rng)
    width, height, rough = rng.uniform(0.6, 1.0), rng.uniform(0.9, 1.6), rng.uniform(0.04, 0.08)
    n = int(260 * length * (width + 2.0 * height))
    s, t, u = rng.uniform(-0.5, 0.5, n), rng.uniform(-0.5, 0.5, n), rng.uniform(0.0, 1.0, n)
    face = rng.choice(3, n, p=[p / (width + 2 * height) for p in (width, height, height)])
    u = np.where(face == 0, 1.0, u)
    t = np.where(face == 1, -0.5, np.where(face == 2, 0.5, t))
    inward = np.abs(rng.normal(0.0, rough, n)) * 1.5 - rough
    place = np.outer(s * length, along) + np.outer(t * (width - 2.0 * inward * (face > 0)), across)
    place[:, 2] = u * (height - inward * (face == 0))
    place += np.array([x, y, 0.0])
    place[:, 2] += [scene.ground_m(*p) for p in place[:, :2]]
    _leaves(scene, rng, place, rng.uniform(0.03, 0.06, n), np.array([0.17, 0.36, 0.13]) + rng.uniform(-0.04, 0.04, 3))


def _rays(rng: np.random.Generator, size: float, density: float) -> tuple[FloatArray, FloatArray]:
    """Begin and direction of rays: 16 lasers within 30°, spinning about the way flown, on six lines across the yard."""
    begins, ways = [], []
    per_line = max(8, int(36 * size / 32.0))
    step = math.radians(0.35) / math.sqrt(density)
    lasers = np.radians(np.linspace(-20.0, 20.0, 16))
    for line in range(6):
        heading = math.pi / 3.0 * (line % 3) + rng.uniform(-0.2, 0.2)
        along = np.array([math.cos(heading), math.sin(heading), 0.0])
        across = np.array([-along[1], along[0], 0.0])
        offset = (-0.3 if line < 3 else 0.3) * size
        for s in np.linspace(-0.75, 0.75, per_line):
            place = np.array([0.5 * size, 0.5 * size, 0.0]) + s * size * along + offset * across
            place[2] = 12.0 + rng.normal(0.0, 0.1)
            spin = np.arange(-math.radians(65.0), math.radians(65.0), step) + rng.uniform(0.0, step)
            spin, tilt = (a.ravel() for a in np.meshgrid(spin, lasers + rng.normal(0, 0.004)))
            down = np.outer(np.cos(tilt) * np.cos(spin), [0.0, 0.0, -1.0])
            ways.append(np.outer(np.sin(tilt), along) + np.outer(np.cos(tilt) * np.sin(spin), across) + down)
            begins.append(np.broadcast_to(place, ways[-1].shape))
    return np.concatenate(begins), np.concatenate(ways)


@numba.njit(cache=True, nogil=True)
def _ground(x, y, waves, ditch):  # type: ignore[no-untyped-def]
    z = 0.0
    for k in range(len(waves)):
        z += waves[k, 0] * np.sin(waves[k, 1] * x + waves[k, 2] * y + waves[k, 3])
    away = abs(x - ditch[0]) / ditch[2]
    if away < 1.0:
        z -= ditch[1] * 0.5 * (1.0 + np.cos(np.pi * away))
    return z


@numba.njit(cache=True, nogil=True)
def cast(begin, way, waves, ditch, rectangles, cylinders, leaves, plants):  # type: ignore[no-untyped-def]
    """Range (inf for none), kind and colour of what rays hit first."""
    n = len(begin)
    range_m, kind, rgb = np.empty(n), np.empty(n, np.int8), np.empty((n, 3))
    sun = np.array([0.45, 0.3, 0.84])
    for i in range(n):
        best, what = np.inf, -1
        r, g, b, nx, ny, nz = 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
        px, py, pz = begin[i, 0], begin[i, 1], begin[i, 2]
        dx, dy, dz = way[i, 0], way[i, 1], way[i, 2]
        if dz < -1e-3:
            t = -pz / dz
            for _ in range(12):
                t += 0.9 * ((pz + t * dz) - _ground(px + t * dx, py + t * dy, waves, ditch)) / -dz
            x, y = px + t * dx, py + t * dy
            if t > 0.0:
                h = 0.02
                nx = (_ground(x - h, y, waves, ditch) - _ground(x + h, y, waves, ditch)) / (2.0 * h)
                ny = (_ground(x, y - h, waves, ditch) - _ground(x, y + h, waves, ditch)) / (2.0 * h)
                best, what = t, 0
                grass = np.sin(0.9 * x + 1.3) + np.sin(0.7 * y - 0.4) > 0.3
                r, g, b = (0.36, 0.44, 0.22) if grass else (0.46, 0.38, 0.3)
                norm = np.sqrt(nx * nx + ny * ny + 1.0)
                nx, ny, nz = nx / norm, ny / norm, 1.0 / norm
        for k in range(len(rectangles)):
            q = rectangles[k]
            ux, uy, uz, vx, vy, vz = q[3], q[4], q[5], q[6], q[7], q[8]
            mx, my, mz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            facing = mx * dx + my * dy + mz * dz
            if abs(facing) < 1e-9:
                continue
            t = (mx * (q[0] - px) + my * (q[1] - py) + mz * (q[2] - pz)) / facing
            if t <= 0.05 or t >= best:
                continue
            x, y, z = px + t * dx - q[0], py + t * dy - q[1], pz + t * dz - q[2]
            s = (x * ux + y * uy + z * uz) / (ux * ux + uy * uy + uz * uz)
            w = (x * vx + y * vy + z * vz) / (vx * vx + vy * vy + vz * vz)
            if 0.0 <= s <= 1.0 and 0.0 <= w <= 1.0:
                best, what = t, int(q[9])
                r, g, b = q[10], q[11], q[12]
                norm = np.sqrt(mx * mx + my * my + mz * mz) * (-1.0 if facing > 0.0 else 1.0)
                nx, ny, nz = mx / norm, my / norm, mz / norm
        for k in range(len(cylinders)):
            q = cylinders[k]
            ax, ay, az = q[3] - q[0], q[4] - q[1], q[5] - q[2]
            length = np.sqrt(ax * ax + ay * ay + az * az)
            ax, ay, az = ax / length, ay / length, az / length
            ox, oy, oz = px - q[0], py - q[1], pz - q[2]
            da, oa = dx * ax + dy * ay + dz * az, ox * ax + oy * ay + oz * az
            ex, ey, ez = dx - da * ax, dy - da * ay, dz - da * az
            fx, fy, fz = ox - oa * ax, oy - oa * ay, oz - oa * az
            aa, bb = ex * ex + ey * ey + ez * ez, ex * fx + ey * fy + ez * fz
            cc = fx * fx + fy * fy + fz * fz - q[6] * q[6]
            disc = bb * bb - aa * cc
            if disc <= 0.0 or aa < 1e-12:
                continue
            t = (-bb - np.sqrt(disc)) / aa
            s = oa + t * da
            if 0.05 < t < best and 0.0 <= s <= length:
                best, what = t, int(q[7])
                r, g, b = q[8], q[9], q[10]
                nx, ny, nz = (fx + t * ex) / q[6], (fy + t * ey) / q[6], (fz + t * ez) / q[6]
        for k in range(len(plants)):
            q = plants[k]
            near, far = 0.0, best
            for a in range(3):
                p, d = begin[i, a], way[i, a]
                if abs(d) < 1e-12:
                    if p < q[a] or p > q[a + 3]:
                        far = -1.0
                    continue
                t0, t1 = (q[a] - p) / d, (q[a + 3] - p) / d
                near, far = max(near, min(t0, t1)), min(far, max(t0, t1))
            if near >= far:
                continue
            for m in range(int(q[6]), int(q[7])):
                e = leaves[m]
                cx, cy, cz = e[0] - px, e[1] - py, e[2] - pz
                along = cx * dx + cy * dy + cz * dz
                if along <= 0.05 or cx * cx + cy * cy + cz * cz - along * along > e[6] * e[6]:
                    continue
                facing = e[3] * dx + e[4] * dy + e[5] * dz
                if abs(facing) < 1e-6:
                    continue
                t = (e[3] * cx + e[4] * cy + e[5] * cz) / facing
                x, y, z = t * dx - cx, t * dy - cy, t * dz - cz
                if 0.05 < t < best and x * x + y * y + z * z <= e[6] * e[6]:
                    best, what = t, 4
                    r, g, b = e[7], e[8], e[9]
                    sign = -1.0 if facing > 0.0 else 1.0
                    nx, ny, nz = sign * e[3], sign * e[4], sign * e[5]
        shade = 0.6 + 0.4 * max(0.0, nx * sun[0] + ny * sun[1] + nz * sun[2])
        range_m[i], kind[i] = best, what
        rgb[i, 0], rgb[i, 1], rgb[i, 2] = shade * r, shade * g, shade * b
    return range_m, kind, rgb
