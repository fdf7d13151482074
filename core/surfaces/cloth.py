"""The ground by the cloth simulation filter, behind a guard.

W. Zhang, J. Qi, P. Wan, H. Wang, D. Xie, X. Wang, G. Yan (2016), An easy-to-use airborne LiDAR data filtering method
based on cloth simulation, Remote Sensing 8 (6), 501. The library is its authors' own. It writes to standard output, and
ends the whole process on a coordinate that is no number or a point far away; so it gets neither, and its words go where
words go.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.values.errors import InputError

FEWEST_POINTS: Final = 10
RELIEF_M: Final = 500.0
"""Points farther than this above or below the middle height are left to be no ground: the cloth would not hold them."""
CLOTH_M: Final = 0.5
"""Distance of the cloth's nodes, at which it follows furrows and ditches, but no tractor."""
THRESHOLD_M: Final = 0.15
_MOST_EXTENT_M: Final = 2_000.0
_ONE_AT_A_TIME: Final = threading.Lock()


def require_cloth() -> None:
    """Make sure that the library is there.

    Raises:
        InputError: if it is not.
    """
    if find_spec("CSF") is None:
        raise InputError(
            "Ground by 'csf': the package cloth-simulation-filter is not installed.",
            "The cloth simulation filter is the work of that package, so the ground was not classified.",
            "Install it with `pip install 'furrowmap[csf]'`, or take the method 'smrf'.",
            code="extra-missing",
        )


def cloth_ground(xyz_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which points (n, 3), finite and of a place that fits into memory, are of the ground.

    With fewer than 10 points none is; nor is any that lies more than 500 m above or below the middle height.
    """
    ground = np.zeros(len(xyz_m), bool)
    if not len(xyz_m):
        return ground
    if not np.isfinite(xyz_m).all() or np.any(np.ptp(xyz_m[:, :2], axis=0) > _MOST_EXTENT_M):
        raise ValueError(f"points that are not finite, or further apart than {_MOST_EXTENT_M} m")
    within = np.flatnonzero(np.abs(xyz_m[:, 2] - np.median(xyz_m[:, 2])) < RELIEF_M)
    if len(within) < FEWEST_POINTS:
        return ground
    import CSF

    cloth = CSF.CSF()
    cloth.params.bSloopSmooth = False
    cloth.params.cloth_resolution = CLOTH_M
    cloth.params.class_threshold = THRESHOLD_M
    cloth.params.rigidness = 2
    points = xyz_m[within]
    cloth.setPointCloud(points - points.mean(axis=0))
    found, rest = CSF.VecInt(), CSF.VecInt()
    with _ONE_AT_A_TIME, _output_to_stderr():
        cloth.do_filtering(found, rest, exportCloth=False)
    ground[within[np.array(found, np.intp)]] = True
    return ground


@contextmanager
def _output_to_stderr() -> Iterator[None]:
    """File descriptor 1 pointed at standard error, for what native code prints."""
    sys.stdout.flush()
    kept = os.dup(1)
    try:
        os.dup2(2, 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
