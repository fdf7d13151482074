"""Standard deviations of the adjusted poses, and which observation determines each unknown."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from furrowmap.core.adjustment.problem import Linearised
from furrowmap.core.estimation.covariance import Considered, pose_sigmas, quick_variances, slow_covariance
from furrowmap.core.estimation.knots import KNOT_STEP_S, State
from furrowmap.core.estimation.vehicle import LEVEL_SIGMA
from furrowmap.core.matching.ground import CORRELATED
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray

AROUND_S: Final = 0.5
"""Time to either side over which the returns' information is summed."""
SCANNED_S: Final = 0.05
"""Half a scan, in which there may be no returns of the ground; beyond it a turning vehicle's heading is another one."""
PLACED_M: Final = 0.05
"""Without GNSS, returns that determine the place less well leave it to wheels and motion prior."""


def sigmas(state: State, last: Linearised, considered: Considered, *normals: FloatArray) -> FloatArray:
    """Standard deviations (n, 6) of easting, northing, height (m), roll, pitch, heading (degrees) at the knots.

    What is slow comes from the equations with free references, what is quick from those with fixed ones; their
    covariances are added. Errors that neighbouring returns share lift and tilt a scan but do not turn it, because
    relief slopes to all sides: the part of a heading's quick variance that returns determine is that of independent
    returns.

    Args:
        state: the solution.
        last: equations.
        considered: bow of the scanner's ranges.
        normals: (n, 21) normal matrices of the returns between knots, of each kind of returns.
    """
    with ThreadPoolExecutor(1) as pool:
        beside = pool.submit(quick_variances, last.held, state.layout.size)
        slow = slow_covariance(last.free, considered)
        quick = beside.result()
    seen = np.zeros(len(normals[0]), np.uint8)
    for one in normals:
        seen |= one[:, 0] > 0.0
    scanned = maximum_filter1d(seen, 2 * round(SCANNED_S / KNOT_STEP_S) + 1) > 0
    by_returns = np.minimum(information_of(*normals).heading * quick[:, 5], 1.0) * scanned
    quick[:, 5] *= 1.0 - by_returns * (1.0 - 1.0 / CORRELATED)
    return pose_sigmas(state, last.coarse, last.centre_m, slow, quick)


@dataclass(frozen=True)
class Information:
    """Information of the returns about the poses, within AROUND_S to either side.

    Attributes:
        heading: (n,) information (1 / rad²) about the heading, the other five unknowns eliminated.
        place: (n,) information (1 / m²) about the place where there is least of it, the other unknowns eliminated.
        level: (n,) whether roll and pitch are determined.
    """

    heading: FloatArray
    place: FloatArray
    level: NDArray[np.bool_]


def information_of(*normals: FloatArray) -> Information:
    """The information in the sum of normal matrices (n, 21) of the slices between knots; zero where there are none."""
    n, half = len(normals[0]), round(AROUND_S / KNOT_STEP_S)
    out = Information(np.zeros(n), np.zeros(n), np.zeros(n, np.bool_))
    row, column = np.triu_indices(6)
    for part in arrays.parts(n):
        around = slice(max(0, part.start - half), part.stop + half)
        normal = np.sum([one[around] for one in normals], axis=0)
        before, after = half - (part.start - around.start), half - (min(n, around.stop) - part.stop)
        total = np.cumsum(np.pad(normal, ((before + 1, after), (0, 0))), axis=0)
        near = total[2 * half + 1 :] - total[: -2 * half - 1]
        square = np.zeros((len(near), 6, 6))
        square[:, row, column] = square[:, column, row] = near
        known = square[:, 2, 2] > 0
        if not known.any():
            continue
        m = square[known]
        m += np.eye(6) * (1e-9 * m[:, 2, 2])[:, None, None]
        out.heading[part][known] = _reduced(m, [5])[:, 0, 0]
        out.place[part][known] = np.linalg.eigvalsh(_reduced(m, [0, 1]))[:, 0]
        out.level[part][known] = np.linalg.eigvalsh(_reduced(m, [3, 4]))[:, 0] > 1.0 / LEVEL_SIGMA**2
    return out


def _reduced(normal: FloatArray, kept: list[int]) -> FloatArray:
    """Normal matrices (n, 6, 6) of the unknowns kept, the others eliminated (Schur complement)."""
    others = [i for i in range(6) if i not in kept]
    link = normal[:, kept][:, :, others]
    rest = np.linalg.solve(normal[:, others][:, :, others], link.transpose(0, 2, 1))
    left: FloatArray = normal[:, kept][:, :, kept] - link @ rest
    return left


@dataclass(frozen=True)
class Sources:
    """The observations that determine each knot's unknowns most firmly.

    Attributes:
        heading: (n,) labels, as in :class:`~furrowmap.core.values.trajectory.Trajectory`.
        position: (n,) the same.
        height: (n,) the same.
        level: (n,) the same, of roll and pitch.
    """

    heading: NDArray[np.str_]
    position: NDArray[np.str_]
    height: NDArray[np.str_]
    level: NDArray[np.str_]


def sources_of(
    ground: FloatArray,
    walls: FloatArray,
    heading_sigma_deg: FloatArray,
    heading_label: NDArray[np.str_],
    has_position: NDArray[np.bool_],
) -> Sources:
    """For each unknown the observation with the most information about it.

    Args:
        ground: (n, 21) normal matrices of the ground's returns between knots.
        walls: (n, 21) of those of the walls.
        heading_sigma_deg: (n,) of the headings before matching.
        heading_label: (n,) what determined them.
        has_position: (n,) whether GNSS gave a position at the time.
    """
    relief, both = information_of(ground), information_of(ground, walls)
    by_walls = both.heading - relief.heading > relief.heading
    firmer = np.maximum(both.heading - relief.heading, relief.heading) > 1.0 / np.radians(heading_sigma_deg) ** 2
    placed, placed_by_walls = both.place > 1.0 / PLACED_M**2, both.place - relief.place > relief.place

    def firmest(p: slice) -> list[NDArray[np.str_]]:
        scans = np.where(by_walls[p], "walls", "relief")
        placing = np.where(placed[p], np.where(placed_by_walls[p], "walls", "relief"), "carried")
        height = np.where(has_position[p], "gnss", np.where(relief.level[p], "ground", "carried"))
        return [
            np.where(firmer[p], scans, heading_label[p]),
            np.where(has_position[p], "gnss", placing),
            height,
            np.where(relief.level[p], "ground", "assumed"),
        ]

    return Sources(*arrays.in_parts(firmest, len(firmer)))
