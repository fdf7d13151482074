"""From the terrestrial frame in which positions were recorded, at their own time, to the frame of the map.

Plates move by centimetres a year in the ITRF; national frames move with them. Seven parameters and their rates lead
from one to the other (for ETRS89: EUREF Technical Note 1, Altamimi 2018). PROJ has those of EPSG; what it lacks is
refused.
"""

import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from pyproj import CRS, Transformer
from pyproj.transformer import TransformerGroup

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, RefusedError
from furrowmap.core.values.clock import decimal_years

MAX_FRAME_SIGMA_M: Final = 0.05
"""Transformations of a worse stated accuracy are refused: the motion of a plate in a year or two is as large."""
_FORM: Final = re.compile(r"\s*(.+?)\s*(?:->|→|\bto\b)\s*(.+?)\s*", re.IGNORECASE)


@dataclass(frozen=True)
class FrameChange:
    """A transformation between frames at the time of each position.

    Attributes:
        name: of the operation, as its authority names it.
    """

    name: str
    transformer: Transformer

    def to_map(
        self, t_s: FloatArray, lon_deg: FloatArray, lat_deg: FloatArray, height_m: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(longitude, latitude, change of the height), each (n,), in the frame of the map at Unix times (n,).

        Heights may be nan; a change of height is that of the place all the same.
        """
        level_m = np.where(np.isfinite(height_m), height_m, 0.0)
        moved: Any = self.transformer.transform(lon_deg, lat_deg, level_m, decimal_years(t_s))
        lon, lat, height = (np.asarray(axis, np.float64) for axis in moved[:3])
        return lon, lat, height - level_m


def frame_change(text: str, flat: CRS, frame_of: Callable[[str], CRS | None]) -> FrameChange | None:
    """The transformation that `crs.coordinates` asks for: a frame, or a frame "to" the realisation of the map's.

    Args:
        text: such as "ITRF2020", or "ITRF2020 to ETRF2000".
        flat: CRS of the map.
        frame_of: the geographic CRS of a name; None for an unknown one.

    Returns:
        None where the text is of another form.

    Raises:
        InputError: if the map's datum is an ensemble and no realisation of it is named.
        RefusedError: if PROJ has no exact transformation.
    """
    form = _FORM.fullmatch(text)
    source = frame_of(form[1] if form is not None else text.strip())
    base = flat.geodetic_crs
    if source is None or base is None:
        return None
    members = [member["name"] for member in base.to_json_dict().get("datum_ensemble", {}).get("members", [])]
    target = frame_of(form[2]) if form is not None else base
    named = form[2] if form is not None else None
    whole = target.datum.name if target is not None and target.datum is not None else None
    if (members and whole not in members) or (not members and target != base.to_2d()):
        raise InputError("frame-realization", map=base.name, named=named, members=members or [base.name])
    assert target is not None
    return _change(source, target)


def _change(source: CRS, target: CRS) -> FrameChange:
    """The best operation that PROJ offers; RefusedError if there is none, or a better one needs a grid."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # missing grids are reported below
        group = TransformerGroup(source.to_3d(), target.to_3d(), always_xy=True, allow_ballpark=False)
    best = group.transformers[0] if group.transformers else None
    known = best is not None and best.accuracy is not None and 0.0 <= best.accuracy <= MAX_FRAME_SIGMA_M
    if best is not None and known:
        steps = [step for step in best.description.split(" + ") if not step.startswith(("axis order", "Conversion"))]
        return FrameChange(", ".join(steps) or f"{source.name} to {target.name}", best)
    lacking = [grid.short_name for operation in group.unavailable_operations for grid in operation.grids]
    raise RefusedError(
        "frame-change-unknown",
        source=source.name,
        target=target.name,
        grid=lacking[0] if lacking else None,
        accuracy_m=best.accuracy if best is not None and best.accuracy >= 0.0 else None,
    )
