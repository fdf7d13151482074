"""A parcel of a field trial or of any other set of polygons."""

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
    """A parcel on the map: the sown area (gross), the part that figures are of (net), and attributes."""

    id: str
    gross: shapely.Polygon
    net: shapely.Polygon
    block: str | None = None
    attributes: Mapping[str, Attribute] = field(default_factory=dict)
