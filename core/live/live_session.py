"""A session while it is recorded: scans and bytes of a receiver in; poses, tool states and ground worked out."""

import math
import os
import signal
import time
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import reduce
from multiprocessing import get_context
from operator import xor
from typing import Final

import numpy as np

from furrowmap.core.coverage.pass_edges import edge_gaps_m
from furrowmap.core.coverage.worked_cells import Swept, Tile, WorkedCells
from furrowmap.core.geodesy.projection import MapFrame, map_frame
from furrowmap.core.implement.heights import ToolHeightTracker
from furrowmap.core.implement.learning import learn_implement
from furrowmap.core.implement.near_scans import NearScan, NearScans
from furrowmap.core.implement.seen_implement import Hint, Learned, SeenImplement
from furrowmap.core.implement.states import tool_history
from furrowmap.core.live.drive import MAX_BRIDGED_S, TRUE_LEVEL_SIGMA, LivePose, TrueLevel
from furrowmap.core.live.poses import LivePoses
from furrowmap.core.matching.returns import LEARN_SCANS
from furrowmap.core.readers.arrived_positions import Kind, log_kind
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.worker_process import end_with_parent
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.rotation import wrap_deg
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.session import Crs, Implement, Recording, Session
from furrowmap.core.values.tool_states import ToolState, ToolStates

GNSS_KEPT_BYTES: Final = 4096
"""Of a receiver's stream before what is new: sentences of one epoch come in several pieces."""
STATES_TURNS: Final = 300
"""Revolutions whose tool heights are looked at together; the working position changes with the soil."""
SETTLED_S: Final = 0.35
"""Poses and states of this long ago hardly change any more: ground is worked by these."""
LINE_STEP_S: Final = 0.2
"""Longest time between two places of the tool's line."""
LEARN_EVERY_S: Final = 30.0
SENT_SCANS: Final = 8
"""Sent at a time to the process that learns: while all of them are pickled, new scans would wait for 0.1 s."""
GIVES_WAY: Final = 5
"""Niceness of what is worked out beside: with a greedier one it would take minutes where others want the processor."""
MISSED_S: Final = 1.0
"""Positions that are missed for longer are said to be missing."""
STRAIGHT_DEG: Final = 20.0
"""A gap between positions is worked if the tool stayed down in it and the heading changed by less."""
UNSEEN_APART_S: Final = 5.0
"""Times in which the ground was not seen that are less apart are one."""
NO_TIMES: Final = np.zeros(0)
NO_STATES: Final = ToolStates(NO_TIMES, NO_TIMES, np.zeros(0, np.int8), NO_TIMES, NO_TIMES, NO_TIMES)
SAMPLES: Final = np.array([0.25, 0.5, 0.75])
"""Where between two places of the tool's line its state is looked at."""


@dataclass(frozen=True)
class LiveScan:
    """What is known when a scan has come.

    Attributes:
        t_s: UTC of the middle of the scan.
        pose: None while positions do not show the heading.
        tool: state of the tool.
        tool_height_m: above its working position; nan where unknown.
        changed: tiles of the ground worked that changed.
        missing: codes of what is not observed: "positions", "heading", "direction", "tilt", "implement", "tool".
    """

    t_s: float
    pose: LivePose | None
    tool: ToolState
    tool_height_m: float
    changed: frozenset[Tile]
    missing: tuple[str, ...]


