"""What a reader is, and how a file finds its own.

A new kind of sensor is one file with one class that has `format`, `title`, `recognise` and `inspect`, and `scans`,
`track` or `poses` for what it can give. It is found through the entry-point group ``furrowmap.readers``, from furrowmap
itself or from any other installed package.
"""

from __future__ import annotations

import importlib.metadata
import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Final, Protocol, Self, runtime_checkable

from furrowmap.core.readers.source import Head, look
from furrowmap.core.values.errors import InputError, Notice
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.pose_track import PoseTrack
from furrowmap.core.values.scan import Clock, Scan
from furrowmap.core.values.tool_states import ToolStates

GROUP = "furrowmap.readers"

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ReadOptions:
    """What is known about a recording from elsewhere.

    Attributes:
        model: the scanner's model, which wins over what the packets say.
        date: UTC date (YYYY-MM-DD) of the first position of a log without dates.
        near_s: a UTC time near which the recording lies, for clocks that show only a part of it.
        time: "utc" or "gps", for trajectory files that do not say.
        week: GPS week, for files whose times are seconds of the week.
        task: id or name of the task that is wanted, for task data of several.
        glance_s: a scan in so many seconds is enough; a reader gives more where leaving them out saves it nothing.
    """

    model: str | None = None
    date: str | None = None
    near_s: float | None = None
    time: str | None = None
    week: int | None = None
    task: str | None = None
    glance_s: float | None = None


@dataclass(frozen=True)
class ClockReading:
    """What one clock in a file said.

    Attributes:
        clock: which.
        first_s: its first reading as UTC.
        last_s: its last one.
        note: how it stands to the others, and how well it is known.
    """

    clock: Clock
    first_s: float
    last_s: float
    note: str = ""


@dataclass(frozen=True)
class Inspection:
    """What a file is and holds.

    Attributes:
        path: the file.
        format: the reader's `format`.
        title: in words.
        facts: names and values (numbers, strings, lists, dicts of such), in the order in which they are shown.
        clocks: every clock the file speaks of.
        notices: what is odd, missing or damaged.
    """

    path: Path
    format: str
    title: str
    facts: dict[str, Any]
    clocks: tuple[ClockReading, ...] = ()
    notices: tuple[Notice, ...] = field(default=())


class Reader(Protocol):
    """A format's reader, opened on the files of one recording in the order of time.

    Attributes:
        format: short name, such as "velodyne-pcap".
        title: in words, such as "Velodyne packets in a PCAP capture".
        notices: what has been noticed so far; complete when reading has ended.
    """

    format: ClassVar[str]
    title: ClassVar[str]
    notices: list[Notice]

    def __init__(self, paths: Sequence[Path], options: ReadOptions) -> None: ...

    @classmethod
    def recognise(cls, head: Head) -> float:
        """How sure the reader is that a file with this head is its own: 0 (no) to 1 (by its content, certainly)."""
        ...

    def inspect(self) -> Inspection:
        """Read the first file through and say what it is and holds."""
        ...


class FileReader:
    """What furrowmap's own readers begin with.

    Args:
        paths: the files of one recording, in the order of time.
        options: which of them are used, the format's class says.
    """

    def __init__(self, paths: Sequence[Path], options: ReadOptions) -> None:
        self.paths = list(paths)
        self.options = options
        self.notices: list[Notice] = []


@runtime_checkable
class GivesScans(Protocol):
    """A reader of a laser scanner's recording.

    Attributes:
        clock: which clock its times come from.
        clocks: what every clock of the recording said, that one first; complete when the scans have ended.
        share_read: how much of the files has been read, 0 to 1.
    """

    clock: Clock
    clocks: tuple[ClockReading, ...]
    share_read: float

    def scans(self) -> Iterator[Scan]:
        """The scans in the order of time, streamed; numbered from 0 over all files."""
        ...


@runtime_checkable
class GivesTrack(Protocol):
    """A reader of a GNSS receiver's positions."""

    def track(self) -> GnssTrack:
        """All positions of all files."""
        ...


@runtime_checkable
class GivesPoses(Protocol):
    """A reader of a trajectory from elsewhere."""

    def poses(self) -> PoseTrack:
        """All poses of all files."""
        ...


@runtime_checkable
class GivesStates(Protocol):
    """A reader of what somebody else says of the tool."""

    def states(self) -> ToolStates:
        """When the tool was in the ground, in all files; the end of the last interval may be infinite."""
        ...


