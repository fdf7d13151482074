"""Errors of the poses of a trajectory at a few times, how they go together, and poses without them."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.knots import POSE, ROTATION
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.trajectory import Trajectory, same_hemisphere


@dataclass(frozen=True)
class PoseErrors:
    """Errors of poses at nodes in time, between which they are interpolated.

    Attributes:
        t_s: (m,) times of the nodes.
        value: (m, 6) easting, northing, height (m), and rotation vector in the map's axes (rad): found minus true.
        covariance: (6 m, 6 m) of all of them.
    """

    t_s: FloatArray
    value: FloatArray
    covariance: FloatArray

    def sigma(self, rotation: FloatArray) -> FloatArray:
        """(m, 6) sigmas of easting, northing, height (m), roll, pitch, heading (rad) at rotations (m, 3, 3)."""
        m = len(self.t_s)
        own = self.covariance.reshape(m, POSE, m, POSE)[np.arange(m), :, np.arange(m)]
        turn = own[:, ROTATION:, ROTATION:]
        level = [np.einsum("ki,kij,kj->k", rotation[:, :, a], turn, rotation[:, :, a]) for a in range(2)]
        out: FloatArray = np.sqrt(np.column_stack([*(own[:, a, a] for a in range(ROTATION)), *level, turn[:, 2, 2]]))
        return out


def without_errors(trajectory: Trajectory, before: PoseErrors, found: PoseErrors) -> Trajectory:
    """The trajectory without errors that were found.

    Its standard deviations become smaller in the same ratio as those of the nodes beside them.

    Args:
        before: the errors as the trajectory's own adjustment knows them: zero.
    """
    nodes = np.clip(before.t_s, *trajectory.span_s)
    k = np.minimum(np.searchsorted(trajectory.t_s, nodes), len(trajectory) - 1)
    attitude = Rotation.from_quat(trajectory.quaternion[k], scalar_first=True).as_matrix()
    ratio = found.sigma(attitude) / before.sigma(attitude)

    def corrected(part: slice) -> tuple[FloatArray, FloatArray, FloatArray]:
        off, share = (
            np.column_stack([np.interp(trajectory.t_s[part], before.t_s, values[:, a]) for a in range(POSE)])
            for values in (found.value, ratio)
        )
        turned = Rotation.from_quat(trajectory.quaternion[part], scalar_first=True)
        quaternion = (Rotation.from_rotvec(-off[:, ROTATION:]) * turned).as_quat(scalar_first=True)
        return trajectory.xyz_m[part] - off[:, :ROTATION], quaternion, trajectory.sigma[part] * share

    xyz, quaternion, sigma = arrays.in_parts(corrected, len(trajectory))
    return replace(trajectory, xyz_m=xyz, quaternion=same_hemisphere(quaternion), sigma=sigma)