class LiveSession:
    """Takes scans, and what the receiver sends in any pieces, and gives a :class:`LiveScan` for each scan.

    Memory does not grow with time, but with the ground worked (1 byte a cell of 0.1 m).

    Args:
        session: as the machine's profile states it.
        frame: the map frame.
        learned: the implement as an earlier session learned it.
        level: see :class:`LivePoses`.

    Attributes:
        cells: ground worked; None where the session states no implement.
        learned_s: UTC since which the tool is observed; nan before.
    """

    def __init__(
        self, session: Session, frame: MapFrame, learned: SeenImplement | None = None, level: TrueLevel | None = None
    ) -> None:
        self._session = session
        self._frame = frame
        self._poses = LivePoses(session, frame, level)
        self._tail = b""
        self._kind: Kind | None = None
        self._gnss_s = self._scan_s = math.nan
        implement = session.implement
        self.cells = WorkedCells(implement.width_m) if implement is not None else None
        self.learned_s = math.nan
        self._near: NearScans | None = NearScans(session.lidar.mounting) if implement is not None else None
        self._learning: Future[Learned] | None = None
        self._learn_after_s = math.nan
        self._learned_last = False
        self._pool: ProcessPoolExecutor | None = None
        self._seen: SeenImplement | None = None
        self._heights: ToolHeightTracker | None = None
        self._line: tuple[float, FloatArray, float] | None = None
        self._guess: tuple[float, FloatArray, float] | None = None
        self._way_m = 0.0
        self._was_down = False
        self._states = NO_STATES
        self._since_s = math.inf
        if learned is not None:
            self._use(learned, -math.inf)

    def close(self) -> None:
        """End the process that learns the implement."""
        if self._pool is not None:
            self._pool.shutdown(wait=False, cancel_futures=True)

    def add_gnss(self, data: bytes) -> None:
        """Add bytes of the receiver: NMEA, UBX or SBF. What cannot be read yet is kept until more comes."""
        self._tail = (self._tail + data)[-64 * GNSS_KEPT_BYTES :]
        self._kind = self._kind or log_kind(self._tail)
        if self._kind is None:
            return
        near_s = self._gnss_s if math.isfinite(self._gnss_s) else self._scan_s
        try:
            track = self._kind.of_bytes(self._tail, near_s if math.isfinite(near_s) else time.time()).track
        except InputError:  # only the end of a message as yet
            return
        self._tail = self._tail[-GNSS_KEPT_BYTES:]
        # The first epoch may lack sentences that were cut off.
        self.add_track(track[1:] if not math.isnan(self._gnss_s) else track)

    def add_track(self, track: GnssTrack) -> None:
        """Add positions; those of a time that is already known replace the earlier ones."""
        if len(track):
            self._gnss_s = float(track.t_s[-1])
            self._poses.add_track(track)

    def add_scan(self, scan: Scan) -> LiveScan | None:
        """What is known with a scan; None of one without returns."""
        offset_s = self._session.recording.lidar_minus_gnss_s
        if offset_s:
            scan = replace(scan, t_s=scan.t_s - offset_s)
        if not len(scan):
            return None
        pose = self._poses.add_scan(scan)
        end_s = float(scan.t_s[-1])
        self._scan_s = end_s
        state, height_m, states = self._tool(scan)
        self._states = states
        changed: set[Tile] = set()
        if self.cells is not None:
            changed = self._work(end_s - SETTLED_S, states)
            changed |= self.cells.look_for_misses()
        return LiveScan(
            0.5 * float(scan.t_s[0] + end_s), pose, state, height_m, frozenset(changed), self._missing(pose, state)
        )

    @property
    def since_s(self) -> float:
        """UTC since which the place of the tool is known; infinite before."""
        return self._since_s

    @property
    def antenna_m(self) -> tuple[float, float] | None:
        """Easting and northing of the antenna at the last position: all that is known before the heading."""
        return self._poses.antenna_m

    @property
    def knows_level(self) -> bool:
        """Whether turns have shown how the ground slopes; before, places are off by some centimetres on slopes."""
        level = self._poses.level
        return level is not None and level.sigma < TRUE_LEVEL_SIGMA

    @property
    def seen_implement(self) -> SeenImplement | None:
        """The implement, once it was learned."""
        return self._seen

    def finish(self) -> frozenset[Tile]:
        """Work the ground up to the last scan, where no more come; gives the tiles that changed."""
        if self.cells is None or math.isnan(self._scan_s):
            return frozenset()
        return frozenset(self._work(self._scan_s, self._states) | self.cells.finish())

    def unseen_s(self) -> list[tuple[float, float]]:
        """The times, UTC, in which the vehicle moved and it was not seen what the tool did, in their order."""
        if self.cells is None:
            return []
        swept = self.cells.swept
        t_s = swept.t_s[~swept.seen]
        if not len(t_s):
            return []
        cuts = np.flatnonzero(np.diff(t_s) > UNSEEN_APART_S)
        begins = t_s[np.append(0, cuts + 1)] - LINE_STEP_S
        return list(zip(begins.tolist(), t_s[np.append(cuts, len(t_s) - 1)].tolist(), strict=True))

    def work_again(self, begin_s: float, end_s: float, found: Swept) -> frozenset[Tile]:
        """Take what was worked out of a time from the recording instead of what was seen; the tiles that changed."""
        return frozenset(self.cells.replace(begin_s, end_s, found)) if self.cells is not None else frozenset()

    def edge_gaps_m(self, pose: LivePose) -> tuple[float, float]:
        """Ground between the ends of the tool's line, left and right, and the passes there: see `edge_gaps_m`."""
        if self.cells is None:
            return math.nan, math.nan
        swept = self.cells.swept
        way_m = float(swept.way_m[-1]) if len(swept) else 0.0
        if len(swept) and not (self._was_down and swept.seen[-1]):
            way_m = math.inf  # all passes are others while the tool is up
        return edge_gaps_m(swept, self._line_at(pose), way_m)

    def _missing(self, pose: LivePose | None, state: ToolState) -> tuple[str, ...]:
        """What is not observed."""
        is_late = pose is not None and pose.is_guess and pose.position_age_s > MISSED_S
        missing = {
            "positions": is_late or not self._poses.has_positions,
            "heading": pose is None,
            "direction": pose is not None and not self._poses.direction_is_certain,
            "tilt": pose is not None and not pose.leans,
            "implement": self.cells is None,
            "tool-learning": self.cells is not None and self._seen is None,
            "tool": self._seen is not None and state is ToolState.UNKNOWN,
        }
        return tuple(code for code, is_missing in missing.items() if is_missing)

    def _use(self, seen: SeenImplement, since_s: float) -> None:
        """Measure the tool's height from now on."""
        implement = self._session.implement
        if implement is not None:
            self._seen = seen
            self.learned_s = since_s
            self._near = None
            self._heights = ToolHeightTracker(self._session.lidar.mounting, seen, implement.working_depth_m)

    def _tool(self, scan: Scan) -> tuple[ToolState, float, ToolStates]:
        """State and height of the tool now, and its states of the last half minute."""
        implement = self._session.implement
        if implement is None:
            return ToolState.UNKNOWN, math.nan, NO_STATES
        if self._heights is None or self._seen is None:
            self._learn(scan)
            return ToolState.UNKNOWN, math.nan, NO_STATES
        self._heights.add(scan)
        heights = self._heights.latest(STATES_TURNS)
        if len(heights.t_s) < 3:
            return ToolState.UNKNOWN, math.nan, NO_STATES
        history = tool_history(heights, self._seen, implement.working_depth_m)
        last = ToolState(int(history.states.state[-1])) if len(history.states) else ToolState.UNKNOWN
        if last is not ToolState.UNKNOWN and history.states.end_s[-1] < scan.t_s[-1] - 2.0 * self._seen.region.turn_s:
            last = ToolState.UNKNOWN
        return last, float(heights.height_m[-1]), history.states

    def _learn(self, scan: Scan) -> None:
        """Collect scans, and look for the implement in them now and then, in a process of its own."""
        now_s = float(scan.t_s[-1])
        if self._take_learned(now_s):
            return
        assert self._near is not None
        self._near.add(scan)
        if math.isnan(self._learn_after_s):
            self._learn_after_s = now_s + LEARN_EVERY_S
        if self._learning is None and now_s > self._learn_after_s:
            self._learn_after_s = now_s + LEARN_EVERY_S
            self._begin_to_learn()

    def _take_learned(self, now_s: float) -> bool:
        """Whether the implement was found meanwhile; it is measured from then on."""
        if self._learning is None or not self._learning.done():
            return False
        found = self._learning.result().implement
        self._learning = None
        if found is not None:
            self._use(found, now_s)
        return found is not None

    def _begin_to_learn(self) -> None:
        """Look for the implement in all scans so far."""
        implement = self._session.implement
        assert implement is not None
        assert self._near is not None
        self._pool = self._pool or ProcessPoolExecutor(1, get_context("spawn"), prepare_worker)
        hint = Hint(implement.xy_m, implement.width_m, implement.region_m, implement.lift_m)
        for first in range(0, len(self._near.scans), SENT_SCANS):
            self._pool.submit(_keep, self._near.scans[first : first + SENT_SCANS])
        self._learning = self._pool.submit(_learn_kept, hint)

    def learns_on(self) -> bool:
        """Whether the implement is still looked for, where no more scans come: once more in all of them."""
        if self._seen is not None or self._near is None or not self._near.scans:
            return False
        if self._learning is None and not self._learned_last:
            self._learned_last = True
            self._begin_to_learn()
        self._take_learned(self._scan_s)
        return self._learning is not None

    def _work(self, to_s: float, states: ToolStates) -> set[Tile]:
        """Work the ground up to a time; gives the tiles that changed."""
        changed: set[Tile] = set()
        begin_s = self._poses.begin_s
        if not begin_s < to_s:
            return changed
        if self._line is not None and self._line[0] < begin_s:
            self._line = None
        elif self._line is not None:
            begin_s = self._line[0]
        borders = states.begin_s[(states.begin_s > begin_s) & (states.begin_s < to_s)]
        for t_s in np.unique([*borders, *np.arange(begin_s, to_s, LINE_STEP_S), to_s]).tolist():
            pose = self._poses.at(t_s)
            if pose is None:
                continue
            if pose.is_guess:
                changed |= self._guess_on(pose, states)
                continue
            changed |= self._forget_guess(begin_s, t_s)
            changed |= self._move_on(pose, states)
        return changed

    def _move_on(self, pose: LivePose, states: ToolStates) -> set[Tile]:
        """Work the ground from the last place of the tool's line to that of a pose."""
        assert self.cells is not None
        changed: set[Tile] = set()
        t_s = pose.t_s
        line = self._line_at(pose)
        heading = pose.attitude_deg[2]
        if self._line is not None and t_s > self._line[0]:
            before_s, before, before_deg = self._line
            forward = _forward_m(before, line, pose)
            state = states.at(before_s + SAMPLES * (t_s - before_s))[0]
            down = bool((state == ToolState.DOWN).all())
            turned_deg = abs(float(wrap_deg(heading - before_deg)))
            joined = t_s - before_s < 2.0 * SETTLED_S or (turned_deg < STRAIGHT_DEG and t_s - before_s < MAX_BRIDGED_S)
            self._way_m += max(forward, 0.0)
            if down and forward > 0.0 and joined:
                changed |= self.cells.add_line(before, line, self._way_m, t_s)
            elif forward > 0.0 and joined and (state == ToolState.UNKNOWN).any():
                changed |= self.cells.add_line(before, line, self._way_m, t_s, unseen=True)
            if self._was_down and not down:
                self.cells.end_pass()
            self._was_down = down
        self._line = t_s, line, heading
        self._since_s = min(self._since_s, t_s)
        return changed

    def _guess_on(self, pose: LivePose, states: ToolStates) -> set[Tile]:
        """Mark ground as not seen where the vehicle has no positions, as far as the tool may be down there."""
        assert self.cells is not None
        changed: set[Tile] = set()
        before = self._guess or self._line
        if before is not None and pose.t_s > before[0]:
            line = self._line_at(pose)
            forward = _forward_m(before[1], line, pose)
            state = states.at(before[0] + SAMPLES * (pose.t_s - before[0]))[0]
            if forward > 0.0 and not (state == ToolState.UP).all():
                changed = self.cells.add_line(before[1], line, self._way_m, pose.t_s, unseen=True)
            self._guess = pose.t_s, line, pose.attitude_deg[2]
        return changed

    def _forget_guess(self, begin_s: float, t_s: float) -> set[Tile]:
        """Positions are there again: where they show the way through the gap, it is driven again."""
        assert self.cells is not None
        if self._guess is None:
            return set()
        end_s = self._guess[0]
        if self._poses.at(0.5 * (begin_s + end_s)) is None:  # the gap is too long: it stays not seen
            self._line = None
            self._guess = None
            return set()
        self._guess = None
        return self.cells.replace(begin_s, max(end_s, t_s), Swept.none())

    def _line_at(self, pose: LivePose) -> FloatArray:
        """(2, 2) ends of the tool's line, easting and northing."""
        implement = self._session.implement
        assert implement is not None
        x_m, y_m = implement.xy_m
        ends = np.array([[x_m, y_m - 0.5 * implement.width_m, 0.0], [x_m, y_m + 0.5 * implement.width_m, 0.0]])
        line: FloatArray = (np.asarray(pose.xyz_m) + ends @ pose.rotation.T)[:, :2]
        return line


