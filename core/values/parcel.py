"""A parcel of a field trial, or of any other set of polygons that figures are computed for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

import shapely

Attribute = str | float
SoilMethod = Literal["surface", "plane"]

SOIL_METHODS: Final[tuple[SoilMethod, ...]] = ("surface", "plane")
"""How the soil under a crop follows from that around it."""


@dataclass(frozen=True)
class Parcel:
    """A parcel on the map.

    Attributes:
        gross: the sown area, in map coordinates (m).
        net: the part of it that figures are of, in map coordinates (m).
        attributes: what else is known of it, such as its treatment, by name.
    """

    id: str
    gross: shapely.Polygon
    net: shapely.Polygon
    block: str | None = None
    attributes: Mapping[str, Attribute] = field(default_factory=dict)
