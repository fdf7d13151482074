"""A vehicle on wheels that stands: its velocity is zero. Nothing that flies is at rest, however still it hovers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.estimation.banded import NormalEquations
from furrowmap.core.estimation.inertial import VELOCITY
from furrowmap.core.estimation.knots import STEP_S, Knots
from furrowmap.core.estimation.observation import Observation
from furrowmap.core.estimation.states import State
from furrowmap.core.values.inertial import InertialTrack
from furrowmap.core.values.positions import Positions

FloatArray = NDArray[np.float64]

WINDOW_S: Final = 1.0
"""In which scatter is looked at."""
QUIET: Final = (0.8, 0.25)
"""Scatter of angular rate and of specific force in a window, as shares of the usual ones of the recording: what drives
is shaken by its wheels."""
LEAST: Final = 3
"""A stand is at least so many windows."""
STILL_M: Final = 3.0
"""Positions of a stand are within so many standard deviations of their noise of their mean."""
SIGMA_MPS: Final = 0.02
LASTING_S: Final = 0.5
"""Zero velocity is a new observation after this time."""


@dataclass(frozen=True)
class Standing(Observation):
    """Zero velocity at the knots of stands.

    Attributes:
        begin_s: (m,) of the stands.
        end_s: (m,) of the stands.
    """

    begin_s: FloatArray
    end_s: FloatArray

    @classmethod
    def of(cls, track: InertialTrack, positions: Positions) -> Standing:
        """Where the IMU is quiet, compared with the rest of the recording, and the positions do not move."""
        cell = ((track.t_s - track.t_s[0]) / WINDOW_S).astype(np.int64)
        number, first, count = np.unique(cell, return_index=True, return_counts=True)
        scatter = []
        for values in (track.rate_radps, track.force_mps2):
            mean = np.add.reduceat(values, first) / count[:, None]
            square = np.add.reduceat(values**2, first) / count[:, None]
            scatter.append(np.sqrt(np.maximum((square - mean**2).sum(axis=1), 0.0)))
        quiet = np.all([one < share * np.median(one) for one, share in zip(scatter, QUIET, strict=True)], axis=0)
        quiet &= count > 3
        starts, ends = [], []
        k = 0
        while k < len(number):
            stop = k
            while stop < len(number) and quiet[stop] and number[stop] - number[k] == stop - k:
                stop += 1
            if stop - k >= LEAST:
                begin_s = track.t_s[0] + WINDOW_S * number[k]
                end_s = begin_s + WINDOW_S * (stop - k)
                here = (positions.t_s >= begin_s) & (positions.t_s < end_s)
                off = positions.xyz_m[here, :2] - positions.xyz_m[here, :2].mean(axis=0) if here.any() else None
                if off is not None and (np.abs(off) < STILL_M * positions.white_m[here, :2]).all():
                    starts.append(begin_s)
                    ends.append(end_s)
            k = max(stop, k + 1)
        return cls(np.array(starts), np.array(ends))

    def add(self, equations: NormalEquations, knots: Knots, state: State) -> None:
        """Three equations for each knot of a stand."""
        if not len(self.begin_s):
            return
        stand = np.searchsorted(self.begin_s, knots.t_s, side="right") - 1
        k = np.flatnonzero((stand >= 0) & (knots.t_s < self.end_s[np.maximum(stand, 0)]))
        first = state.layout.column(VELOCITY)
        sigma = np.full(len(k), SIGMA_MPS * np.sqrt(LASTING_S / STEP_S))
        for axis in range(3):
            equations.add(k * state.layout.size + first + axis, np.ones((len(k), 1)), -state[VELOCITY][k, axis], sigma)
