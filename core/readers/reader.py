"""The interface of readers, and how the reader of a file is found.

The reader of a sensor or format is one class with `format`, `title`, `recognise` and `inspect`, and `scans`, `track`,
`poses`, `images` or `states` for the data that it provides. Readers are found through the entry-point group
``furrowmap.readers``, in furrowmap itself and in any other installed package.
"""

import importlib.metadata
import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Final, Protocol, Self, runtime_checkable

from furrowmap.core.readers.agopengps import PARTS, is_field_folder
from furrowmap.core.readers.source import Head, look
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.file_signatures import BINARY, binary_kind, file_kind
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.camera import Camera
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.images import Images
from furrowmap.core.values.inertial import UNITS_OF_FORMAT, InertialTrack, StatedUnits
from furrowmap.core.values.pose_track import AttitudeTrack, PoseTrack
from furrowmap.core.values.scan import Clock, ClockReading, Scan
from furrowmap.core.values.tool_states import ToolStates

GROUP: Final = "furrowmap.readers"

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ReadOptions:
    """Information about a recording that is not in its files.

    Attributes:
        date: UTC date (YYYY-MM-DD) of the first position of a log without dates.
        near_s: a UTC time near the recording, for clocks that show only a part of the time.
        time: time scale of trajectory files that do not state it, "utc" or "gps".
        columns: what the columns of a CSV are: name → (quantity, unit, scale); empty for names that say it.
        units: of the measurements of an IMU, where they are others than its format says.
        source: which of several scanners in the files: its address, UDP port or serial number, in a bag its topic.
        glance_s: one scan or image in this many seconds is sufficient; of scans a reader may yield more if skipping
            saves no time.
    """

    model: str | None = None
    date: str | None = None
    near_s: float | None = None
    time: str | None = None
    week: int | None = None
    task: str | None = None
    topic: str | None = None
    source: str | None = None
    columns: Mapping[str, tuple[str, str, float]] = field(default_factory=dict)
    units: StatedUnits = UNITS_OF_FORMAT
    glance_s: float | None = None


@dataclass(frozen=True)
class Inspection:
    """The format and the content of a file.

    Facts are numbers, strings, lists, dicts of such, in the order of display.
    """

    path: Path
    format: str
    title: Text
    facts: dict[str, Any]
    clocks: tuple[ClockReading, ...] = ()
    notices: tuple[Notice, ...] = field(default=())


class Reader(Protocol):
    """A format's reader, opened on the files of one recording in the order of time.

    Attributes:
        format: short name, such as "velodyne-pcap".
        title: name for people, such as "Velodyne packets in a PCAP capture".
        notices: what is unusual, missing or damaged; complete when reading has ended. Where scans are not taken to
            their end, it is what was found up to there.
    """

    format: ClassVar[str]
    title: ClassVar[Text]
    notices: list[Notice]

    def __init__(self, paths: Sequence[Path], options: ReadOptions) -> None: ...

    @classmethod
    def recognise(cls, head: Head) -> float:
        """How certain it is that the file is of this format: 0 (it is not) to 1 (certain by its content)."""
        ...

    def inspect(self) -> Inspection:
        """Read the whole first file and report what it contains; InputError if the file cannot be read."""
        ...


class FileReader:
    """Base of furrowmap's own readers, of the files of one recording in the order of time."""

    format: ClassVar[str]
    title: ClassVar[Text]

    def __init__(self, paths: Sequence[Path], options: ReadOptions) -> None:
        self.paths = list(paths)
        self.options = options
        self.notices: list[Notice] = []

    @property
    def name(self) -> str:
        """The files, for messages."""
        return recording_name(self.paths)

    def _add_notices(self, *notices: Notice) -> None:
        """Add those that are new: a file may be read more than once."""
        self.notices[:] = dict.fromkeys([*self.notices, *notices])

    def as_read(self, notices: Iterable[Notice]) -> list[Notice]:
        """Those that are about the recording: between glances at it there are pauses, which are none of its own."""
        return [notice for notice in notices if self.options.glance_s is None or notice.code != "pauses"]


def recording_name(paths: Sequence[Path]) -> str:
    """The name of a recording of one or more files, for messages."""
    return str(paths[0]) if len(paths) == 1 else f"{paths[0]} and {len(paths) - 1} more"


@runtime_checkable
class GivesScans(Reader, Protocol):
    """A reader of a laser scanner's recording.

    Attributes:
        clocks: readings of all clocks in the recording, that one first; complete when the scans have ended.
        share_read: share of the files that has been read, 0 to 1.
    """

    clock: Clock
    clocks: tuple[ClockReading, ...]
    share_read: float

    def scans(self) -> Iterator[Scan]:
        """The scans in the order of time, streamed; numbered from 0 across all files.

        A generator that is closed before its end sets `notices` and `clocks` all the same (`runtime.iteration`).
        """
        ...


