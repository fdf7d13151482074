"""What a base can do within one change of it, wherever it is kept."""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final, Protocol

from pyproj import CRS

from furrowmap.core.values.errors import Notice
from furrowmap.exporters.vectors.field_layers import Layer

SCHEMA: Final = 1
"""Of the tables; a base of another is refused."""
SETTINGS: Final = "furrowmap_base"
"""The table of names and values that makes a database a base of ours."""
STYLE_BY: Final = "furrowmap's own"


@dataclass(frozen=True)
class KnownSession:
    """A session in the base.

    Attributes:
        session: its identity.
        name: as the session has it.
        date: the day at the place where it began.
        start: of the session, in UTC.
        end: of the session, in UTC.
        worked_area_m2: None where it is not known.
        passes: how many.
        crs: of the session itself.
        heights: what they are heights above.
        folder: of its products when it was added.
        recordings: a hash of the content of its recordings.
        digest: of the products it was read from.
    """

    session: str
    name: str
    date: dt.date
    start: dt.datetime
    end: dt.datetime
    worked_area_m2: float | None
    passes: int
    crs: str
    heights: str
    folder: str
    recordings: str
    digest: str

    def told(self) -> dict[str, Any]:
        """Its values by name, with times as ISO 8601."""
        return asdict(self) | {"start": self.start.isoformat(), "end": self.end.isoformat()}


KNOWN_COLUMNS: Final = (
    's.session, s.name, s.date, s."start", s."end", s.worked_area_m2, s.passes, s.crs, s.heights, s.folder, '
    "p.recordings, p.digest"
)
"""Those of :class:`KnownSession`, in its order, from `sessions` as s and `provenance` as p."""


class Edit(Protocol):
    """A change of a base: all of it takes place, or nothing."""

    def crs(self) -> CRS | None:
        """Of all its layers; None if the base is new."""

    def sessions(self) -> list[KnownSession]:
        """Those in the base, by time."""

    def remove(self, sessions: Sequence[str]) -> None:
        """Take sessions out of all layers, by their identities."""

    def append(self, layer: Layer, crs: CRS) -> None:
        """Add features to a layer, which is made where it is not there; columns that it lacks too."""

    def layers(self) -> dict[str, str]:
        """Kind of geometry (as OGR calls it, empty for tables) of each layer, by name."""

    def bounds(self) -> tuple[float, float, float, float]:
        """Least easting and northing, greatest easting and northing of all sessions."""

    def source(self, layer: str, kind: str) -> tuple[str, str]:
        """QGIS's provider of a layer, and where that finds it, as seen from the stored project."""

    def store_styles(self, styles: dict[str, str]) -> tuple[Notice, ...]:
        """Keep the styles of layers where QGIS looks for them; one that a user has changed stays."""

    def store_project(self, archive: bytes) -> None:
        """Keep the project where QGIS looks for it; one that a user has changed stays."""

    def shown(self) -> str:
        """The base as it may be told: without a password."""


def row_of(values: Sequence[Any]) -> KnownSession:
    """A row of :data:`KNOWN_COLUMNS`, whose times may be texts."""
    row = list(values)
    if isinstance(row[2], str):
        row[2] = dt.date.fromisoformat(row[2])
    row[3], row[4] = (v if isinstance(v, dt.datetime) else dt.datetime.fromisoformat(v) for v in row[3:5])
    row[6] = int(row[6] or 0)
    return KnownSession(*row)
