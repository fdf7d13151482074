"""A small scene of its own: boxes on a plane, seen by a scanner with sixteen lasers, with exact truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import TypeAlias

import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.implement.heights import ToolHeightTracker
from furrowmap.core.implement.learning import learn_implement
from furrowmap.core.implement.near_scans import NearScans
from furrowmap.core.implement.seen_implement import Hint, Learned
from furrowmap.core.implement.states import ToolHistory, tool_history
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.tool_states import ToolState

FloatArray: TypeAlias = NDArray[np.float64]
Box: TypeAlias = tuple[float, float, float, float, float, float]
OfTime: TypeAlias = Callable[[FloatArray], FloatArray]

T0_S = 1_781_141_020.0
COLUMNS = 720
ELEVATION = np.radians(np.arange(-15.0, 16.0, 2.0))
TILLER: tuple[Box, ...] = (
    (-2.0, -1.4, -0.85, 0.85, 0.05, 0.72),
    (-2.4, -2.1, -0.85, 0.85, 0.08, 0.58),
    (-1.7, -1.3, -0.15, 0.15, 0.72, 1.05),
)
LINE_X_M = -1.9
REACH: Box = (-3.2, -0.7, -1.9, 1.9, -0.3, 1.9)
"""No part of the tool is ever outside."""
HINGE = np.array([-1.0, 0.0, 0.5])
MOUNTING = Mounting((-0.63, 0.04, 2.42), (0.8, 40.0, 179.3))
HINT = Hint((LINE_X_M, 0.0), 1.7)
BODY: tuple[Box, ...] = (
    (-0.95, -0.88, 0.65, 0.79, 2.0, 2.1),
    (-0.62, 0.62, 0.55, 0.88, 0.0, 1.24),
    (-0.62, 0.62, -0.88, -0.55, 0.0, 1.24),
)


def smooth(t_s: FloatArray, from_s: float, move_s: float) -> FloatArray:
    """From 0 to 1 in the course of `move_s`, starting and ending gently."""
    x = np.clip((t_s - from_s) / move_s, 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)


@dataclass(frozen=True)
class Scene:
    """A machine at work, and what its scanner does.

    Attributes:
        lowered_s, lifted_s: when the tool begins to go down, and to come up again.
        lift_m: how far; lifting takes `move_s`.
        tool: boxes in the vehicle frame, the tool in working position.
        mirrored: times between which the tool is the other way round, left and right.
        swing_deg: how far the tool turns aside about the rear axle while it is up.
        tilt_deg: how far its rear rises when it is lifted, turning about `HINGE`.
        jitter_m: of the tool at work.
        still: what stands still before the scanner, beside the tractor's body.
        begin_deg: azimuth at which scans begin.
    """

    duration_s: float = 17.0
    lowered_s: tuple[float, ...] = (2.0, 10.0)
    lifted_s: tuple[float, ...] = (6.5, 14.5)
    lift_m: float = 0.45
    move_s: float = 1.2
    tool: tuple[Box, ...] = TILLER
    mirrored: tuple[float, float] = (np.inf, np.inf)
    swing_deg: float = 0.0
    tilt_deg: float = 0.0
    jitter_m: float = 0.01
    still: tuple[Box, ...] = ()
    dropout: float = 0.01
    dust: float = 0.02
    mounting: Mounting = MOUNTING
    clockwise: bool = True
    turn_s: float = 0.1
    lasers: int = 16
    begin_deg: float = 0.0

    def lifted(self, t_s: FloatArray) -> FloatArray:
        """0 at work to 1 lifted, `t_s` after the beginning."""
        share = np.ones(len(t_s))
        for down_s, up_s in zip(self.lowered_s, self.lifted_s, strict=True):
            share -= smooth(t_s, down_s, self.move_s) - smooth(t_s, up_s, self.move_s)
        return share

    def raised_m(self, t_s: FloatArray) -> FloatArray:
        """By how much the hinge, and with it the whole tool, is above its working position."""
        lifted = self.lifted(t_s)
        wave = np.sin(2 * np.pi * 1.3 * t_s) + np.sin(2 * np.pi * 2.1 * t_s + 1.0)
        return self.lift_m * lifted + self.jitter_m * (1.0 - lifted) * wave

    def height_m(self, t_s: FloatArray) -> FloatArray:
        """Of the tool at its line above its working position: raised, and tilted about the hinge."""
        tilt = np.radians(self.tilt_deg) * self.lifted(t_s)
        return self.raised_m(t_s) + (HINGE[0] - LINE_X_M) * np.sin(tilt)

    def passages(self, threshold_m: float) -> list[tuple[float, bool]]:
        """(UTC, whether it goes down) of each passage of a height, by a fine sampling of the closed form."""
        t_s = np.arange(0.0, self.duration_s, 0.001)
        down = self.height_m(t_s) < threshold_m
        at = np.flatnonzero(down[1:] != down[:-1]) + 1
        return [(T0_S + float(t_s[k]), bool(down[k])) for k in at]

    def scans(self) -> list[Scan]:
        """What the scanner records."""
        rng = np.random.default_rng(5)
        step = np.arange(COLUMNS)
        azimuth = 2 * np.pi * (step + 0.5) / COLUMNS * (1 if self.clockwise else -1) + np.radians(self.begin_deg)
        column, laser = (a.ravel() for a in np.meshgrid(step, np.arange(self.lasers), indexing="ij"))
        elevation = np.linspace(ELEVATION[0], ELEVATION[-1], self.lasers)[laser]
        cosine, sine = np.cos(elevation), np.sin(elevation)
        ray = np.column_stack([cosine * np.cos(azimuth[column]), -cosine * np.sin(azimuth[column]), sine])
        way, eye = ray @ self.mounting.rotation.T, np.array(self.mounting.xyz_m)
        with np.errstate(divide="ignore"):
            ground = np.where(way[:, 2] < 0, -eye[2] / way[:, 2], np.inf)
        still = np.minimum(ground, _nearest(np.broadcast_to(eye, way.shape), way, BODY + self.still))
        passing = np.flatnonzero(np.isfinite(_nearest(np.broadcast_to(eye, way.shape), way, (REACH,))))
        found = []
        for number in range(round(self.duration_s / self.turn_s)):
            t_s = self.turn_s * (number + column / COLUMNS)
            distance = still.copy()
            distance[passing] = np.minimum(distance[passing], self._tool_m(eye, way[passing], t_s[passing]))
            stopped = (self.lifted(t_s) < 0.2) & (rng.random(len(way)) < self.dust) & (distance < 4.0)
            distance = np.where(stopped, rng.uniform(1.0, np.clip(distance, 1.0, 4.0)), distance)
            distance += rng.normal(0.0, 0.01, len(way))
            kept = np.flatnonzero((distance > 0.5) & (distance < 40.0) & (rng.random(len(way)) > self.dropout))
            ones = np.ones(len(kept), np.uint8)
            found.append(
                Scan(
                    number=number,
                    t_s=T0_S + t_s[kept],
                    xyz_m=(ray[kept] * distance[kept, None]).astype(np.float32),
                    intensity=40 * ones,
                    laser=laser[kept].astype(np.uint8),
                    column=column[kept].astype(np.uint16),
                    return_number=ones,
                    returns=ones,
                    lasers=self.lasers,
                )
            )
        return found

    def _tool_m(self, eye: FloatArray, way: FloatArray, t_s: FloatArray) -> FloatArray:
        """Distances to the tool: the rays brought into its own frame."""
        lifted = self.lifted(t_s)
        origin = np.broadcast_to(eye, way.shape).copy()
        origin[:, 2] -= self.raised_m(t_s)
        direction = way
        if self.swing_deg:
            swing = np.radians(self.swing_deg) * lifted
            origin, direction = (_turned(v, (0, 1), -swing) for v in (origin, direction))
        if self.tilt_deg:
            tilt = np.radians(self.tilt_deg) * lifted
            origin, direction = _turned(origin - HINGE, (0, 2), tilt) + HINGE, _turned(direction, (0, 2), tilt)
        distance = _nearest(origin, direction, self.tool)
        other = (t_s > self.mirrored[0]) & (t_s < self.mirrored[1])
        if other.any():
            flip = np.array([1.0, -1.0, 1.0])
            distance[other] = _nearest(origin[other] * flip, direction[other] * flip, self.tool)
        return distance


def _turned(v: FloatArray, axes: tuple[int, int], angle: FloatArray) -> FloatArray:
    a, b = axes
    out = v.copy()
    out[:, a] = np.cos(angle) * v[:, a] - np.sin(angle) * v[:, b]
    out[:, b] = np.sin(angle) * v[:, a] + np.cos(angle) * v[:, b]
    return out


def _nearest(origin: FloatArray, way: FloatArray, boxes: Sequence[Box]) -> FloatArray:
    """Distance along each ray to the first of some boxes; inf where it meets none (the slab method)."""
    best = np.full(len(way), np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        # A row for each axis: NumPy takes long over the least of three numbers that lie side by side.
        begin, per_metre = np.ascontiguousarray(origin.T), 1.0 / np.ascontiguousarray(way.T)
        for box in boxes:
            a, b = ((np.array(side)[:, None] - begin) * per_metre for side in (box[::2], box[1::2]))
            enter, leave = np.minimum(a, b).max(axis=0), np.maximum(a, b).min(axis=0)
            best = np.where((enter < leave) & (enter > 0), np.minimum(best, enter), best)
    return best


@dataclass(frozen=True)
class Seen:
    """A scene with what was found in its scans.

    Attributes:
        truth: the scene.
        learned: of the implement.
        history: of the tool; None where no implement was found.
    """

    truth: Scene
    learned: Learned
    history: ToolHistory | None

    def passages(self) -> list[tuple[float, bool, float]]:
        """(UTC, whether it goes down, sigma) of each transition found."""
        assert self.history is not None
        states = self.history.states
        return [
            (float(states.begin_s[k]), states.state[k] == ToolState.DOWN, float(states.begin_sigma_s[k]))
            for k in range(1, len(states))
            if states.begin_s[k] == states.end_s[k - 1]
        ]


@cache
def usual_scans() -> list[Scan]:
    """Of the scene with nothing changed, which several tests look at."""
    return Scene().scans()


Watch: TypeAlias = Callable[..., Seen]


@pytest.fixture(scope="session")
def watch() -> Watch:
    """The scene with some attributes changed, and what is found in it; `kept` chooses among its scans."""

    def run(
        hint: Hint | None = HINT,
        depth_m: float | None = 0.12,
        kept: Callable[[Scan], bool] = lambda _: True,
        **changes: object,
    ) -> Seen:
        truth = replace(Scene(), **changes)  # type: ignore[arg-type]
        scans = [scan for scan in (usual_scans() if truth == Scene() else truth.scans()) if kept(scan)]
        near = NearScans(truth.mounting)
        for scan in scans:
            near.add(scan)
        learned = learn_implement(near.scans, hint)
        if learned.implement is None:
            return Seen(truth, learned, None)
        heights = ToolHeightTracker(truth.mounting, learned.implement, depth_m)
        for scan in scans:
            heights.add(scan)
        return Seen(truth, learned, tool_history(heights.heights(), learned.implement, depth_m))

    return run
