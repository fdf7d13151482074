"""Ground that was recorded but not shown is worked out from the recording, with what time is left, newest first."""

import math
from collections.abc import Iterator, Sequence
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from furrowmap.core.coverage.worked_cells import Swept, Tile
from furrowmap.core.implement.seen_implement import SeenImplement
from furrowmap.core.live.drive import TRUE_LEVEL_SIGMA
from furrowmap.core.live.live_session import LINE_STEP_S, LiveSession, prepare_worker
from furrowmap.core.live.poses import LivePoses
from furrowmap.core.readers.reader import GivesTrack
from furrowmap.core.runtime.errors import FurrowmapError
from furrowmap.core.session.opened import OpenSession, open_session
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.scan import Scan
from furrowmap.workflows.live.feeds import GNSS_DELAY_S, recorded_scans
from furrowmap.workflows.live.followed_scanner import with_followed_scanner

PIECE_S: Final = 60.0
"""Worked out at a time: the newest is on the page first."""
RUN_UP_S: Final = 35.0
"""Looked at before a piece: heading and working position of the tool are known by what was before."""
RUN_OUT_S: Final = 2.0
"""Looked at after it."""
LEAST_S: Final = 0.5
"""Less than this without scans changes no ground: place and tool are known from the scans around."""
JOINED_S: Final = 10.0
"""What was lost less far apart is worked out at once."""
REST_S: Final = 4.0
"""What is newer may still be shown in time."""


class Lost(NamedTuple):
    """A time, UTC, of which not all was shown."""

    begin_s: float
    end_s: float


@dataclass(frozen=True)
class WorkedAgain:
    """What the tool did in a piece of the recording, known from `since_s` on."""

    since_s: float
    swept: Swept


class Repairs:
    """Lets a process of its own, which gives way to all others, look at the lost pieces of a recording again.

    Args:
        file: the session of the recording.
        session: what is shown.
    """

    def __init__(self, file: Path, session: LiveSession) -> None:
        self._file = file
        self._session = session
        self._lost: list[Lost] = []
        self._tried: list[Lost] = []
        self._pool: ProcessPoolExecutor | None = None
        self._piece: Lost | None = None
        self._future: Future[WorkedAgain | None] | None = None
        self._newest_s = -math.inf
        self.utc_minus_host_s = 0.0

    def lose(self, begin_s: float, end_s: float) -> None:
        """Scans of a time, UTC, were not looked at."""
        if self._lost and begin_s - self._lost[-1].end_s < LEAST_S:
            self._lost[-1] = Lost(self._lost[-1].begin_s, end_s)
        else:
            self._lost.append(Lost(begin_s, end_s))

    def left_s(self, *, is_over: bool = False) -> float:
        """How much of the recording waits to be looked at again; without those of the last seconds unless it is over.

        That which cannot be worked out yet, because the implement is not learned, waits too.
        """
        return sum(piece.end_s - piece.begin_s for piece in self._waiting(is_over=is_over))

    def step(self, now_s: float, *, is_over: bool = False) -> frozenset[Tile]:
        """Take what was found and look for the next piece; the tiles that changed.

        Args:
            now_s: UTC of the last scan.
            is_over: whether no more scans come.
        """
        self._newest_s = now_s
        changed: frozenset[Tile] = frozenset()
        if self._future is not None and self._future.done() and self._piece is not None:
            error = self._future.exception()
            found = self._future.result() if error is None else None
            if isinstance(error, BrokenExecutor):  # its process was killed; the next piece gets another
                self.close()
            if found is not None and found.since_s < self._piece.end_s:
                begin_s = max(self._piece.begin_s, found.since_s)
                changed = self._session.work_again(begin_s, self._piece.end_s, found.swept)
            self._tried.append(self._piece)
            self._future = None
        learned = self._session.seen_implement
        if self._future is None and learned is not None:
            waiting = self._waiting(is_over=is_over)
            if waiting:
                last = waiting[-1]
                self._piece = Lost(max(last.begin_s, last.end_s - PIECE_S), last.end_s)
                try:
                    self._future = self._begun(self._piece, learned)
                except BrokenExecutor:  # killed while it waited
                    self.close()
        return changed

    def _begun(self, piece: Lost, learned: SeenImplement) -> "Future[WorkedAgain | None]":
        self._pool = self._pool or ProcessPoolExecutor(1, get_context("spawn"), prepare_worker)
        return self._pool.submit(work_again, self._file, learned, piece.begin_s, piece.end_s, self.utc_minus_host_s)

    def can_go_on(self) -> bool:
        """Whether anything is left that can be worked out once the recording is over."""
        return self._future is not None or (
            self._session.seen_implement is not None and bool(self._waiting(is_over=True))
        )

    def close(self) -> None:
        """End the process; the next piece would get another."""
        if self._pool is not None:
            self._pool.shutdown(wait=False, cancel_futures=True)
            self._pool = None

    def _waiting(self, *, is_over: bool) -> list[Lost]:
        """What was lost and not looked at again, in its order."""
        lost = [piece for piece in self._lost if piece.end_s - piece.begin_s > LEAST_S]
        lost += [Lost(*piece) for piece in self._session.unseen_s()]
        until_s = math.inf if is_over else self._newest_s - REST_S
        lost = [piece for piece in joined(lost) if piece.end_s < until_s]
        return without(lost, self._tried)


