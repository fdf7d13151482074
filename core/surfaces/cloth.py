"""Ground classification by the cloth simulation filter (CSF).

W. Zhang, J. Qi, P. Wan, H. Wang, D. Xie, X. Wang, G. Yan (2016), An easy-to-use airborne LiDAR data filtering method
based on cloth simulation, Remote Sensing 8 (6), 501. The authors' library prints to standard output and aborts the
process on nan and on distant points, so its input is checked and its output redirected.
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

from furrowmap.core.runtime.errors import InputError

FEWEST_POINTS: Final = 10
RELIEF_M: Final = 500.0
"""Points farther than this from the median height are not ground and are not passed to the library."""
CLOTH_M: Final = 0.5
"""Cloth resolution: follows furrows and ditches, but not a tractor."""
THRESHOLD_M: Final = 0.15
_MOST_EXTENT_M: Final = 2_000.0
_ONE_AT_A_TIME: Final = threading.Lock()


def require_cloth() -> None:
    """Raises InputError if the library is not installed."""
    if find_spec("CSF") is None:
        raise InputError("extra-missing.require-cloth")


def cloth_ground(xyz_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which points (n, 3), all finite and within 2 km, are ground; none with fewer than 10 points.

    Points more than 500 m from the median height are not ground.
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
    """Redirect file descriptor 1 to standard error, for output of native code."""
    sys.stdout.flush()
    kept = os.dup(1)
    try:
        os.dup2(2, 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
