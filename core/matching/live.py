"""Scan matching as the recording goes on: the pose of each scan as soon as it has come.

A fixed-lag smoother of the same parts as the adjustment of a whole session. The poses of the last seconds are sought
at knots; their returns are matched to the ground that they show together with the ground seen before
(:mod:`rolling_base`). Knots that leave the window pass on what they know (:mod:`sliding`), their returns become ground
seen before. Neither time nor memory grow with the length of the drive.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.estimation.knots import PAUSE_S, STEP_S, Chain, Knots, State, place, start_from, turns
from furrowmap.core.geodesy.coordinates import brought_track
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.matching.adjustment import GUARD_S, TOOL_CELL_M, TOOL_MARGIN_M, Tool
from furrowmap.core.matching.agreement import CoarseGrid, Relief, Sums, agree
from furrowmap.core.matching.coarse import SIZE
from furrowmap.core.matching.equations import hold, position_trust
from furrowmap.core.matching.returns import BODY_SHARE, LEARN_SCANS, PIXELS, ground_height_m, grown, on_body, select
from furrowmap.core.matching.rolling_base import RollingBase
from furrowmap.core.matching.sliding import (
    Alignment,
    Bordered,
    Prior,
    add_steering,
    cross_matrix,
    marginalised,
    part_of,
    ways_m,
)
from furrowmap.core.matching.surface import add_returns, layers, passage_of
from furrowmap.core.trajectory.from_gnss import trajectory_from_gnss
from furrowmap.core.trajectory.motion import STANDING_MPS
from furrowmap.core.trajectory.positions import Positions, positions_of, sigmas_m, white_noise_m
from furrowmap.core.values.errors import FurrowmapError
from furrowmap.core.values.gnss import Fix, GnssTrack
from furrowmap.core.values.mounting import Mounting
from furrowmap.core.values.rotation import wrap_deg
from furrowmap.core.values.scan import Scan

FloatArray = NDArray[np.float64]

WINDOW_S: Final = 2.5
CELL_M: Final = 0.15
RATE_HZ: Final = 8_000.0
"""Returns a second that take part."""
STEPS: Final = 2
"""Gauss-Newton steps for each scan."""
START_STEPS: Final = 12
START_WAY_M: Final = 1.0
START_HEADING_DEG: Final = 2.0
"""Poses are given from where the positions lie this far apart and show the heading this well."""
LONG_WAY_M: Final = 4.0
"""After this way they are given however well it shows."""
START_KEPT_S: Final = 10.0
TRACK_KEPT_S: Final = 30.0
"""Positions that are kept to judge the next ones by."""
RELIEF_KEPT: Final = 0.98
"""Of what scans said about the relief, at each new one."""
UNTRIMMED: Final = np.inf
"""The few scans in the window at the start show too little of the relief to tell which slopes are not part of it."""
BODY_EVERY: Final = 10
"""Scans from one look at the vehicle's footprint to the next."""
ANTENNAS_OFF_DEG: Final = 45.0


@dataclass(frozen=True)
class LivePose:
    """The vehicle frame's pose in the middle of a scan.

    Attributes:
        t_s: UTC.
        xyz_m: (3,) easting, northing, height of the vehicle frame's origin.
        quaternion: (4,) (w, x, y, z), vehicle to map.
        sigma: (6,) standard deviations, see :data:`~furrowmap.core.values.trajectory.SIGMAS`.
    """

    t_s: float
    xyz_m: FloatArray
    quaternion: FloatArray
    sigma: FloatArray


