"""Polygons that take GEOS hours, all memory or its stack, as GeoJSON in metres of a map or in degrees."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import shapely

Rings = list[list[list[float]]]
SIDE_M = 100.0
CORNERS = int(os.environ.get("CORNERS", "100000" if "KILLS" in os.environ else "60000"))
"""Of the largest polygons, more in `make kills`; a file may have a million, which take several times as long."""


def _ring(xy: np.ndarray) -> list[list[float]]:
    rows: list[list[float]] = xy.tolist()
    return [*rows, rows[0]]


def _round(corners: int, radius_m: np.ndarray | float) -> np.ndarray:
    angle = np.linspace(0.0, 2.0 * np.pi, corners, endpoint=False)
    return np.column_stack([radius_m * np.cos(angle), radius_m * np.sin(angle)])


def equal_holes() -> Rings:
    return [_ring(SIDE_M * _round(4, 1.0)), *[_ring(_round(4, 5.0))] * 20_000]


def nearly_equal_holes() -> Rings:
    return [_ring(SIDE_M * _round(4, 1.0)), *[_ring(_round(4, 5.0) + 1e-7 * k) for k in range(20_000)]]


def holes_within_holes() -> Rings:
    return [_ring(_round(8, SIDE_M - 0.009 * k)) for k in range(10_000)]


def star_of_spikes() -> Rings:
    return [_ring(_round(CORNERS, np.where(np.arange(CORNERS) % 2, 1.0, 0.5) * SIDE_M))]


def fine_outline(corners: int = 1_000_000 if "KILLS" in os.environ else 300_000) -> Rings:
    return [_ring(_round(corners, SIDE_M + np.sin(np.linspace(0.0, 200.0, corners))))]


def rough_outline() -> Rings:
    noise = np.random.default_rng(1).normal(0.0, 0.01, CORNERS)
    return [_ring(_round(CORNERS, SIDE_M + noise))]


def crossing_star() -> Rings:
    steps = np.arange(20_001) * 10_000 % 20_001
    return [_ring(_round(20_001, SIDE_M)[steps])]


def woven() -> Rings:
    n = 400
    there = np.column_stack([np.repeat(np.arange(n), 2), np.tile([0, n, n, 0], n // 2)])
    return [_ring(np.concatenate([there, there[::-1, ::-1]]) * SIDE_M / n)]


def figure_of_eights() -> Rings:
    x = np.arange(100_001) * 0.01
    y = np.where(np.arange(100_001) % 2, 1.0, -1.0)
    return [_ring(np.concatenate([np.column_stack([x, y]), np.column_stack([x, -y])[::-1]]))]


def straight_line() -> Rings:
    x = np.linspace(0.0, SIDE_M, CORNERS)
    return [_ring(np.concatenate([np.column_stack([x, 0.0 * x]), [[SIDE_M, SIDE_M], [0.0, SIDE_M]]]))]


def spiral() -> Rings:
    angle = np.linspace(0.0, 2000.0 * np.pi, CORNERS // 10)
    radius = SIDE_M * angle / angle[-1]
    arm = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    return [_ring(np.concatenate([arm, 1.0001 * arm[::-1]]))]


def huge_coordinates() -> Rings:
    return [_ring(1e300 * _round(5, 1.0))]


def tiny_coordinates() -> Rings:
    return [_ring(1e-300 * _round(5, 1.0))]


def spikes_of_no_width() -> Rings:
    out = _round(20_000, SIDE_M)
    return [_ring(np.stack([out, 1.5 * out, out], axis=1).reshape(-1, 2))]


def one_point_many_times() -> Rings:
    return [[[1.0, 1.0]] * CORNERS]


NASTY: dict[str, Callable[[], Rings]] = {
    make.__name__: make
    for make in (
        equal_holes, nearly_equal_holes, holes_within_holes, star_of_spikes, fine_outline, rough_outline, crossing_star,
        woven, figure_of_eights, straight_line, spiral, huge_coordinates, tiny_coordinates,
        spikes_of_no_width, one_point_many_times,
    )
}  # fmt: skip


def geojson(features: list[dict[str, Any]], path: Path, code: int = 6677) -> Path:
    """A file in a CRS."""
    crs = {"type": "name", "properties": {"name": f"urn:ogc:def:crs:EPSG::{code}"}}
    path.write_text(json.dumps({"type": "FeatureCollection", "crs": crs, "features": features}))
    return path


def feature(rings: Rings, **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "properties": properties, "geometry": {"type": "Polygon", "coordinates": rings}}


def parcels(side: int) -> list[dict[str, Any]]:
    """So many squared parcels of two metres in a grid."""
    boxes = [shapely.box(3 * k, 3 * i, 3 * k + 2, 3 * i + 2) for k in range(side) for i in range(side)]
    return [feature([np.asarray(box.exterior.coords).tolist()], id=f"P{k}") for k, box in enumerate(boxes)]
