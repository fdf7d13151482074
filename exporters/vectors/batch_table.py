"""The table of a batch: a row for each session, as CSV and as layers of a GeoPackage."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from furrowmap.core.geodesy.longitudes import cut_at_antimeridian
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.batch_state import SessionOutcome
from furrowmap.exporters.files.csv_cells import write_csv
from furrowmap.exporters.vectors.field_layers import Columns, Layer, geometry_array, hull, numbers, texts, track_lines
from furrowmap.exporters.vectors.geopackage import write_layer

BATCH_TABLE: Final = "batch.csv"
BATCH_LAYERS: Final = "batch.gpkg"
_NUMBER_FIGURES: Final = (
    "duration_s", "distance_m", "points", "passes", "worked_area_m2", "overlap_area_m2", "missed_area_m2",
    "working_speed_mps", "work_rate_ha_h",
)  # fmt: skip
_TEXT_FIGURES: Final = ("start", "end", "start_local", "end_local", "time_zone")
BATCH_FIGURES: Final = (*_TEXT_FIGURES, *_NUMBER_FIGURES)
"""Figures of a report that the table has; those that a run does not give are empty."""
_OUTLINE_TOLERANCE_M: Final = 0.5
"""Maximum distance of a simplified track from the positions."""
_DEGREE_DIGITS: Final = 7
"""Of a degree: a centimetre."""


@dataclass(frozen=True)
class Row:
    """A session in the table; `field` is empty for all of the recording."""

    name: str
    file: str
    field: str
    outcome: SessionOutcome

    @property
    def status(self) -> str:
        """`done` or `failed`."""
        return "failed" if self.outcome.failure is not None else "done"

    @property
    def damaged(self) -> list[dict[str, Any]]:
        """The warnings, in all languages, that tell of damaged inputs; none in the state of earlier versions."""
        return list(self.outcome.figures.get("damaged", ()))


def outlines(layers: Mapping[str, Any], frame: MapFrame) -> tuple[str, str]:
    """Footprint (hull of trajectory and worked ground) and track of a result, in lon and lat as hexadecimal WKB."""
    driven = layers["trajectory"]
    xy_m = shapely.get_coordinates(driven.geometry.to_numpy())
    track = track_lines(xy_m, driven["t_s"].to_numpy(), _OUTLINE_TOLERANCE_M)
    ground = list(layers["coverage"].geometry) if "coverage" in layers else []

    def lon_lat(xy: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.column_stack(frame.to_lon_lat(xy[:, 0], xy[:, 1])).round(_DEGREE_DIGITS)

    whole = shapely.transform(np.array([hull([track, *ground]), track], object), lon_lat)
    footprint, path = cut_at_antimeridian(whole).tolist()
    return shapely.to_wkb(footprint, hex=True), shapely.to_wkb(path, hex=True)


def write_table(folder: Path, rows: Sequence[Row]) -> None:
    """Write :data:`BATCH_TABLE`."""
    columns = (
        *("name", "status", "session", "field", *BATCH_FIGURES, "warnings", "damaged"),
        *("run_s", "processor_s", "peak_mb", "code", "error", "file"),
    )
    write_csv(folder / BATCH_TABLE, columns, map(_cells, rows))


def _cells(row: Row) -> list[object]:
    outcome = row.outcome
    figures = row.outcome.figures
    failure = (outcome.failure.code, " ".join(outcome.failure.lines)) if outcome.failure is not None else ("", "")
    values = [row.name, row.status, figures.get("session"), row.field]
    values += [figures.get(name) for name in (*BATCH_FIGURES, "warnings")]
    values.append(" ".join(notice["text"] for notice in row.damaged))
    return [*values, outcome.seconds, outcome.processor_s, outcome.peak_mb, *failure, row.file]


def write_layers(folder: Path, rows: Sequence[Row]) -> None:
    """Write :data:`BATCH_LAYERS`: footprints (`sessions`) and `tracks` of all that have a result."""
    done = [row for row in rows if row.outcome.failure is None]
    columns: Columns = {
        "name": texts([row.name for row in done]),
        "session": texts([row.outcome.figures.get("session", "") for row in done]),
        "field": texts([row.field for row in done]),
        **{name: texts(row.outcome.figures.get(name) for row in done) for name in _TEXT_FIGURES},
        **{
            name: numbers(_number(row.outcome.figures.get(name)) for row in done)
            for name in (*_NUMBER_FIGURES, "warnings")
        },
        "run_s": numbers(_number(row.outcome.seconds) for row in done),
    }
    footprints = [shapely.from_wkb(row.outcome.footprint) for row in done]
    tracks = [shapely.from_wkb(row.outcome.track) for row in done]
    kind = "MultiPolygon" if any(shape.geom_type == "MultiPolygon" for shape in footprints) else "Polygon"
    sessions = "Where each session took place: the hull of its trajectory and worked ground"
    with atomic_output(folder / BATCH_LAYERS) as unfinished:
        for layer in (
            Layer("sessions", kind, sessions, geometry_array(footprints), columns),
            Layer("tracks", "MultiLineString", "The path of the vehicle", geometry_array(tracks), columns),
        ):
            write_layer(unfinished, layer, "EPSG:4326", indexed=True)


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else np.nan
