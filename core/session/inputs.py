"""The files that a session names, and the readers that are opened on them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol, cast

from furrowmap.core.readers.reader import GivesPoses, GivesScans, GivesTrack, Reader, ReadOptions, open_recording
from furrowmap.core.values.errors import InputError
from furrowmap.core.values.progress import Progress
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.session import Session, resolve

_GIVES: Final = {GivesScans: "laser scans", GivesTrack: "positions", GivesPoses: "trajectory"}


class LidarReader(Reader, GivesScans, Protocol):
    """A reader of laser scans."""


@dataclass(frozen=True)
class Inputs:
    """The files that a session names, found before any work starts.

    Attributes:
        lidar: of the laser scanner, in the order of time.
        positions: of the receiver, or of the trajectory from elsewhere, in the order of time.
        boundary: of the field.
        states: that say when the tool worked.
        learned: of the implement, from an earlier session.
        crs: parameters and geoid of the map frame.
    """

    lidar: tuple[Path, ...]
    positions: tuple[Path, ...]
    boundary: tuple[Path, ...] = ()
    states: tuple[Path, ...] = ()
    learned: tuple[Path, ...] = ()
    crs: tuple[Path, ...] = ()

    @classmethod
    def of(cls, session_file: Path, session: Session) -> Inputs:
        """The files that `session` names, relative to `session_file`.

        Raises:
            InputError: if one is missing, or lies outside the session's folder.
        """
        stated = session.trajectory
        positions = stated.files if stated is not None else session.recording.gnss
        boundary = session.field.boundary
        learned = session.implement.learned if session.implement is not None else None
        return cls(
            tuple(resolve(session_file, name) for name in session.recording.lidar),
            tuple(resolve(session_file, name) for name in positions),
            (resolve(session_file, boundary),) if boundary is not None else (),
            tuple(resolve(session_file, name) for name in (session.implement.states if session.implement else ())),
            (resolve(session_file, learned),) if learned is not None else (),
            tuple(resolve(session_file, name) for name in (session.crs.parameters, session.crs.geoid_grid) if name),
        )

    @property
    def all(self) -> tuple[Path, ...]:
        """Every file once, the scanner's first, in the order in which the session names them."""
        return tuple(dict.fromkeys(self.lidar + self.positions + self.boundary + self.states + self.learned + self.crs))


def open_positions(inputs: Inputs, session: Session) -> Reader:
    """The reader of the session's positions, or of its trajectory from elsewhere.

    Raises:
        InputError: if a file is of no known kind, or of one that cannot give what it is named for.
    """
    stated = session.trajectory
    options = ReadOptions(
        date=session.recording.date,
        time=stated.time if stated is not None else None,
        week=stated.week if stated is not None else None,
        task=session.recording.task,
    )
    reader = open_recording(inputs.positions, options)
    if stated is not None:
        _expect(reader, GivesPoses, inputs.positions[0], "trajectory.files")
    else:
        _expect(reader, GivesTrack, inputs.positions[0], "recording.gnss")
    return reader


def open_lidar(inputs: Inputs, session: Session, near_s: float, glance_s: float | None = None) -> LidarReader:
    """The reader of the session's laser scans; `near_s` is a time of the drive by the scanner's clock.

    With `glance_s` a scan in so many seconds is enough.

    Raises:
        InputError: as :func:`open_positions`.
    """
    reader = open_recording(inputs.lidar, ReadOptions(model=session.lidar.model, near_s=near_s, glance_s=glance_s))
    _expect(reader, GivesScans, inputs.lidar[0], "recording.lidar")
    return cast("LidarReader", reader)


def watched(scans: Iterator[Scan], reader: LidarReader, progress: Progress, stage: str) -> Iterator[Scan]:
    """The scans; tells `progress` how much of the recording has been read."""
    for scan in scans:
        yield scan
        progress(stage, reader.share_read)
    progress(stage, 1.0)


def _expect(reader: Reader, kind: type[object], path: Path, key: str) -> None:
    """Raises InputError where a file cannot give what the session names it for."""
    if not isinstance(reader, kind):
        raise InputError(
            f"{path} is '{reader.title}', which gives no {_GIVES[kind]}.",
            f"The session names it under `{key}`.",
            "Name the right file there; `furrowmap inspect` says what a file holds.",
            code="wrong-kind-of-file",
        )
