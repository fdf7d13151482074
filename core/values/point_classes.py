"""Point classes and their LAS 1.4 codes (R15, table 17; 64 and above are user-defined)."""

from __future__ import annotations

from enum import IntEnum


class PointClass(IntEnum):
    """Class of a point of a run's cloud."""

    OTHER = 1
    """Neither ground nor machine: straw, dust, plants, people, walls."""
    GROUND = 2
    NOISE = 7
    """Isolated in the air, or below the ground."""
    VEHICLE = 64
    IMPLEMENT = 65
