"""The height grid against planes, and the layers of soil against a drive in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from furrowmap.core.matching.height_grid import (
    TILE_NODES,
    HeightGrid,
    TilePassage,
    add_returns,
    empty_surface,
    layers,
    passage_of,
    tiles_over,
)

FloatArray = NDArray[np.float64]


def even_points(low: float, high: float, cell_m: float, side: int) -> FloatArray:
    """Points (n, 2) that fill every cell alike, `side` to its side, about its middle."""
    one = np.arange(round(low / cell_m) * side, round(high / cell_m) * side) + 0.5
    return np.stack(np.meshgrid(one, one), axis=-1).reshape(-1, 2) * (cell_m / side)


def nodes(surface: HeightGrid, sheet: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Place (n, 2), height and weight of the nodes of a sheet that hold anything."""
    tiles = surface.tiles
    places, heights, weights = [], [], []
    for row, column in zip(*np.nonzero(tiles.number >= 0), strict=True):
        tile = tiles.number[row, column]
        y, x = np.nonzero(surface.weight[tile, sheet])
        corner = np.array([tiles.west + column, tiles.south + row]) * TILE_NODES
        places.append((corner + np.column_stack([x, y])) * tiles.cell_m)
        heights.append(surface.height_m[tile, sheet, y, x].astype(float))
        weights.append(surface.weight[tile, sheet, y, x].astype(float))
    return np.concatenate(places), np.concatenate(heights), np.concatenate(weights)


def surface_of(xyz: FloatArray, cell_m: float, layer: int = 0, half: int = 0, trust: int = 255) -> HeightGrid:
    n = len(xyz)
    surface = empty_surface(tiles_over(xyz[:, :2], cell_m))
    add_returns(surface, xyz, np.full(n, layer, np.int8), np.full(n, half, np.uint8), np.full(n, trust, np.uint8))
    return surface


@settings(max_examples=25)
@given(
    slope=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)),
    height_m=st.floats(-30, 30),
    cell_m=st.sampled_from([0.1, 0.15, 0.3]),
    corner=st.integers(-70, 70),
)
def test_evenly_filled_cells_reproduce_a_plane(
    slope: tuple[float, float], height_m: float, cell_m: float, corner: int
) -> None:
    low, high = corner * cell_m, (corner + 12) * cell_m
    en = even_points(low, high, cell_m, 4)
    plane = height_m + en @ slope
    place, height, weight = nodes(surface_of(np.column_stack([en, plane]), cell_m), 0)
    inner = ((place > low + 0.5 * cell_m) & (place < high - 0.5 * cell_m)).all(axis=1)
    assert inner.sum() == 11 * 11
    np.testing.assert_allclose(weight[inner], 16.0, rtol=1e-5)
    np.testing.assert_allclose(weight.sum(), len(en), rtol=1e-5)
    expected = height_m + place[inner] @ slope
    # Sixty-four running means in single precision.
    assert np.abs(height[inner] - expected).max() <= 64 * np.finfo(np.float32).eps * max(1.0, np.abs(plane).max())


def test_layers_halves_and_trust_are_kept_apart() -> None:
    en = even_points(0.0, 1.0, 0.1, 2)
    xyz = np.column_stack([en, np.ones(len(en))])
    for layer in (0, 1):
        for half in (0, 1):
            surface = surface_of(xyz, 0.1, layer, half, trust=51)
            for sheet in range(4):
                assert (surface.weight[:, sheet].sum() > 0) == (sheet == 2 * layer + half)
            np.testing.assert_allclose(surface.weight.sum(), 0.2 * len(en), rtol=1e-5)
    assert not surface_of(xyz, 0.1, layer=-1).weight.any()
    assert not surface_of(xyz, 0.1, trust=0).weight.any()


def test_returns_without_a_tile_are_left_out() -> None:
    xyz = np.array([[0.5, 0.5, 1.0], [400.0, -300.0, 5.0], [-9.0, 0.5, 5.0]])
    surface = empty_surface(tiles_over(xyz[:1, :2], 0.1))
    add_returns(surface, xyz, np.zeros(3, np.int8), np.zeros(3, np.uint8), np.full(3, 255, np.uint8))
    np.testing.assert_allclose(surface.weight.sum(), 1.0, rtol=1e-6)
    assert surface.height_m.max() == 1.0


@given(st.lists(st.tuples(st.floats(-50, 50), st.floats(-50, 50)), min_size=1, max_size=20))
@settings(max_examples=50)
def test_tiles_hold_all_points_and_count_no_more(points: list[tuple[float, float]]) -> None:
    en = np.array(points)
    tiles = tiles_over(en, 0.15)
    used = tiles.number[tiles.number >= 0]
    assert sorted(used.tolist()) == list(range(tiles.used))
    expected = set()
    for du in (0, 1):
        for dv in (0, 1):
            corner = (np.floor(en / 0.15).astype(int) + np.array([du, dv])) // TILE_NODES - (tiles.west, tiles.south)
            expected |= set(map(tuple, corner.tolist()))
    found = {(int(c), int(r)) for r, c in zip(*np.nonzero(tiles.number >= 0), strict=True)}
    assert found == expected


