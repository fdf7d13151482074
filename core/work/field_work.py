"""The implements in a run: detection, tracking and worked ground."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, zip_longest
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from shapely.geometry.base import BaseGeometry

from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.scan import Scan, has_rings
from furrowmap.core.values.session import REPLACE, Implement, Session
from furrowmap.core.values.time_span import interval_numbers
from furrowmap.core.values.tool_states import ToolState, ToolStates
from furrowmap.core.values.trajectory import Motion, Trajectory
from furrowmap.core.work.depth import UNKNOWN_DEPTH, Depth, pass_depths
from furrowmap.core.work.external_states import StateComparison, compare_states
from furrowmap.core.work.ground import WorkedGround, worked_ground
from furrowmap.core.work.heights import ToolHeightTracker
from furrowmap.core.work.learning import learn_implement
from furrowmap.core.work.machine import AIRBORNE, MachineVoxels, learn_machine
from furrowmap.core.work.model import Hint, Learned, SeenImplement
from furrowmap.core.work.near_scans import FRONT_M, NearScan, NearScans
from furrowmap.core.work.states import ToolHistory, tool_history
from furrowmap.core.work.sweep import PassTimes, pass_times
from furrowmap.core.work.track import Event, ToolPath, events, tool_paths

_NO_MACHINE = Notice("machine-not-known")
_RINGED_SCANS: Final = 5
"""First scans that show whether the scanner has rings."""


@dataclass(frozen=True)
class FieldWork:
    """What a run found out about an implement and its work.

    Attributes:
        seen: the implement as the scans show it; None where they show none.
        history: its states over time; None likewise.
        boundary: of the field, in the map frame; None where the session names none.
        ground: what was worked; None where no state of the tool is known, or not its width.
        paths: of the tool; empty where `ground` is None, as `events`.
        external: states from another source that took the place of those seen; None where they did not.
        state_comparison: of external states with those seen; None where there are not both.
        tool: name of the implement; empty where there is one alone.
        scanner: number in the session of the scanner whose scans show it.
        others: of the other implements of the machine; `notices` has theirs as well.
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
    tool: str = ""
    scanner: int = 0
    others: tuple[FieldWork, ...] = ()

    @property
    def each(self) -> tuple[FieldWork, ...]:
        """Of every implement, that which moves the soil first."""
        return (self, *self.others)

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


class _ImplementTracking:
    """One implement on its way through both readings; None stands for what the session does not state."""

    def __init__(self, stated: Implement | None, earlier: SeenImplement | None) -> None:
        self._earlier = earlier
        self.stated, self.name = stated, stated.name if stated is not None else ""
        self.learned = Learned(None, ())
        self.heights: ToolHeightTracker | None = None
        self.hint = Hint(stated.xy_m, stated.width_m, stated.region_m, stated.lift_m) if stated is not None else None
        self._depth_m = stated.working_depth_m if stated is not None else None

    def learn(self, scans: Sequence[NearScan], mounting: Mounting) -> None:
        """Find it in scans of the first reading."""
        self.learned = learn_implement(scans, self.hint)
        if self.learned.implement is None and self._earlier is not None:
            self.learned = Learned(self._earlier, (Notice("implement-from-earlier"),))
        if self.learned.implement is not None:
            self.heights = ToolHeightTracker(mounting, self.learned.implement, self._depth_m)

    def found(self, boundary: BaseGeometry | None, external: ToolStates | None) -> FieldWork:
        """Its states, after the second reading."""
        seen = self.learned.implement
        found = FieldWork(boundary=boundary, notices=self.learned.notices, tool=self.name)
        if seen is not None and self.heights is not None:
            history = tool_history(self.heights.heights(), seen, self._depth_m)
            found = replace(found, seen=seen, history=history, notices=(*found.notices, *history.notices))
        if external is not None:
            assert self.stated is not None
            found = with_external_states(found, external, self.stated)
        return found


