"""The implement in a run: detection, tracking and worked ground."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from shapely.geometry.base import BaseGeometry

from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.implement.heights import ToolHeightTracker
from furrowmap.core.implement.learning import learn_implement
from furrowmap.core.implement.machine import AIRBORNE, Machine, learn_machine
from furrowmap.core.implement.model import Hint, Learned
from furrowmap.core.implement.model import Implement as SeenImplement
from furrowmap.core.implement.near_scans import NearScans
from furrowmap.core.implement.states import ToolHistory, tool_history
from furrowmap.core.values.errors import Notice
from furrowmap.core.values.intervals import interval_numbers
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.session import REPLACE, Implement, Session
from furrowmap.core.values.tool_states import ToolState, ToolStates
from furrowmap.core.values.trajectory import Motion, Trajectory
from furrowmap.core.work.depth import Depth, pass_depths
from furrowmap.core.work.external_states import StateComparison, compare_states
from furrowmap.core.work.ground import WorkedGround, worked_ground
from furrowmap.core.work.sweep import PassTimes, pass_times
from furrowmap.core.work.track import Event, ToolPath, events, tool_paths

_NO_MACHINE = Notice(
    "machine-not-known",
    "Too few scans of the moving vehicle, or no ground where the mounting of the scanner ([lidar] xyz_m, rpy_deg) puts "
    "it: points of the vehicle could not be classified.",
)
_NO_WIDTH = Notice(
    "implement-not-stated",
    "The scanner sees an implement go up and down, but the session does not say how wide it is and where ([implement] "
    "width_m, xy_m): the ground worked is not computed.",
)
_FROM_EARLIER = Notice(
    "implement-from-earlier",
    "This recording does not show the implement moving up and down: what it looks like in both positions is taken from "
    "the earlier session that [implement] learned names.",
)


@dataclass(frozen=True)
class FieldWork:
    """What a run found out about the implement and its work.

    Attributes:
        seen: the implement as the scans show it; None where they show none.
        history: its states over time; None likewise.
        boundary: of the field, in the map frame; None where the session names none.
        ground: what was worked; None where no state of the tool is known, or not its width.
        depths: of each pass of `ground`.
        paths: of the tool; empty where `ground` is None, as `events`.
        events: along them.
        notices: for the report.
        external: states from another source that took the place of those seen; None where they did not.
        state_comparison: of external states with those seen; None where there are not both.
    """

    seen: SeenImplement | None = None
    history: ToolHistory | None = None
    boundary: BaseGeometry | None = None
    ground: WorkedGround | None = None
    depths: tuple[Depth, ...] = ()
    paths: tuple[ToolPath, ...] = ()
    events: tuple[Event, ...] = ()
    notices: tuple[Notice, ...] = ()
    external: ToolStates | None = None
    state_comparison: StateComparison | None = None

    @property
    def states(self) -> ToolStates | None:
        """The tool's states from which the ground is computed; None where none are known."""
        if self.external is not None:
            return self.external
        return self.history.states if self.history is not None else None

    @cached_property
    def passes(self) -> list[PassTimes]:
        """When the tool was down."""
        return pass_times(self.states) if self.states is not None else []

    def pass_at(self, t_s: ArrayLike) -> NDArray[np.intp]:
        """Number (n,) of the pass at times (n,), 1 for the first; 0 between passes."""
        return interval_numbers(self.passes, t_s)