def crossings(en: FloatArray, t_s: FloatArray, path: FloatArray, left: FloatArray, half_m: float) -> list[list[float]]:
    """Times at which the line of a tool passes over each point: where the way along its course changes sign."""
    ahead = np.column_stack([left[:, 1], -left[:, 0]])
    out = []
    for point in en:
        off = point - path
        along, aside = (off * ahead).sum(axis=1), (off * left).sum(axis=1)
        passes = (along[:-1] > 0) & (along[1:] <= 0) & (np.abs(aside[1:]) < half_m)
        out.append(t_s[1:][passes].tolist())
    return out


@pytest.fixture(scope="module")
def there_and_back() -> tuple[FloatArray, FloatArray, FloatArray, TilePassage]:
    """A way out, a turn and a way back that overlaps, with a tool of 1.6 m: times, path, its left, and the passage."""
    t = np.arange(0, 40, 0.05)
    u = np.where(t < 15, t, np.where(t < 25, 15 + 2 * np.sin((t - 15) * np.pi / 10), 40 - t)) * 1.0
    v = np.where(t < 15, 0.0, np.where(t < 25, 0.5 - 0.5 * np.cos((t - 15) * np.pi / 10), 1.0))
    turned = np.radians(33.0)
    c, s = np.cos(turned), np.sin(turned)
    path = np.column_stack([c * u - s * v, s * u + c * v])
    speed = np.gradient(path, axis=0)
    ahead = speed / np.linalg.norm(speed, axis=1)[:, None]
    left = np.column_stack([-ahead[:, 1], ahead[:, 0]])
    return t, path, left, passage_of(t, path, left, 0.8, 0.1)


def test_soil_is_old_before_the_first_pass_and_new_after_the_last(
    there_and_back: tuple[FloatArray, FloatArray, FloatArray, TilePassage],
) -> None:
    t, path, left, passage = there_and_back
    random = np.random.default_rng(3)
    straight = random.uniform((1.0, -2.0), (12.0, 3.0), (1500, 2))
    turned = np.radians(33.0)
    en = straight @ np.array([[np.cos(turned), np.sin(turned)], [-np.sin(turned), np.cos(turned)]])
    at = random.uniform(0, 40, len(en))
    found = layers(at, en, passage, 0.3)
    judged = {-1: 0, 0: 0, 1: 0}
    for k, times in enumerate(crossings(en, t, path, left, 0.8)):
        border = min(abs(abs(straight[k, 1] - lane) - 0.8) for lane in (0.0, 1.0))
        if border < 0.15 or (times and min(abs(at[k] - x) for x in (times[0] - 0.3, times[-1] + 0.3)) < 0.2):
            continue  # a cell of 0.1 m is passed in a tenth of a second
        old, new = not times or at[k] < times[0] - 0.3, bool(times) and at[k] > times[-1] + 0.3
        expected = 0 if old else 1 if new else -1
        assert found[k] == expected, (straight[k], at[k], times)
        judged[expected] += 1
    assert min(judged.values()) > 40


@pytest.mark.parametrize("half_width_m", [0.5, 3.0, 6.0, 9.0])
def test_a_wide_line_passes_all_the_ground_under_it(half_width_m: float) -> None:
    t = np.arange(0, 20, 0.05)
    left = np.tile([-np.sin(0.5), np.cos(0.5)], (len(t), 1))
    middle = t[:, None] * [np.cos(0.5), np.sin(0.5)]
    passage = passage_of(t, middle, left, half_width_m, 0.1)
    random = np.random.default_rng(8)
    along, aside = random.uniform(2, 17, 2000), random.uniform(-half_width_m + 0.1, half_width_m - 0.1, 2000)
    en = along[:, None] * [np.cos(0.5), np.sin(0.5)] + aside[:, None] * left[:1]
    assert (layers(np.full(2000, 30.0), en, passage, 0.3) == 1).all()


@pytest.mark.parametrize("half_width_m", [3.25, 6.45])
@pytest.mark.parametrize("heading", [1.0, -1.0])
def test_the_ends_of_a_line__change_the_ground_in_the_tiles_beyond_a_border(
    half_width_m: float, heading: float
) -> None:
    """Tiles of 3.2 m, of which the line reaches half a cell into the next ones."""
    t = np.arange(0, 20, 0.05)
    middle, left = heading * t[:, None] * [1.0, 0.0], np.tile([0.0, heading], (len(t), 1))
    passage = passage_of(t, middle, left, half_width_m, 0.1)
    along, ends = heading * np.linspace(1.0, 18.0, 200), half_width_m - 0.02
    for end in (-ends, ends):
        en = np.column_stack([along, np.full(200, end)])
        assert (layers(np.full(200, 30.0), en, passage, 0.3) == 1).all()
        assert (layers(np.full(200, 30.0), np.add(en, (0.0, np.sign(end) * 0.1)), passage, 0.3) == 0).all()


def test_without_a_tool_all_soil_is_old() -> None:
    assert not layers(np.arange(5.0), np.zeros((5, 2)), None, 0.3).any()