class LiveMatching:
    """Takes positions and scans in the order of time and gives the pose of each scan.

    Args:
        mounting: of the sensor.
        lever_m: the antenna in the vehicle frame.
        tool: where an implement changes the soil; None if none is known.
        frame: the map frame.
        lidar_minus_gnss_s: what the sensor's clock is ahead of the positions'.
        fixes: qualities of positions that are used.
    """

    def __init__(
        self,
        mounting: Mounting,
        lever_m: tuple[float, float, float],
        tool: Tool | None,
        frame: MapFrame,
        lidar_minus_gnss_s: float = 0.0,
        fixes: tuple[Fix, ...] = (Fix.FIXED, Fix.FLOAT, Fix.SIMULATED),
    ) -> None:
        self._ground = _Ground(mounting)
        self._lever_m, self._tool, self._frame, self._fixes = lever_m, tool, frame, fixes
        self._offset_s = lidar_minus_gnss_s
        self._track: GnssTrack | None = None
        self._positions: Positions | None = None
        self._returns = _Returns.none()
        self._window: _Window | None = None

    def hear(self, track: GnssTrack) -> None:
        """Take positions that have come, as the receiver gave them: they are brought to the map's epoch and heights.

        Raises:
            InputError: if parameters or geoid do not cover a position, or parameters are of another time.
        """
        use = np.isin(track.fix, self._fixes) & np.isfinite(track.lon_deg) & np.isfinite(track.height_m)
        if self._track is not None:
            use &= track.t_s > self._track.t_s[-1]
        if not use.any():
            return
        came, _ = brought_track(track[use], self._frame)
        track = came if self._track is None else _joined(self._track, came)
        track = track[track.t_s >= track.t_s[-1] - TRACK_KEPT_S]
        en = np.column_stack(self._frame.project(track.lon_deg, track.lat_deg))
        self._track = track
        self._positions = positions_of(track, en, white_noise_m(track, en, sigmas_m(track)[:, 0]), self._heading(track))

    def see(self, scan: Scan) -> LivePose | None:
        """Take a scan that has come and give its pose; None as long as nothing shows where the vehicle heads.

        Where positions and ground hold the window no more, it is given up, and matching begins anew.
        """
        self.settle()
        if not len(scan):
            return None
        t_s = scan.t_s - self._offset_s
        end_s = float(t_s.max())
        window = self._window
        if window is not None and end_s - window.knots.t_s[-1] > PAUSE_S:
            self._window = window = None
            self._returns = _Returns.none()
        for part in self._ground.returns(scan, t_s, moves=window is not None and window.speed_mps() > STANDING_MPS):
            self._returns = self._returns.plus(part)
        steps = STEPS
        if window is None:
            window = self._window = self._start(end_s)
            steps = START_STEPS
            if window is None:
                self._returns = self._returns.since(end_s - START_KEPT_S)
                return None
        window.extend(end_s)
        self._returns = self._returns.since(window.begin_s)
        assert self._positions is not None
        try:
            for _ in range(steps - 1):
                window.step(self._returns, self._positions)
            return window.step(self._returns, self._positions, 0.5 * float(t_s.min() + end_s))
        except np.linalg.LinAlgError:
            self._begin_anew()
            return None

    def settle(self) -> None:
        """Put away what is older than the window: time to do so is when a pose has been given out.

        :meth:`see` does it first where it has not been done.
        """
        if self._window is None or self._positions is None:
            return
        try:
            self._returns = self._window.retire(self._returns, self._positions)
        except np.linalg.LinAlgError:
            self._begin_anew()

    def _begin_anew(self) -> None:
        """Give up a window that positions and ground hold no more; the scans to come make another."""
        self._window, self._returns = None, _Returns.none()

    def _heading(self, track: GnssTrack) -> FloatArray:
        """Grid heading (n,) of two antennas, nan where there is none or it is not the vehicle's."""
        if not np.isfinite(track.heading_deg).any():
            return track.heading_deg
        heading = track.heading_deg - self._frame.convergence_deg(track.lon_deg, track.lat_deg)
        if self._window is None:
            return heading
        off = wrap_deg(heading - self._window.heading_deg())
        return np.where(np.abs(off) < ANTENNAS_OFF_DEG, heading, np.nan)

    def _start(self, now_s: float) -> _Window | None:
        """The first window, if the positions show a heading by now."""
        if self._positions is None or self._track is None or len(self._track) < 10 or not len(self._returns.t_s):
            return None
        en = self._positions.xyz_m[:, :2]
        way_m = float(np.hypot(*(en - en[-1]).T).max())
        if way_m < START_WAY_M:
            return None
        try:
            found = trajectory_from_gnss(self._track, self._frame, self._lever_m, self._fixes).trajectory
        except FurrowmapError:
            return None
        shown = found.sigma[-1, 5] < START_HEADING_DEG or way_m > LONG_WAY_M
        if not shown or now_s - found.span_s[1] > PAUSE_S:
            return None
        begin_s = max(found.span_s[0], now_s - WINDOW_S)
        origin_m = np.round(found.xyz_m[-1])
        knots = _knots(begin_s, int(np.ceil((now_s - begin_s) / STEP_S)) + 2)
        return _Window(begin_s, start_from(found, knots, origin_m), origin_m, np.asarray(self._lever_m), self._tool)