class ImplementTracker:
    """Finds the implement in the first pass over a recording and tracks it in the second.

    Args:
        session: says how the scanner is mounted, and where the implement is if it knows.
        earlier: the implement as an earlier session learned it, for a session that does not show it moving.
        flying: whether the vehicle is an aircraft, which has no implement.
    """

    def __init__(self, session: Session, earlier: SeenImplement | None = None, *, flying: bool = False) -> None:
        self._flying = flying
        self._session = session
        self._earlier = earlier
        self._near: NearScans | None = NearScans(session.lidar.mounting)
        self._learned = Learned(None, ())
        self._heights: ToolHeightTracker | None = None
        self._notices: tuple[Notice, ...] = ()

    def add_scan(self, scan: Scan) -> None:
        """Add a scan of the first pass."""
        assert self._near is not None
        self._near.add(scan)

    def looked_at(self, scan: Scan) -> Scan:
        """A scan of the first pass, once it is added."""
        self.add_scan(scan)
        return scan

    def learn(self, trajectory: Trajectory) -> Machine | None:
        """Find the implement, between the two readings; the machine of which it is part, None where that is not known.

        Args:
            trajectory: of the vehicle.
        """
        assert self._near is not None
        stated, mounting = self._session.implement, self._session.lidar.mounting
        if self._flying:
            near, self._near = self._near.scans, None
            return learn_machine(near, np.ones(len(near), np.bool_), mounting, None, AIRBORNE)
        hint = Hint(stated.xy_m, stated.width_m, stated.region_m, stated.lift_m) if stated is not None else None
        self._learned = learn_implement(self._near.scans, hint)
        if self._learned.implement is None and self._earlier is not None:
            self._learned = Learned(self._earlier, (_FROM_EARLIER,))
        begin_s = np.array([scan.begin_s for scan in self._near.scans])
        machine = learn_machine(self._near.scans, _moving(trajectory, begin_s), mounting, self._learned.implement)
        if machine is None:
            self._notices = (_NO_MACHINE,)
        self._near = None
        if self._learned.implement is not None:
            depth_m = stated.working_depth_m if stated is not None else None
            self._heights = ToolHeightTracker(mounting, self._learned.implement, depth_m)
        return machine

    def following(self, scans: Iterable[Scan]) -> Iterator[Scan]:
        """The scans of the second reading, looked at on their way."""
        for scan in scans:
            if self._heights is not None:
                self._heights.add(scan)
            yield scan

    def work(
        self,
        trajectory: Trajectory,
        frame: MapFrame,
        boundary: BaseGeometry | None,
        external: ToolStates | None = None,
    ) -> FieldWork:
        """What the tool did and which ground it worked, after the second reading.

        Args:
            trajectory: of the vehicle.
            frame: the map.
            boundary: of the field, if known.
            external: states from another source, such as a machine log.
        """
        seen, stated = self._learned.implement, self._session.implement
        found = FieldWork(boundary=boundary, notices=(*self._learned.notices, *self._notices))
        if seen is not None and self._heights is not None:
            depth_m = stated.working_depth_m if stated is not None else None
            history = tool_history(self._heights.heights(), seen, depth_m)
            found = replace(found, seen=seen, history=history, notices=(*found.notices, *history.notices))
        if external is not None:
            found = with_external_states(found, external, self._session)
        return with_ground(found, trajectory, frame, stated)


def with_external_states(found: FieldWork, external: ToolStates, session: Session) -> FieldWork:
    """The work with states from elsewhere beside those seen, or in their place: as the session says."""
    assert session.implement is not None
    replaces = session.implement.states_use == REPLACE
    if found.history is None:
        return replace(found, external=external if replaces else None)
    agreed = compare_states(found.history.states, external)
    notices = (*found.notices, *agreed.notices(replaced=replaces))
    return replace(found, external=external if replaces else None, state_comparison=agreed, notices=notices)


def with_ground(found: FieldWork, trajectory: Trajectory, frame: MapFrame, implement: Implement | None) -> FieldWork:
    """The work with the ground that its states make; as it was where no state is known, or not the tool's width."""
    states, history = found.states, found.history
    if states is None or not _known(states):
        return found
    if implement is None:
        return replace(found, notices=(*found.notices, _NO_WIDTH))
    ground = worked_ground(trajectory, states, implement, frame, found.boundary)
    nothing = np.zeros(0)
    heights = (history.t_s, history.tool_height_m, history.soil_height_m) if history is not None else (nothing,) * 3
    return replace(
        found,
        ground=ground,
        depths=pass_depths([p.times for p in ground.passes], *heights, implement.working_depth_m),
        paths=tuple(tool_paths(trajectory, states, implement)),
        events=tuple(events(trajectory, states, implement)),
    )


def _moving(trajectory: Trajectory, t_s: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether the vehicle was on the move at times (n,); False where that is not known."""
    before, share, known = trajectory.interval(t_s)
    moving: NDArray[np.bool_] = known & (trajectory.motion[before + (share > 0.5)] != Motion.STANDING)
    return moving


def _known(states: ToolStates) -> bool:
    """Whether any state is."""
    return bool((states.state != ToolState.UNKNOWN).any())