@dataclass(frozen=True)
class Recognised:
    """A file and the reader class that knows it best."""

    head: Head
    reader: type[Reader]

    def open(self, options: ReadOptions | None = None) -> Reader:
        """The reader, opened on this file alone."""
        return self.reader([self.head.path], options or ReadOptions())

    def inspect(self, options: ReadOptions | None = None) -> Inspection:
        """What the file is and holds."""
        return self.open(options).inspect()

    @classmethod
    def of(cls, path: Path) -> Self:
        """The file's reader.

        Raises:
            InputError: if no reader knows the file.
        """
        head = look(path)
        scores = sorted(((reader.recognise(head), reader.format, reader) for reader in readers()), key=lambda s: s[:2])
        if not scores or scores[-1][0] <= 0:
            raise _unknown(head)
        return cls(head, scores[-1][2])


def open_recording(paths: Sequence[Path], options: ReadOptions) -> Reader:
    """The reader of one recording that may be split into several files of one format.

    Raises:
        InputError: if a file is of no known format, or the files are of different ones.
    """
    found = [Recognised.of(path) for path in paths]
    for other in found[1:]:
        if other.reader is not found[0].reader:
            raise InputError(
                f"{other.head.path} ({other.reader.title}) goes not with {paths[0]} ({found[0].reader.title}).",
                "The files of one recording are read as one stream, so they must be of one kind.",
                "Name the files of one recorder together, and the others under their own key.",
                code="mixed-formats",
            )
    return found[0].reader([f.head.path for f in found], options)


@cache
def readers() -> tuple[type[Reader], ...]:
    """All reader classes of all installed packages; one of another package that cannot be imported is left out."""
    found: list[type[Reader]] = []
    for entry in importlib.metadata.entry_points(group=GROUP):
        try:
            found.append(entry.load())
        except Exception as error:
            if entry.module.startswith("furrowmap."):
                raise
            log.warning("the reader %s (%s) cannot be used: %s", entry.name, entry.value, error)
    return tuple(found)


_STRANGERS: Final = {
    b"# .PCD": "a PCD point cloud",
    b"PK\x03\x04": "a zip archive",
    b"SQLite format 3": "an SQLite database",
    b"\x89PNG": "a PNG picture",
    b"%PDF": "a PDF document",
    b"II*\x00": "a TIFF picture",
    **dict.fromkeys(
        (b"GRIDDED CORRECTION", b"for SemiDynaEXE", b"for PatchJGD", b"JGD2000-TokyoDatum"),
        "parameters that move coordinates (.par): a session names them under [crs]",
    ),
}
_RECEIVERS_OWN: Final = {
    b"\xb5\x62": "a u-blox receiver's own messages (UBX)",
    b"$@": "a Septentrio receiver's own messages (SBF)",
    b"\xd3\x00": "corrections or raw observations (RTCM 3)",
}
"""What files of formats that are not read begin with; the second kind has positions that can be exported."""


def _unknown(head: Head) -> InputError:
    """The error of a file that no reader knows, with a word on what it may be."""
    known = f"Known: {'; '.join(sorted(reader.title for reader in readers()))}."
    if head.path.is_dir():
        return InputError(
            f"{head.path} is a folder, and holds no bag and no task data.",
            "Of folders only those of ROS 2 bags (metadata.yaml with .db3 or .mcap files) and of task data "
            "(TASKDATA.XML) are read as a whole.",
            f"Name the files in it. {known}",
            code="unknown-format",
        )
    own = next((words for start, words in _RECEIVERS_OWN.items() if head.data.startswith(start)), "")
    cure = "Export NMEA (GGA, RMC, GST) from the receiver's or the processor's tool. " if own else ""
    return InputError(
        f"{head.path}: of no kind that furrowmap reads ({f'it looks like {own}' if own else _looks_like(head.data)}).",
        "It is neither a known LiDAR or GNSS recording nor a trajectory.",
        f"{cure}{known}",
        code="unknown-format",
    )


def _looks_like(data: bytes) -> str:
    """A few words on content that nobody recognised."""
    for start, words in _STRANGERS.items():
        if data.startswith(start):
            return f"it looks like {words}"
    printable = sum(32 <= b < 127 or b in b"\r\n\t" for b in data[:4096])
    return "it looks like text" if printable > 0.95 * min(len(data), 4096) else "binary data"
