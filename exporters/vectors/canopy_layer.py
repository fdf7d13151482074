"""Stands by cell or polygon as a layer, and their profiles as a table."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Final

import numpy as np
import shapely

from furrowmap.core.crops.stand import PERCENTILES, Stand
from furrowmap.core.values.parcel import Parcel
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.csv_cells import cell
from furrowmap.exporters.vectors.field_layers import Columns, Layer, geometry_array
from furrowmap.exporters.vectors.parcel_table import attribute_columns, text_column

LAYER: Final = "canopy"
_APART: Final = ("id", "percentiles_m", "profile")


def canopy_layer(stands: Sequence[Stand], shapes: Sequence[shapely.Geometry], areas: Sequence[Parcel]) -> Layer:
    """A feature per area.

    Args:
        stands: n stands.
        shapes: n polygons.
        areas: n areas of the user's file, for what else is known of them; none for cells.
    """
    columns: Columns = {"id": text_column([stand.id for stand in stands])}
    for field in fields(Stand):
        if field.name not in _APART:
            columns[field.name] = np.array([getattr(stand, field.name) for stand in stands])
    for k, percent in enumerate(PERCENTILES):
        columns[f"p{percent:02}_m"] = np.array([stand.percentiles_m[k] for stand in stands])
    columns |= attribute_columns(areas, columns)
    return Layer(LAYER, "Polygon", "Heights and gaps of the canopy", geometry_array(shapes), columns)


def write_profiles(path: Path, stands: Sequence[Stand], layer_m: float) -> None:
    """Write the share of returns by layer as CSV: a row per layer of each stand.

    Raises:
        OSError: if the file cannot be written.
    """
    with atomic_output(path) as unfinished, unfinished.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["id", "from_m", "to_m", "share"])
        for stand in stands:
            for k, share in enumerate(stand.profile):
                table.writerow([cell(stand.id), f"{k * layer_m:.10g}", f"{(k + 1) * layer_m:.10g}", f"{share:.6f}"])
