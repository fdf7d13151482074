"""What a point is, by the numbers that LAS 1.4 gives classes of points (R15, table 17; 64 and up are the writer's)."""

from __future__ import annotations

from enum import IntEnum


class PointClass(IntEnum):
    """Class of a point of a run's cloud."""

    OTHER = 1
    """Neither of the ground nor of the machine: straw, dust, plants, people, walls."""
    GROUND = 2
    NOISE = 7
    """Alone in the air, or below the ground."""
    VEHICLE = 64
    IMPLEMENT = 65
