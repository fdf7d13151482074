"""Inertial measurements, preintegrated between knots, with slowly varying biases.

Forster et al. 2017, IEEE Trans. Robotics 33, 1-21.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.banded import NormalEquations
from furrowmap.core.adjustment.knots import (
    GNSS_DRIFT,
    KNOT_STEP_S,
    POSE,
    POSITION_COLUMN,
    ROTATION,
    Knots,
    Observation,
    State,
    StateBlock,
    StateLayout,
)
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel, kernel_part
from furrowmap.core.values.inertial import InertialNoise, InertialTrack

VELOCITY: Final = StateBlock("velocity_mps", 3)
"""Of the IMU over the ground, in the map's axes: metres on the ground, not of the map."""
RATE_BIAS: Final = StateBlock("rate_bias_radps", 3)
FORCE_BIAS: Final = StateBlock("force_bias_mps2", 3)
"""Biases of the IMU in the axes of the vehicle: measured minus true."""
INERTIAL: Final = StateLayout((GNSS_DRIFT, VELOCITY, RATE_BIAS, FORCE_BIAS))
"""Of a vehicle with GNSS and an IMU."""
SAMPLES_BESIDE: Final = 4
"""Samples before an interval and after it that its integration may use."""
MIN_WAY_SIGMA_M: Final = 1e-5
"""Standard deviation of a way from knot to knot beside the noise: rates and forces are not linear between samples."""


@dataclass(frozen=True)
class Increments:
    """Motion of an IMU from each of k times to the next, in the axes at the earlier time, without gravity.

    Attributes:
        turn: (k, 3, 3) rotation matrix from the later axes to the earlier.
        velocity_mps: (k, 3) change of velocity.
        way_m: (k, 3) way beyond that of the velocity at the beginning.
    """

    turn: FloatArray
    velocity_mps: FloatArray
    way_m: FloatArray


def increments(
    t_s: FloatArray, rate_radps: FloatArray, force_mps2: FloatArray, begin_s: FloatArray, end_s: FloatArray
) -> Increments:
    """Integrate samples, between which rate and force are linear, over intervals that begin (k,) within their times."""
    first = np.searchsorted(t_s, begin_s, side="right").astype(np.int64)
    arrays = (np.ascontiguousarray(a, np.float64) for a in (t_s, rate_radps, force_mps2, begin_s, end_s))
    return Increments(*_increments(*arrays, first))


@kernel()
def _value(t_s, values, k, at_s, out):  # type: ignore[no-untyped-def]
    """The value at a time between samples k − 1 and k."""
    share = (at_s - t_s[k - 1]) / (t_s[k] - t_s[k - 1])
    for a in range(3):
        out[a] = values[k - 1, a] + share * (values[k, a] - values[k - 1, a])


@kernel_part()
def _product(a, b, out):  # type: ignore[no-untyped-def]
    """The product of matrices (3, 3); NumPy's takes longer than the sums do."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@kernel()
def exponential(x, y, z):  # type: ignore[no-untyped-def]
    """Rotation matrix (3, 3) of a rotation vector (Rodrigues)."""
    angle = np.sqrt(x * x + y * y + z * z)
    a = np.sinc(angle / np.pi)
    b = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    out = np.empty((3, 3))
    out[0, 0] = 1.0 - b * (y * y + z * z)
    out[1, 1] = 1.0 - b * (x * x + z * z)
    out[2, 2] = 1.0 - b * (x * x + y * y)
    out[0, 1] = b * x * y - a * z
    out[1, 0] = b * x * y + a * z
    out[0, 2] = b * x * z + a * y
    out[2, 0] = b * x * z - a * y
    out[1, 2] = b * y * z - a * x
    out[2, 1] = b * y * z + a * x
    return out


@kernel()
def _increments(t_s, rate, force, begin_s, end_s, first):  # type: ignore[no-untyped-def]
    count = len(begin_s)
    n = len(t_s)
    turn = np.zeros((count, 3, 3)) + np.eye(3)
    velocity = np.zeros((count, 3))
    way = np.zeros((count, 3))
    w0 = np.empty(3)
    w1 = np.empty(3)
    f0 = np.empty(3)
    f1 = np.empty(3)
    middle = np.empty((3, 3))
    for i in range(count):
        k = min(max(first[i], 1), n - 1)
        now = begin_s[i]
        _value(t_s, rate, k, now, w0)
        _value(t_s, force, k, now, f0)
        turned = turn[i]
        while now < end_s[i]:
            then = min(t_s[k], end_s[i]) if k < n - 1 else end_s[i]
            _value(t_s, rate, k, then, w1)
            _value(t_s, force, k, then, f1)
            dt = then - now
            half = 0.25 * dt  # of the mean of both rates
            half_turn = exponential(half * (w0[0] + w1[0]), half * (w0[1] + w1[1]), half * (w0[2] + w1[2]))
            _product(turned, half_turn, middle)
            for a in range(3):
                row = middle[a]
                pushed = 0.5 * (row[0] * (f0[0] + f1[0]) + row[1] * (f0[1] + f1[1]) + row[2] * (f0[2] + f1[2]))
                way[i, a] += velocity[i, a] * dt + 0.5 * pushed * dt * dt
                velocity[i, a] += pushed * dt
            _product(middle, half_turn, turned)
            w0[:] = w1
            f0[:] = f1
            now = then
            if k < n - 1:
                k += 1
    return turn, velocity, way


@dataclass(frozen=True)
class Site:
    """Where the vehicle moves.

    Attributes:
        earth_rate_radps: (3,) rotation of the earth in the map's axes.
        radius_m: of curvature of the ellipsoid.
        scale: map distance over distance on the ground.
    """

    gravity_mps2: float
    earth_rate_radps: FloatArray
    radius_m: float
    scale: float

    @property
    def stretch(self) -> FloatArray:
        """(3,) metres of the map for a metre on the ground, by axis."""
        return np.array([self.scale, self.scale, 1.0])

    def frame_rate_radps(self, velocity_mps: FloatArray) -> FloatArray:
        """(n, 3) rotation of the map's axes against inertial space, as they follow the vehicle over the ellipsoid.

        About the vertical, the axes of a conformal map turn with the meridians' convergence, which the curvature of
        the parallels cancels.
        """
        east = velocity_mps[:, 0]
        north = velocity_mps[:, 1]
        return self.earth_rate_radps + np.column_stack([-north, east, 0.0 * east]) / self.radius_m

    def acceleration_mps2(self, velocity_mps: FloatArray) -> FloatArray:
        """(n, 3) gravity and Coriolis acceleration in the map's axes."""
        turning = self.earth_rate_radps + self.frame_rate_radps(velocity_mps)
        return np.array([0.0, 0.0, -self.gravity_mps2]) - np.cross(turning, velocity_mps)