def _forward_m(before: FloatArray, line: FloatArray, pose: LivePose) -> float:
    """How far the middle of the tool's line (2, 2) went ahead."""
    return float((line.mean(axis=0) - before.mean(axis=0)) @ pose.rotation[:2, 0])


def warm_up() -> None:
    """Load the compiled kernels, which takes a second: by a drive over a plane that nothing is kept of."""
    tool = Implement(width_m=2.0, xy_m=(-1.5, 0.0))
    crs = Crs(map="EPSG:32631")
    session = LiveSession(Session(furrowmap=1, recording=Recording(), crs=crs, implement=tool), map_frame(crs))
    column = (np.arange(4000) % 2000).astype(np.uint16)
    t_s = 5e-5 * column.astype(np.float64)
    plane = np.column_stack([5.0 * np.cos(column), 5.0 * np.sin(column), np.full(len(column), -2.0)]).astype(np.float32)
    lasers = np.zeros(len(column), np.uint8)
    ones = np.ones(len(column), np.uint8)
    for number in range(LEARN_SCANS + 2):
        session.add_scan(Scan(number, t_s + 0.1 * number, plane, ones, lasers, column, ones, ones))
        gga = f"GNGGA,0000{0.1 * number:05.2f},4500.{5 * number:05d},N,00300.0,E,4,12,0.9,99.0,M,40.0,M,,"
        for body in (gga, "GNTHS,0.0,A"):
            session.add_gnss(f"${body}*{reduce(xor, body.encode()):02X}\r\n".encode())
    WorkedCells(2.0).add_line(np.zeros((2, 2)), np.ones((2, 2)), 0.0)


_kept: Final[list[NearScan]] = []  # by the process that learns


def _keep(scans: list[NearScan]) -> None:
    _kept.extend(scans)


def _learn_kept(hint: Hint) -> Learned:
    scans = _kept[:]
    _kept[:] = []
    return learn_implement(scans, hint)


def prepare_worker() -> None:
    """A process beside lets all others go first, leaves Ctrl-C to the one that started it, and ends with that one."""
    end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "nice"):
        os.nice(GIVES_WAY)
