"""What farm maps in GeoPackages and in PostGIS have in common: sessions, settings, types of columns."""

import datetime as dt
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.errors import RefusedError
from furrowmap.exporters.vectors.field_layers import Layer

SCHEMA: Final = 3
"""Version of the tables; a farm map of another version is refused."""
SETTINGS: Final = "furrowmap_base"
"""The table of names and values that makes a database a farm map."""
LAYER_SETTING: Final = "layer "
"""Settings with this prefix hold the geometry type of a layer."""
STYLE_BY: Final = "furrowmap's own"


@dataclass(frozen=True)
class KnownSession:
    """A session in a farm map.

    Attributes:
        date: the day at the place where it began.
        time_zone: of the times that people read.
        worked_area_m2: None where unknown.
        recordings: a hash of the content of its recordings.
        digest: of the products it was read from.
    """

    session: str
    name: str
    date: dt.date
    time_zone: str
    start: dt.datetime
    end: dt.datetime
    worked_area_m2: float | None
    passes: int
    crs: str
    heights: str
    folder: str
    recordings: str
    digest: str

    def plain(self) -> dict[str, Any]:
        """Its values by name, with times as ISO 8601."""
        return asdict(self) | {"start": self.start.isoformat(), "end": self.end.isoformat()}


KNOWN_COLUMNS: Final = (
    's.session, s.name, s.date, s.time_zone, s."start", s."end", s.worked_area_m2, s.passes, s.crs, s.heights, '
    "s.folder, p.recordings, p.digest"
)
"""Those of :class:`KnownSession`, in its order, from `sessions` as s and `provenance` as p."""


_TEXT_COLUMNS: Final = frozenset({"session", "field", "name", "implement", "machine", "field_name", "folder", "report"})
_DATE_COLUMNS: Final = frozenset({"date", "start", "end", "first_date", "last_date"})
"""Columns of texts and of days."""


def check_schema(farm_map: str, schema: str | None, remedy: str) -> None:
    """Refuse a farm map of another version of the tables."""
    if schema != str(SCHEMA):
        raise RefusedError("base-schema", farm_map=farm_map, schema=schema, known_schema=SCHEMA, remedy=remedy)


def row_of(values: Sequence[Any]) -> KnownSession:
    """A row of :data:`KNOWN_COLUMNS`, whose times may be texts."""
    row = list(values)
    if isinstance(row[2], str):
        row[2] = dt.date.fromisoformat(row[2])
    row[4], row[5] = (v if isinstance(v, dt.datetime) else dt.datetime.fromisoformat(v) for v in row[4:6])
    row[7] = int(row[7] or 0)
    return KnownSession(*row)


def chosen_columns(layer: Layer, columns: Sequence[str]) -> Layer:
    """A layer with these columns in this order; texts it does not have are None, numbers nan, dates NaT."""
    n = len(layer.shapes)

    def column(name: str) -> NDArray[Any]:
        values = layer.columns.get(name)
        if values is None:
            values = np.full(n, None, object) if name in _TEXT_COLUMNS else np.full(n, np.nan)
        if name in _DATE_COLUMNS:
            return np.asarray(values).astype("datetime64[D]")
        if name not in _TEXT_COLUMNS:
            return np.ma.filled(np.ma.asarray(values).astype(np.float64), np.nan)
        return np.asarray(values, object)

    return replace(layer, columns={name: column(name) for name in columns})


def content_hash(content: str | bytes) -> str:
    """The hash that is kept of a style or project as it was stored, to detect later changes by a user."""
    return hashlib.sha256(content.encode() if isinstance(content, str) else content).hexdigest()


def is_due(stored: str | bytes | None, new: str | bytes, kept_hash: str | None) -> bool:
    """Whether a style or project is to be stored: there is none, or another one that no user has changed."""
    return stored is None or (stored != new and content_hash(stored) == kept_hash)


def column_type(values: NDArray[Any], types: Mapping[str, str]) -> str:
    """The database's type of a column, by the kinds of numpy's types; `D` for days."""
    return types["D" if values.dtype == "datetime64[D]" else values.dtype.kind]
