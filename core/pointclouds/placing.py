"""Every point placed by the pose of its own firing."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.values.rotation import Mounting, quaternion_to_matrix
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.trajectory import Trajectory

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Placer:
    """Places points of the lidar frame in the map frame.

    Attributes:
        trajectory: of the vehicle frame.
        mounting: of the sensor.
        origin_m: local origin (easting, northing, height) that is taken off the coordinates given out.
        carrier: trajectory of the frame that the mounting refers to, where that is not the vehicle: a moving mount.
        scale: metres of the map for a metre on the ground, by which eastings and northings of ranges are stretched.
    """

    trajectory: Trajectory
    mounting: Mounting
    origin_m: tuple[float, float, float]
    carrier: Trajectory | None = None
    scale: float = 1.0

    @cached_property
    def _knots(self) -> tuple[FloatArray, ...]:
        """Contiguous arrays of the trajectory as the kernel takes them, positions against the local origin."""
        t = self.trajectory if self.carrier is None else self.carrier
        return (
            np.ascontiguousarray(t.t_s),
            np.ascontiguousarray(t.xyz_m - np.asarray(self.origin_m)),
            np.ascontiguousarray(quaternion_to_matrix(t.quaternion) * [[self.scale], [self.scale], [1.0]]),
            np.ascontiguousarray(t.turn_rad),
        )

    def place(self, scan: Scan) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Map coordinates of a scan's points.

        Returns:
            (n, 3) easting, northing, height less `origin_m`, and (n,) whether there is a pose at the point's time;
            coordinates without a pose are nan.
        """
        if len(self.trajectory) < 2:
            return np.full((len(scan), 3), np.nan), np.zeros(len(scan), bool)
        coordinates, known = place_points(
            np.ascontiguousarray(scan.t_s, np.float64),
            np.ascontiguousarray(scan.xyz_m, np.float32),
            np.ascontiguousarray(self.mounting.rotation),
            np.asarray(self.mounting.xyz_m, np.float64),
            *self._knots,
            self.trajectory.max_gap_s,
        )
        return coordinates, known


@numba.njit(
    "Tuple((float64[:, ::1], boolean[::1]))(float64[::1], float32[:, ::1], float64[:, ::1], float64[::1],"
    " float64[::1], float64[:, ::1], float64[:, :, ::1], float64[:, ::1], float64)",
    cache=True,
    nogil=True,
)
def place_points(  # type: ignore[no-untyped-def]
    t_s, xyz_m, mount, lever_m, knot_s, knot_m, knot_rotation, turn_rad, max_gap_s
):
    """Kernel of :meth:`Placer.place`: ``p = X(t) + R(t) (M p_lidar + lever)``.

    Between knots X is straight and ``R(t) = R_k exp(s·ω)``: Rodrigues' formula about the turn ω to the next knot. The
    rows of R that give easting and northing may be multiplied by a scale.
    """
    n, m = len(t_s), len(knot_s)
    out = np.empty((n, 3))
    known = np.zeros(n, np.bool_)
    k = 0
    for i in range(n):
        t = t_s[i]
        if not (knot_s[0] <= t <= knot_s[m - 1]):
            out[i] = np.nan
            continue
        if not (knot_s[k] <= t <= knot_s[k + 1]):
            k = min(max(np.searchsorted(knot_s, t, side="right") - 1, 0), m - 2)
        step = knot_s[k + 1] - knot_s[k]
        share = (t - knot_s[k]) / step
        if step > max_gap_s and 0.0 < share < 1.0:
            out[i] = np.nan
            continue
        px, py, pz = xyz_m[i, 0], xyz_m[i, 1], xyz_m[i, 2]
        vx = mount[0, 0] * px + mount[0, 1] * py + mount[0, 2] * pz + lever_m[0]
        vy = mount[1, 0] * px + mount[1, 1] * py + mount[1, 2] * pz + lever_m[1]
        vz = mount[2, 0] * px + mount[2, 1] * py + mount[2, 2] * pz + lever_m[2]
        wx, wy, wz = share * turn_rad[k, 0], share * turn_rad[k, 1], share * turn_rad[k, 2]
        square = wx * wx + wy * wy + wz * wz
        if square > 1e-4:
            angle = np.sqrt(square)
            a, b = np.sin(angle) / angle, (1.0 - np.cos(angle)) / square
        else:  # Taylor series of the same, good to 1e-15 here
            a = 1.0 - square / 6.0 * (1.0 - square / 20.0)
            b = 0.5 - square / 24.0 * (1.0 - square / 30.0)
        cx, cy, cz = wy * vz - wz * vy, wz * vx - wx * vz, wx * vy - wy * vx
        vx += a * cx + b * (wy * cz - wz * cy)
        vy += a * cy + b * (wz * cx - wx * cz)
        vz += a * cz + b * (wx * cy - wy * cx)
        for j in range(3):
            out[i, j] = (
                knot_m[k, j]
                + share * (knot_m[k + 1, j] - knot_m[k, j])
                + knot_rotation[k, j, 0] * vx
                + knot_rotation[k, j, 1] * vy
                + knot_rotation[k, j, 2] * vz
            )
        known[i] = True
    return out, known
