"""Classes of features, and their codes in LAS files."""

from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

VEGETATION_M: Final = (0.5, 2.0)
"""Heights above the ground from which scatter points are medium and high vegetation: no standard states any."""


class Feature(IntEnum):
    """Class of a point by the shape around it, after Nagai et al. (2004)."""

    NONE = 0
    GROUND = 1
    HORIZONTAL_PLANE = 2
    VERTICAL_PLANE = 3
    LINE = 4
    SCATTER = 5

    @property
    def label(self) -> str:
        """As reports name it."""
        return self.name.lower()


class FeatureCode(IntEnum):
    """LAS 1.4 codes (R15, table 17): those of the standard where it has the class, else user-defined ones from 66 on.

    6, building, claims more than a plane shows, as do 13 to 16 of wires and towers, which are those of power lines.
    """

    OTHER = 1
    GROUND = 2
    LOW_VEGETATION = 3
    MEDIUM_VEGETATION = 4
    HIGH_VEGETATION = 5
    HORIZONTAL_PLANE = 66
    """Roofs, decks, tables."""
    VERTICAL_PLANE = 67
    """Walls, board fences."""
    LINE = 68
    """Posts, poles, trunks, wires, rails."""


_CODES: Final = (
    FeatureCode.OTHER, FeatureCode.GROUND, FeatureCode.HORIZONTAL_PLANE, FeatureCode.VERTICAL_PLANE, FeatureCode.LINE,
    FeatureCode.MEDIUM_VEGETATION,
)  # fmt: skip
"""By :class:`Feature`."""


def feature_codes(feature: NDArray[np.uint8], above_m: NDArray[np.float64]) -> NDArray[np.uint8]:
    """LAS class codes (n,) of features at heights above the ground, nan where that is unknown."""
    code = np.array(_CODES, np.uint8)[feature]
    scatter = feature == Feature.SCATTER
    code[scatter & (above_m < VEGETATION_M[0])] = FeatureCode.LOW_VEGETATION
    code[scatter & (above_m >= VEGETATION_M[1])] = FeatureCode.HIGH_VEGETATION
    return code
