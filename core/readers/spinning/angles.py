"""A sensor's own angles, from a calibration file beside its recording.

Hesai's format: after a heading a line for each channel with its number, elevation and azimuth in degrees; newer files
begin with a line of "EEFF" and end with a hash. `PandarView` and the sensor's web page export it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Self

import numpy as np

from furrowmap.core.readers.spinning.model import Model
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError

_LARGEST_BYTES: Final = 1 << 16
_APART_DEG: Final = 1.0
"""Elevations that differ more from those of the model are another model's: sensors of a model differ by 0.1."""


@dataclass(frozen=True)
class AngleTable:
    """Angles (n,) of each channel in the order of the packet, azimuths relative to that of the block."""

    path: Path
    elevation_deg: FloatArray
    azimuth_deg: FloatArray

    @classmethod
    def parsed(cls, path: Path) -> Self | None:
        """The angles in a file.

        None if it is no calibration; InputError if channels are damaged, missing or repeated.
        """
        if path.stat().st_size > _LARGEST_BYTES:
            return None
        lines = path.read_text("utf-8", errors="replace").lower().lstrip("\ufeff").splitlines()
        heading = next((i for i, line in enumerate(lines[:3]) if "elevation" in line and "azimuth" in line), None)
        if heading is None:
            return None
        rows = [line.split(",") for line in lines[heading + 1 :] if line.count(",") >= 2]
        try:
            table = np.array([[float(cell) for cell in row[:3]] for row in rows]).reshape(-1, 3)
        except ValueError:
            table = np.empty((0, 3))
        whole = np.array_equal(table[:, 0], np.arange(1, len(table) + 1)) and np.abs(table[:, 1:]).max(initial=0) < 90
        if not len(table) or not whole:
            raise InputError("angles-damaged", path=path)
        return cls(path, table[:, 1].copy(), table[:, 2].copy())

    @classmethod
    def beside(cls, paths: Sequence[Path]) -> Self | None:
        """The calibration in the folder of a recording, or in the folder that is a recording; None if there is none.

        InputError if there are several, or it is damaged.
        """
        folder = paths[0] if paths[0].is_dir() else paths[0].parent
        found = [table for path in sorted(folder.glob("*.[cC][sS][vV]")) if (table := cls.parsed(path)) is not None]
        own = [table for table in found if table.path.stem == paths[0].stem]
        if len(own or found) > 1:
            names = ", ".join(table.path.name for table in found)
            raise InputError("angles-ambiguous", folder=folder, names=names, recording=paths[0].name)
        return next(iter(own or found), None)

    def applied(self, model: Model) -> Model:
        """The model with these angles; InputError if they are those of another model."""
        lasers, same = len(self.elevation_deg), len(self.elevation_deg) == model.lasers
        apart_deg = float(np.abs(self.elevation_deg - model.elevation_deg).max()) if same else 0.0
        if not same or apart_deg > _APART_DEG:
            raise InputError(
                "angles-of-other-model",
                path=self.path,
                lasers=lasers,
                model=model.name,
                own=model.lasers,
                same=same,
                apart=apart_deg,
            )
        return replace(model, elevation_deg=self.elevation_deg, azimuth_deg=self.azimuth_deg)