@runtime_checkable
class GivesBeams(Protocol):
    """A reader of a scanner whose packets those of other models look like."""

    def beam_elevations(self) -> Mapping[str, FloatArray]:
        """Elevations (lasers,) in degrees by model, lowest first; the model in use first.

        Known from the first scan on; empty before.
        """
        ...


@runtime_checkable
class GivesTrack(Reader, Protocol):
    """A reader of a GNSS receiver's positions."""

    def track(self) -> GnssTrack:
        """All positions of all files."""
        ...


@runtime_checkable
class GivesPoses(Reader, Protocol):
    """A reader of a trajectory from other software."""

    def poses(self) -> PoseTrack:
        """All poses of all files."""
        ...


@runtime_checkable
class GivesInertial(Reader, Protocol):
    """A reader of an inertial measurement unit (IMU)."""

    def inertial(self) -> InertialTrack:
        """All measurements of all files, in the axes of the IMU."""
        ...


@runtime_checkable
class GivesAttitude(Reader, Protocol):
    """A reader of an attitude and heading reference system (AHRS)."""

    def attitude(self) -> AttitudeTrack:
        """All attitudes of all files; nan for angles that are not recorded."""
        ...


@runtime_checkable
class GivesImages(Reader, Protocol):
    """A reader of the images of a camera."""

    def images(self) -> Images:
        """All images of all files."""
        ...

    def camera(self) -> Camera:
        """The camera's size and intrinsics as recorded beside the images."""
        ...


@runtime_checkable
class GivesStates(Reader, Protocol):
    """A reader of recorded states of the implement."""

    def states(self) -> ToolStates:
        """When the implement was in the ground, in all files; the end of the last interval may be infinite."""
        ...


@dataclass(frozen=True)
class Recognised:
    """A file, a class of readers, and how certain it is that the file is of its format."""

    head: Head
    reader: type[Reader]
    certainty: float

    def open(self, options: ReadOptions | None = None) -> Reader:
        """The reader, opened on this file alone."""
        return self.reader([self.head.path], options or ReadOptions())

    def inspect(self, options: ReadOptions | None = None) -> Inspection:
        """The format and the content of the file."""
        return self.open(options).inspect()

    @classmethod
    def by_content(cls, path: Path) -> Self:
        """The reader of a file; InputError if no reader recognises it."""
        return cls.each_by_content(path)[0]

    @classmethod
    def each_by_content(cls, path: Path) -> list[Self]:
        """All readers of a file, the most certain first; errors as :meth:`by_content`."""
        head = look(path)
        scores = sorted(((reader.recognise(head), reader.format, reader) for reader in readers()), key=lambda s: s[:2])
        found = [cls(head, reader, certainty) for certainty, _, reader in reversed(scores) if certainty > 0]
        if not found:
            raise _unknown(head)
        return found


def open_recording(paths: Sequence[Path], options: ReadOptions) -> Reader:
    """The reader of one recording that may be split into several files; InputError if they differ in format."""
    first, *beside = Recognised.each_by_content(paths[0])
    found = [first, *map(Recognised.by_content, paths[1:])]
    for other in found[1:]:
        if other.reader is not found[0].reader:
            raise InputError(
                "mixed-formats",
                head=other.head.path,
                title=other.reader.title,
                paths=paths[0],
                other_title=found[0].reader.title,
            )
    files = [f.head.path for f in found]
    try:
        return first.reader(files, options)
    except InputError as error:
        # A capture may hold scanners of two makers.
        if error.code != "sensor-not-there":
            raise
        for other in beside:
            with suppress(InputError):
                return other.reader(files, options)
        raise


@cache
def readers() -> tuple[type[Reader], ...]:
    """All reader classes of all installed packages; those of other packages that cannot be imported are skipped."""
    found: list[type[Reader]] = []
    for entry in importlib.metadata.entry_points(group=GROUP):
        try:
            found.append(entry.load())
        except Exception as error:
            if entry.module.startswith("furrowmap."):
                raise
            log.warning("the reader %s (%s) cannot be imported: %s", entry.name, entry.value, error)
    return tuple(found)


def _titles() -> tuple[Text, ...]:
    return tuple(sorted((reader.title for reader in readers()), key=str))


def _unknown(head: Head) -> InputError:
    """The error of a file that no reader recognises, with a guess at its format."""
    if is_field_folder(head.path) or any(part in head.data[:256] for part in PARTS):
        return InputError("unknown-format.agopengps", head=head.path)
    if head.path.is_dir():
        return InputError(
            "unknown-format.folder-content",
            head=head.path,
            readers=_titles(),
        )
    kind = file_kind(head.data)
    if kind is not None:
        return InputError("unknown-format.known-kind", head=head.path, name=kind.name, remedy=kind.remedy)
    content = BINARY if binary_kind(head.data) is not None else Text("it looks like text")
    if head.compression:
        content = Text("{compression}, content unpacked: {content}", compression=head.compression, content=content)
    return InputError(
        "unknown-format",
        head=head.path,
        own=content,
        readers=_titles(),
    )