class _Window:
    """The last seconds: their knots, in a local frame, and what is known from before.

    Args:
        begin_s: time of the first knot.
        state: of the knots.
        origin_m: (3,) local origin.
        lever_m: (3,) the antenna in the vehicle frame.
        tool: where an implement changes the soil.
    """

    def __init__(
        self, begin_s: float, state: State, origin_m: FloatArray, lever_m: FloatArray, tool: Tool | None
    ) -> None:
        self.begin_s = begin_s
        self._state, self._origin_m, self._lever_m, self._tool = state, origin_m, lever_m, tool
        self._alignment = Alignment(np.eye(3), np.zeros(3))
        self._prior, self._first = Prior.of_start(state), True
        self._twist, self._centre_m = np.zeros(6), state.xyz_m[-1]
        self._base = RollingBase(state.xyz_m[-1], CELL_M)
        self._relief, self._tally = Relief(trim=UNTRIMMED), np.zeros(7)
        self._sums = Sums.of(len(state.xyz_m))
        self._trust: dict[float, float] = {}

    @property
    def knots(self) -> Knots:
        """The knots, a chain."""
        return _knots(self.begin_s, len(self._state.xyz_m))

    def speed_mps(self) -> float:
        """At the end of the window."""
        return float(ways_m(self._state)[-1] / STEP_S)

    def heading_deg(self) -> float:
        """In the map, at the end of the window."""
        e, n, _ = self._alignment.rotation @ self._state.rotation[-1, :, 0]
        return float(90.0 - np.degrees(np.arctan2(n, e)))

    def extend(self, to_s: float) -> None:
        """Knots on to a time, with the speed and the rate of turn of the last ones."""
        state, n = self._state, len(self._state.xyz_m)
        count = int(np.ceil((to_s - self.begin_s) / STEP_S)) + 2
        if count <= n:
            return
        back = min(8, n - 1)
        velocity = (state.xyz_m[-1] - state.xyz_m[-1 - back]) / back
        (x, y), (u, v) = state.rotation[[-1 - back, -1], :2, 0]
        turn = np.arctan2(x * v - y * u, x * u + y * v) / back
        ahead = np.arange(1, count - n + 1)
        rotation = Rotation.from_rotvec(np.outer(ahead, [0.0, 0.0, turn])) * Rotation.from_matrix(state.rotation[-1])
        self._state = State(
            np.concatenate([state.xyz_m, state.xyz_m[-1] + ahead[:, None] * velocity]),
            np.concatenate([state.rotation, rotation.as_matrix()]),
            np.concatenate([state.drift_m, np.repeat(state.drift_m[-1:], len(ahead), axis=0)]),
        )

    def step(self, returns: _Returns, positions: Positions, pose_at_s: float | None = None) -> LivePose | None:
        """One Gauss-Newton step of all knots and of how they lie in the map; gives the pose at a time if asked to."""
        knots, state = self.knots, self._state
        xyz, layer = self._placed(returns)
        surface = self._base.copy()
        add_returns(surface, xyz, layer, returns.half, returns.trust)
        self._sums = Sums.of(len(knots))
        agree(
            knots.chains[0],
            returns.t_s,
            xyz,
            layer,
            returns.half,
            returns.trust,
            surface,
            np.ascontiguousarray(state.xyz_m),
            self._relief,
            1.0,
            self._sums,
            CoarseGrid(0, 0, 1.0),
        )
        self._tally = RELIEF_KEPT * self._tally + self._sums.tally
        self._relief = Relief.of(self._tally, UNTRIMMED)
        near = self._near(positions)
        trust = np.array([self._trust.get(t, 1.0) for t in near.t_s.tolist()])
        held = hold(knots, state, self._sums, self._sums.right, near, self._origin_m, self._lever_m, trust)
        self._trust = dict(zip(near.t_s.tolist(), position_trust(held.misfit).tolist(), strict=True))
        add_steering(held.equations, knots, state, ways_m(state))
        equations = Bordered.of(
            held.equations, knots, state, near, self._origin_m, self._lever_m, trust, self._centre_m
        )
        if not self._first:
            equations.without_drift_start(state, self.begin_s, near)
        equations.add_prior(self._prior, state, self._twist)
        nothing = np.zeros((len(knots) * SIZE, 0)), np.zeros((6, 0))
        design = self._pose_design(pose_at_s) if pose_at_s is not None else nothing
        step, twist, covariance = equations.solve(*design)
        self._state = state.moved(step.reshape(-1, SIZE))
        self._twist = self._twist + twist
        self._alignment = self._alignment.moved(twist, self._centre_m)
        return self._pose(pose_at_s, covariance) if pose_at_s is not None else None

    def retire(self, returns: _Returns, positions: Positions) -> _Returns:
        """Let knots and returns that are too old leave; gives the returns that stay."""
        leaving = len(self._state.xyz_m) - int(WINDOW_S / STEP_S)
        if leaving <= 0:
            return returns
        self._keep_ground(returns, leaving)
        near, end = self._near(positions), self._state.xyz_m[-1]
        whole, rest = self._part(0, leaving + 2, near), self._part(leaving, leaving + 2, near)
        remaining = part_of(self._state, leaving, leaving + 2)
        begin_s = self.begin_s + leaving * STEP_S
        if not self._first:
            whole.without_drift_start(self._state, self.begin_s, near)
        whole.add_prior(self._prior, self._state, self._twist)
        rest.without_drift_start(remaining, begin_s, near)
        self._prior = marginalised(whole, rest, remaining, end - self._centre_m, leaving * STEP_S)
        self._twist, self._centre_m, self._first = np.zeros(6), end, False
        self._state = part_of(self._state, leaving, len(self._state.xyz_m))
        self.begin_s = begin_s
        self._base.follow(end)
        return returns.since(begin_s)

    def _part(self, first: int, last: int, positions: Positions) -> Bordered:
        """Equations of some of the knots, with the ground and the positions before the last of their intervals."""
        knots, state = _knots(self.begin_s + first * STEP_S, last - first), part_of(self._state, first, last)
        sums = Sums.of(len(knots))
        sums.normal[:-2] = self._sums.normal[first : last - 2]
        sums.right[:-2] = self._sums.right[first : last - 2]
        early = positions.t_s < knots.t_s[-2]
        trust = np.where(early, [self._trust.get(t, 1.0) for t in positions.t_s.tolist()], 1e-12)
        held = hold(knots, state, sums, sums.right, positions, self._origin_m, self._lever_m, trust).equations
        add_steering(held, knots, state, ways_m(self._state)[first : last - 1])
        return Bordered.of(held, knots, state, positions, self._origin_m, self._lever_m, trust, self._centre_m)

    def _near(self, positions: Positions) -> Positions:
        """The positions of the window and the last one before, in the local frame."""
        first = max(0, int(np.searchsorted(positions.t_s, self.begin_s)) - 1)
        last = max(first + 1, int(np.searchsorted(positions.t_s, self.knots.t_s[-1], side="right")))
        part = {field.name: getattr(positions, field.name)[first:last] for field in fields(Positions)}
        part["xyz_m"] = self._alignment.to_local(part["xyz_m"] - self._origin_m) + self._origin_m
        part["yaw_rad"] = part["yaw_rad"] - self._alignment.yaw_rad
        return Positions(**part)

    def _placed(self, returns: _Returns) -> tuple[FloatArray, NDArray[np.int8]]:
        """Where the returns lie in the local frame, and the layers of soil they are of."""
        xyz_m, rotation = np.ascontiguousarray(self._state.xyz_m), np.ascontiguousarray(self._state.rotation)
        xyz = place(returns.t_s, returns.xyz_m, 0, self.begin_s, STEP_S, xyz_m, rotation, turns(rotation))
        if self._tool is None:
            return xyz, np.zeros(len(xyz), np.int8)
        middle, left = self._tool_line(slice(None, None, 2), self._tool)
        half_width_m = self._tool.half_width_m + TOOL_MARGIN_M
        return xyz, layers(
            returns.t_s, xyz, passage_of(self.knots.t_s[::2], middle, left, half_width_m, TOOL_CELL_M), GUARD_S
        )

    def _tool_line(self, knots: slice, tool: Tool) -> tuple[FloatArray, FloatArray]:
        """Middle (n, 2) of the implement's line at the knots, and the way to its left (n, 2)."""
        rotation = self._state.rotation[knots]
        left = np.ascontiguousarray(rotation[:, :2, 1])
        return self._state.xyz_m[knots, :2] + tool.xy_m[0] * rotation[:, :2, 0] + tool.xy_m[1] * left, left

    def _keep_ground(self, returns: _Returns, leaving: int) -> None:
        """Leaving returns become ground seen before, but for soil that the implement has passed over by then."""
        xyz, layer = self._placed(returns)
        old = slice(0, int(np.searchsorted(returns.t_s, self.begin_s + leaving * STEP_S)))
        xyz, layer, half, trust = xyz[old], layer[old], returns.half[old], returns.trust[old]
        self._base.add(xyz, layer == 0, half, trust)
        if self._tool is not None:
            middle, left = self._tool_line(slice(0, leaving), self._tool)
            self._base.forget(middle, left, self._tool.half_width_m + TOOL_MARGIN_M)
            self._base.add(xyz, layer == 1, half, trust)

    def _pose_design(self, t_s: float) -> tuple[FloatArray, FloatArray]:
        """Derivatives of the pose at a time, (n, 6) by the knots and (6, 6) by the twist, in the local frame's axes."""
        k, share, _ = self.knots.at(np.array([t_s]))
        of_knots = np.zeros((len(self._state.xyz_m) * SIZE, 6))
        for knot, weight in ((int(k[0]), 1.0 - share[0]), (int(k[0]) + 1, share[0])):
            of_knots[knot * SIZE : knot * SIZE + 6] = weight * np.eye(6)
        of_twist = np.eye(6)
        of_twist[3:, :3] = -cross_matrix(self._state.xyz_m[int(k[0])] - self._centre_m).T
        return of_knots, of_twist

    def _pose(self, t_s: float, covariance: FloatArray) -> LivePose:
        state = self._state
        k, share, _ = self.knots.at(np.array([t_s]))
        before, late = int(k[0]), float(share[0])
        start = Rotation.from_matrix(state.rotation[before])
        turn = (start.inv() * Rotation.from_matrix(state.rotation[before + 1])).as_rotvec()
        local = state.xyz_m[before] + late * (state.xyz_m[before + 1] - state.xyz_m[before])
        rotation = Rotation.from_matrix(self._alignment.rotation) * start * Rotation.from_rotvec(late * turn)
        axes = np.eye(6)
        axes[3:, 3:5] = state.rotation[before, :, :2]
        sigma = np.sqrt(np.maximum(np.diag(axes.T @ covariance @ axes), 0.0))
        sigma[3:] = np.degrees(sigma[3:])
        return LivePose(t_s, self._alignment.to_map(local) + self._origin_m, rotation.as_quat(scalar_first=True), sigma)