class ImplementTracker:
    """Finds the implements in the first pass over a recording and tracks them in the second.

    Args:
        session: says how the scanner is mounted, and where the implements are if it knows.
        earlier: each implement as an earlier session learned it, for a session that does not show it moving.
        flying: whether the vehicle is an aircraft, which has no implement.
    """

    def __init__(self, session: Session, earlier: Sequence[SeenImplement | None] = (), *, flying: bool = False) -> None:
        self.flying = flying
        self._session = session
        stated: Sequence[Implement | None] = session.implements or (None,)
        self._tools = [_ImplementTracking(*pair) for pair in zip_longest(stated, earlier[: len(stated)])]
        reach_m = [tool.hint.region_m[1] for tool in self._tools if tool.hint is not None and len(stated) > 1]
        self._near: NearScans | None = NearScans(session.lidar.mounting, max([FRONT_M, *reach_m]))
        self._notices: tuple[Notice, ...] = ()
        self._ringed: list[bool] = []

    @property
    def shown(self) -> bool:
        """Whether an implement is known, once they were looked for."""
        return any(tool.heights is not None for tool in self._tools)

    def add_scan(self, scan: Scan) -> None:
        """Add a scan of the first pass."""
        assert self._near is not None
        if len(self._ringed) < _RINGED_SCANS:
            self._ringed.append(has_rings(scan))
        self._near.add(scan)

    def looked_at(self, scan: Scan) -> Scan:
        """A scan of the first pass, once it is added."""
        self.add_scan(scan)
        return scan

    def learn(self, trajectory: Trajectory) -> MachineVoxels | None:
        """Find the implements, between the two readings; the machine of which they are part, None where not known."""
        assert self._near is not None
        mounting, near = self._session.lidar.mounting, self._near.scans
        self._near = None
        if self._ringed and not any(self._ringed):
            for tool in self._tools:
                tool.learned = Learned(None, (Notice("implement-no-rings"),))
            return None
        if self.flying:
            return learn_machine(near, np.ones(len(near), np.bool_), mounting, (), AIRBORNE)
        for tool in self._tools:
            tool.learn(near, mounting)
        begin_s = np.array([scan.begin_s for scan in near])
        seen = [tool.learned.implement for tool in self._tools if tool.learned.implement is not None]
        before, share, known = trajectory.interval(begin_s)
        moving: NDArray[np.bool_] = known & (trajectory.motion[before + (share > 0.5)] != Motion.STANDING)
        machine = learn_machine(near, moving, mounting, seen)
        if machine is None:
            self._notices = (_NO_MACHINE,)
        return machine

    def following(self, scans: Iterable[Scan]) -> Iterator[Scan]:
        """The scans of the second reading, looked at on their way."""
        for scan in scans:
            for tool in self._tools:
                if tool.heights is not None:
                    tool.heights.add(scan)
            yield scan

    def work(
        self,
        trajectory: Trajectory,
        frame: MapFrame,
        boundary: BaseGeometry | None,
        external: Sequence[ToolStates | None] = (),
    ) -> FieldWork:
        """What the tools did and which ground they worked, after the second reading.

        Args:
            external: states of each tool from another source, such as a machine log.
        """
        pairs = list(zip_longest(self._tools, external[: len(self._tools)]))
        from_scans = [
            tool for tool, states in pairs if tool.stated and (states is None or tool.stated.states_use != REPLACE)
        ]
        found = [tool.found(boundary, states) for tool, states in pairs]
        found[0] = replace(found[0], notices=(*found[0].notices, *self._notices))
        work = with_grounds(found, trajectory, frame, [tool.stated for tool in self._tools])
        return replace(work, notices=(*work.notices, *_not_separated(from_scans)))


def _not_separated(tools: Sequence[_ImplementTracking]) -> Iterator[Notice]:
    """Tools that are looked for in the same place."""
    for one, other in combinations(tools, 2):
        assert one.hint is not None
        assert other.hint is not None
        (a0, a1, b0, b1), (c0, c1, d0, d1) = one.hint.region_m, other.hint.region_m
        if max(a0, c0) < min(a1, c1) and max(b0, d0) < min(b1, d1):
            yield Notice("implements-overlap", one=one.name, other=other.name)


def with_grounds(
    found: Sequence[FieldWork], trajectory: Trajectory, frame: MapFrame, implements: Sequence[Implement | None]
) -> FieldWork:
    """The work of the first tool, which moves the soil, with the grounds of all and the others beside it."""
    first, *others = (with_ground(*pair, trajectory, frame) for pair in zip(found, implements, strict=True))
    if not others:
        return first
    depthless = [replace(work, depths=tuple(UNKNOWN_DEPTH for _ in work.depths)) for work in others]
    notices = [
        notice if notice is _NO_MACHINE else notice.about(work.tool)
        for work in (first, *others)
        for notice in work.notices
    ]
    return replace(first, others=tuple(depthless), notices=tuple(notices))


def with_external_states(found: FieldWork, external: ToolStates, implement: Implement) -> FieldWork:
    """The work with states from elsewhere beside those seen, or in their place: as the session says."""
    replaces = implement.states_use == REPLACE
    if found.history is None:
        return replace(found, external=external if replaces else None)
    agreed = compare_states(found.history.states, external)
    notices = (*found.notices, *agreed.notices(replaced=replaces))
    return replace(found, external=external if replaces else None, state_comparison=agreed, notices=notices)


def with_ground(found: FieldWork, implement: Implement | None, trajectory: Trajectory, frame: MapFrame) -> FieldWork:
    """The work with the ground that its states make; as it was where no state is known, or not the tool's width."""
    states, history = found.states, found.history
    if states is None or not (states.state != ToolState.UNKNOWN).any():
        return found
    if implement is None:
        return replace(found, notices=(*found.notices, Notice("implement-not-stated")))
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