def joined(pieces: Sequence[Lost]) -> list[Lost]:
    """Pieces in their order, those that are near each other as one."""
    out: list[Lost] = []
    for piece in sorted(pieces):
        if out and piece.begin_s - out[-1].end_s < JOINED_S:
            out[-1] = Lost(out[-1].begin_s, max(out[-1].end_s, piece.end_s))
        else:
            out.append(piece)
    return out


def without(pieces: Sequence[Lost], others: Sequence[Lost]) -> list[Lost]:
    """What is left of pieces in their order without others, but for rests shorter than `LEAST_S`."""
    left = list(pieces)
    for other in others:
        parts = [
            Lost(*part)
            for piece in left
            for part in (
                (piece.begin_s, min(piece.end_s, other.begin_s)),
                (max(piece.begin_s, other.end_s), piece.end_s),
            )
        ]
        left = [part for part in dict.fromkeys(parts) if part.end_s - part.begin_s > LEAST_S]
    return left


def work_again(
    file: Path, learned: SeenImplement, begin_s: float, end_s: float, utc_minus_host_s: float
) -> WorkedAgain | None:
    """What the tool did in a time of a recording; None if that cannot be found out.

    Args:
        file: of the session.
        learned: its implement.
        begin_s: UTC.
        utc_minus_host_s: of the clock of the computer that recorded.
    """
    try:
        opened = with_followed_scanner(open_session(file))
        reader = opened.positions()
        assert isinstance(reader, GivesTrack)
        track = reader.track()
        # Looked at twice: what is level is known at the end alone, and moves the first places by centimetres.
        poses = LivePoses(opened.session, opened.frame)
        behind_s = opened.session.recording.lidar_minus_gnss_s or 0.0
        for scan, come in _with_positions(opened, track, begin_s, end_s, utc_minus_host_s):
            poses.add_track(come)
            poses.add_scan(replace(scan, t_s=scan.t_s - behind_s))
        level = poses.level
        known = level if level is not None and level.sigma < TRUE_LEVEL_SIGMA else None
        live = LiveSession(opened.session, opened.frame, learned, known)
        for scan, come in _with_positions(opened, track, begin_s, end_s, utc_minus_host_s):
            live.add_track(come)
            live.add_scan(scan)
    except (FurrowmapError, OSError):
        return None
    live.finish()
    if live.cells is None:
        return None
    swept = live.cells.swept
    swept = swept[(swept.t_s > begin_s) & (swept.t_s <= end_s + LINE_STEP_S)]  # up to the place where others go on
    return WorkedAgain(live.since_s, replace(swept, t_s=np.minimum(swept.t_s, end_s)))


def _with_positions(
    opened: OpenSession, track: GnssTrack, begin_s: float, end_s: float, utc_minus_host_s: float
) -> Iterator[tuple[Scan, GnssTrack]]:
    """The scans of a time, and of those before and after that are needed, each with the positions that came since."""
    from_s = begin_s - RUN_UP_S
    until_s = end_s + RUN_OUT_S
    behind_s = opened.session.recording.lidar_minus_gnss_s or 0.0
    given = int(np.searchsorted(track.t_s, from_s))
    for scan in recorded_scans(opened, from_s, until_s, utc_minus_host_s):
        if not len(scan) or scan.t_s[-1] - behind_s < from_s:
            continue
        come = max(given, int(np.searchsorted(track.t_s, scan.t_s[-1] - behind_s - GNSS_DELAY_S)))
        yield scan, track[given:come]
        given = come
        if scan.t_s[0] - behind_s > until_s:
            return