@dataclass(frozen=True)
class InertialLinks(Observation):
    """Rotation, velocity and way from knot to knot by the IMU, and the random walks of its biases.

    The residuals are those of preintegrated measurements (Forster et al. 2017, section VI), integrated anew at the
    biases of each state. Half of the velocity's residual is taken off that of the way: what is left has a third of the
    variance and is independent of it for white noise of the force.

    Attributes:
        track: in the axes of the vehicle.
        lever_m: (3,) the IMU in the vehicle frame.
        force_times: factors of the noise of the specific force, of the map's axes and of the height.
    """

    track: InertialTrack
    lever_m: FloatArray
    noise: InertialNoise
    site: Site
    force_times: tuple[float, float] = (1.0, 1.0)

    def add(self, equations: NormalEquations, knots: Knots, state: State) -> None:
        """Nine equations for the increments and six for the biases of each two knots, and the biases of each chain."""
        linked = knots.linked
        for part in arrays.parts(len(linked), arrays.ROWS_AT_ONCE // 2):
            self._add_increments(equations, knots, state, linked[part])
        n = self.noise
        for block, walk, spread in (
            (RATE_BIAS, n.rate_walk, n.rate_bias), (FORCE_BIAS, n.force_walk, n.force_bias)
        ):  # fmt: skip
            add_walk(equations, knots, state, block, walk, spread)

    def _add_increments(
        self, equations: NormalEquations, knots: Knots, state: State, linked: NDArray[np.int64]
    ) -> None:
        """Nine equations from each of the knots (k,) to the next."""
        size = state.layout.size
        computed = predicted(self, knots, state, linked)
        velocity, rate, force = (state.layout.column(block) for block in (VELOCITY, RATE_BIAS, FORCE_BIAS))
        dt = KNOT_STEP_S
        rotation = state.rotation[linked]
        stretch = self.site.stretch

        turned = Rotation.from_matrix(state.rotation[linked + 1] @ computed.rotation.transpose(0, 2, 1)).as_rotvec()
        pushed = np.einsum("kij,kj->ki", rotation, computed.steps.velocity_mps)
        moved = stretch * np.einsum("kij,kj->ki", rotation, computed.steps.way_m)
        arm, arm_next = (stretch * (state.rotation[k] @ self.lever_m) for k in (linked, linked + 1))
        faster = state[VELOCITY][linked + 1] - computed.velocity_mps
        farther = state.xyz_m[linked + 1] + arm_next - computed.xyz_m - 0.5 * dt * stretch * faster

        design = np.zeros((3, len(linked), 3, 2 * size))
        turn_rows, velocity_rows, way_rows = design
        turn_rows[:, :, ROTATION:POSE] = -np.eye(3)
        turn_rows[:, :, size + ROTATION : size + POSE] = np.eye(3)
        turn_rows[:, :, rate : rate + 3] = dt * rotation
        velocity_rows[:, :, velocity : velocity + 3] = -np.eye(3)
        velocity_rows[:, :, size + velocity : size + velocity + 3] = np.eye(3)
        velocity_rows[:, :, ROTATION:POSE] = cross_matrix(pushed)
        velocity_rows[:, :, force : force + 3] = dt * rotation
        way_rows[:, :, POSITION_COLUMN:ROTATION] = -np.eye(3)
        way_rows[:, :, size : size + 3] = np.eye(3)
        way_rows[:, :, velocity : velocity + 3] = -dt * np.diag(stretch)
        way_rows[:, :, ROTATION:POSE] = cross_matrix(moved + arm)
        way_rows[:, :, size + ROTATION : size + POSE] = -cross_matrix(arm_next)
        way_rows[:, :, force : force + 3] = 0.5 * dt**2 * stretch[:, None] * rotation
        way_rows -= 0.5 * dt * stretch[:, None] * velocity_rows

        push_noise = self.noise.force * np.repeat(self.force_times, (2, 1))
        way_sigma = np.hypot(push_noise * np.sqrt(dt**3 / 12.0), MIN_WAY_SIGMA_M)
        sigma = np.full(3, self.noise.rate * np.sqrt(dt)), push_noise * np.sqrt(dt), way_sigma
        for rows, residual, ones in zip(design, (-turned, -faster, -farther), sigma, strict=True):
            for axis in range(3):
                equations.add(linked * size, rows[:, axis], residual[:, axis], np.full(len(linked), ones[axis]))


@dataclass(frozen=True)
class Predicted:
    """States at the later of each two linked knots, by the earlier one and the IMU.

    Attributes:
        rotation: (k, 3, 3) vehicle to map.
        velocity_mps: (k, 3) of the IMU.
        xyz_m: (k, 3) of the IMU, against the local origin.
    """

    steps: Increments
    rotation: FloatArray
    velocity_mps: FloatArray
    xyz_m: FloatArray


def predicted(links: InertialLinks, knots: Knots, state: State, linked: NDArray[np.int64]) -> Predicted:
    """The states that the IMU predicts from each of some linked knots (k,), which increase, for the next."""
    dt = KNOT_STEP_S
    steps = unbiased_increments(links, knots, state, knots.t_s[linked], knots.t_s[linked] + dt)
    return carried_on(links, state, linked, steps, np.full(len(linked), dt))


def carried_on(
    links: InertialLinks, state: State, knot: NDArray[np.int64], steps: Increments, dt: FloatArray
) -> Predicted:
    """The states some time `dt` (k,) after the knots (k,), by the increments of that time."""
    velocity = state[VELOCITY][knot]
    rotation = state.rotation[knot]
    site = links.site
    fall = site.acceleration_mps2(velocity)
    frame = Rotation.from_rotvec(-site.frame_rate_radps(velocity) * dt[:, None]).as_matrix()
    pushed = np.einsum("kij,kj->ki", rotation, steps.velocity_mps)
    moved = np.einsum("kij,kj->ki", rotation, steps.way_m)
    t = dt[:, None]
    way = velocity * t + 0.5 * fall * t**2 + moved
    xyz = state.xyz_m[knot] + site.stretch * (rotation @ links.lever_m + way)
    return Predicted(steps, frame @ rotation @ steps.turn, velocity + fall * t + pushed, xyz)


def unbiased_increments(
    links: InertialLinks, knots: Knots, state: State, begin_s: FloatArray, end_s: FloatArray
) -> Increments:
    """Increments over intervals (k,), without the biases of the knots before the samples."""
    track = links.track
    if len(begin_s):
        # The samples within, and those beside the ends, between which they are interpolated there.
        first, last = np.searchsorted(track.t_s, (begin_s[0], end_s.max()))
        track = track.part(slice(max(0, int(first) - SAMPLES_BESIDE), int(last) + SAMPLES_BESIDE))
    bias = np.clip(np.searchsorted(knots.t_s, track.t_s, side="right") - 1, 0, len(knots) - 1)
    rate = track.rate_radps - state[RATE_BIAS][bias]
    force = track.force_mps2 - state[FORCE_BIAS][bias]
    return increments(track.t_s, rate, force, begin_s, end_s)


def cross_matrix(vectors: FloatArray) -> FloatArray:
    """(k, 3, 3) matrices that multiply as the cross product with vectors (k, 3) from the left does."""
    x, y, z = vectors.T
    o = np.zeros_like(x)
    return np.stack([np.stack([o, -z, y], 1), np.stack([z, o, -x], 1), np.stack([-y, x, o], 1)], 1)


def add_walk(
    equations: NormalEquations, knots: Knots, state: State, block: StateBlock, walk: float, spread: float
) -> None:
    """A random walk from knot to knot, and its spread at the begin of each chain."""
    linked = knots.linked
    size = state.layout.size
    first = state.layout.column(block)
    starts = np.array([chain.first for chain in knots.chains])
    row = np.zeros(size + 1)
    row[0] = -1.0
    row[size] = 1.0
    design = np.broadcast_to(row, (len(linked), len(row)))
    value = state[block]
    for axis in range(block.size):
        step = value[linked, axis] - value[linked + 1, axis]
        equations.add(linked * size + first + axis, design, step, np.full(len(linked), walk * np.sqrt(KNOT_STEP_S)))
        begin = np.ones((len(starts), 1))
        equations.add(starts * size + first + axis, begin, -value[starts, axis], np.full(len(starts), spread))