@dataclass(frozen=True)
class _Returns:
    """Returns of the ground in the order of time, as :class:`~furrowmap.core.matching.returns.GroundReturns`.

    Attributes:
        trust: (n,) uint8 weights in the surface, 255 for a whole return; changed by matching.
    """

    t_s: FloatArray
    xyz_m: NDArray[np.float32]
    half: NDArray[np.uint8]
    trust: NDArray[np.uint8]

    @classmethod
    def none(cls) -> _Returns:
        return cls(np.zeros(0), np.zeros((0, 3), np.float32), np.zeros(0, np.uint8), np.zeros(0, np.uint8))

    def plus(self, new: _Returns) -> _Returns:
        t_s = np.concatenate([self.t_s, new.t_s])
        order = np.argsort(t_s, kind="stable")
        return _Returns(
            t_s[order],
            np.concatenate([self.xyz_m, new.xyz_m])[order],
            np.concatenate([self.half, new.half])[order],
            np.concatenate([self.trust, new.trust])[order],
        )

    def since(self, t_s: float) -> _Returns:
        k = int(np.searchsorted(self.t_s, t_s))
        return _Returns(self.t_s[k:], self.xyz_m[k:], self.half[k:], self.trust[k:])


class _Ground:
    """Picks the returns of the ground out of scans, and learns the vehicle's own footprint on the way."""

    def __init__(self, mounting: Mounting) -> None:
        self._rotation = np.ascontiguousarray(mounting.rotation)
        self._lever_m = np.asarray(mounting.xyz_m, np.float64)
        self._height_m: float | None = None
        self._first: list[tuple[Scan, FloatArray]] = []
        self._seen = np.zeros((PIXELS, PIXELS), np.int32)
        self._body = np.zeros((PIXELS, PIXELS), np.bool_)
        self._scans = self._moving = 0
        self._stride = 1

    def returns(self, scan: Scan, t_s: FloatArray, *, moves: bool) -> list[_Returns]:
        """The scan's returns of the ground; nothing until the ground's height is learned, then those kept till then."""
        if self._height_m is not None:
            return [self._pick(scan, t_s, self._height_m, moves)]
        self._first.append((scan, t_s))
        if len(self._first) < LEARN_SCANS:
            return []
        height_m = self._height_m = ground_height_m([s for s, _ in self._first], self._rotation, self._lever_m)
        kept, self._first = self._first, []
        return [self._pick(s, t, height_m, moves) for s, t in kept]

    def _pick(self, scan: Scan, t_s: FloatArray, height_m: float, moves: bool) -> _Returns:
        (index, xyz), candidates = select(
            np.ascontiguousarray(scan.xyz_m, np.float32),
            np.ascontiguousarray(scan.column, np.uint16),
            self._rotation,
            self._lever_m,
            height_m,
            self._stride,
            self._seen if moves else np.zeros_like(self._seen),
        )
        if self._scans % BODY_EVERY == 0:
            self._body = grown(self._seen >= max(1.0, BODY_SHARE * self._moving))
        self._scans += 1
        self._moving += moves
        self._stride = max(1, round(candidates / (RATE_HZ * max(float(t_s[-1] - t_s[0]), 1e-3))))
        kept = ~on_body(xyz, self._body)
        t, n = t_s[index[kept]], int(kept.sum())
        return _Returns(t, xyz[kept], np.full(n, self._scans % 2, np.uint8), np.full(n, 255, np.uint8))


def _knots(begin_s: float, count: int) -> Knots:
    return Knots((Chain(0, count, begin_s),), begin_s + STEP_S * np.arange(count, dtype=np.float64))


def _joined(one: GnssTrack, two: GnssTrack) -> GnssTrack:
    columns = {name: np.concatenate([getattr(one, name), getattr(two, name)]) for name in GnssTrack.columns()}
    return GnssTrack(**columns, source=one.source, service=one.service)
