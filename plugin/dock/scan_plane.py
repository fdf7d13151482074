# SPDX-License-Identifier: GPL-2.0-or-later
"""The scan plane of a mounted scanner, for the drawing of the vehicle."""

from __future__ import annotations

import math
from collections.abc import Sequence


def spin_axis(rpy_deg: Sequence[float]) -> tuple[float, float, float]:
    """The scanner's spin axis in the vehicle frame: the third column of Rz(yaw) Ry(pitch) Rx(roll)."""
    roll, pitch, yaw = (math.radians(angle) for angle in rpy_deg)
    along = math.cos(roll) * math.sin(pitch)
    across = math.sin(roll)
    return (
        math.cos(yaw) * along + math.sin(yaw) * across,
        math.sin(yaw) * along - math.cos(yaw) * across,
        math.cos(roll) * math.cos(pitch),
    )


def scan_direction(axis: Sequence[float], normal: Sequence[float]) -> tuple[float, ...] | None:
    """Unit vector along which the scan plane cuts a plane of the drawing; None if they coincide."""
    a, b, c = axis
    p, q, r = normal
    cut = (b * r - c * q, c * p - a * r, a * q - b * p)
    length = math.sqrt(sum(value * value for value in cut))
    return None if length < 1e-6 else tuple(value / length for value in cut)
