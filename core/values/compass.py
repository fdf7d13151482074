"""Names of compass directions."""

from __future__ import annotations

import math
from typing import Final

_WORDS: Final = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")


def compass_direction(east: float, north: float) -> str:
    """The compass direction of a vector, to an eighth of a turn."""
    return _WORDS[round(math.degrees(math.atan2(east, north)) / 45.0) % 8]
