"""Ties of dates as layers: the dates with their moves, the ties, and what patches depart from them."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import shapely

from furrowmap.core.dates.pair_tie import PairTie
from furrowmap.exporters.vectors.field_layers import Columns, Layer, geometry_array, numbers, texts


def tie_layers(
    outlines: Sequence[Any],
    dates: Sequence[Mapping[str, Any]],
    ties: Mapping[tuple[int, int], PairTie],
    rows: Sequence[Mapping[str, Any]],
) -> list[Layer]:
    """The layers of `tie.gpkg`, the topmost first."""
    number = np.concatenate([np.full(len(tie.departures), k) for k, tie in enumerate(ties.values())] or [np.zeros(0)])
    places = np.concatenate([np.zeros((0, 2)), *[tie.departures.xy_m for tie in ties.values()]])
    off = np.concatenate([np.zeros(0), *[tie.departures.height_m for tie in ties.values()]])
    of_tie = number.astype(np.intp)
    pairs = np.array(list(ties), np.int32).reshape(-1, 2) + 1
    patches: Columns = {"date_a": pairs[of_tie, 0], "date_b": pairs[of_tie, 1], "departure_m": off}
    layers = [
        Layer("patches", "Point", "Patches of common ground: what they depart from their tie",
              geometry_array(shapely.points(places)), patches),
        Layer("ties", "MultiPoint", "Ties: two dates, and the patches of ground that tie them",
              geometry_array([shapely.MultiPoint(tie.departures.xy_m) for tie in ties.values()]), _columns(rows)),
        Layer("dates", "Polygon", "Dates: what moves each surface", geometry_array(list(outlines)), _columns(dates)),
    ]  # fmt: skip
    return [layer for layer in layers if len(layer.shapes)]


def _columns(rows: Sequence[Mapping[str, Any]]) -> Columns:
    """Fields of figures; what is not known is nan or empty."""
    columns: Columns = {}
    for name in rows[0] if rows else ():
        values = [row[name] for row in rows]
        if all(isinstance(value, str) for value in values):
            columns[name] = texts(values)
        elif all(isinstance(value, (bool, np.bool_)) for value in values):
            columns[name] = np.array(values, np.int8)
        elif all(isinstance(value, int) for value in values):
            columns[name] = np.array(values, np.int64)
        else:
            columns[name] = numbers(math.nan if value is None else float(value) for value in values)
    return columns
