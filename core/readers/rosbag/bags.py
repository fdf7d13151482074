"""ROS bags: laser scans from packets or point clouds, GNSS positions, inertial measurements, and images."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final, TypeVar

from furrowmap.core.readers.implausible_positions import drop_implausible_positions
from furrowmap.core.readers.reader import FileReader, Inspection, ReadOptions
from furrowmap.core.readers.rosbag import messages as ros
from furrowmap.core.readers.rosbag.clouds import CloudScans, LineScans
from furrowmap.core.readers.rosbag.db3 import SQLITE_MAGIC
from furrowmap.core.readers.rosbag.files import METADATA, BagFiles, storage_files
from furrowmap.core.readers.rosbag.livox import LIVOX_CLOUDS
from furrowmap.core.readers.rosbag.mcap import MCAP_MAGIC
from furrowmap.core.readers.rosbag.messages import AttitudeLog, FixLog, ImuLog, SentenceLog, deserialize
from furrowmap.core.readers.rosbag.pictures import ImageLog, camera_of_info, info_topic
from furrowmap.core.readers.rosbag.rosbag1 import ROSBAG1_MAGIC
from furrowmap.core.readers.rosbag.storage import BagMessage, Damage
from furrowmap.core.readers.source import Head
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.values.camera import DISTORTION, PINHOLE, Camera
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.clock_readings import ClockReading
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.images import Images
from furrowmap.core.values.inertial import InertialTrack
from furrowmap.core.values.pose_track import AttitudeTrack
from furrowmap.core.values.scan import Clock, Scan

if TYPE_CHECKING:
    from furrowmap.core.readers.rosbag.packets import OusterMessages, PacketScans

T = TypeVar("T")
Log = TypeVar("Log", FixLog, SentenceLog, ImuLog, AttitudeLog, ImageLog)
_DJI_NODES: Final = frozenset({"dji_sdk", "dji_osdk_ros"})
_POINT_TIMES: Final = "time stamps of the points, the clock of the scans"
_SCAN_TYPES: Final = (*ros.PACKET_SCANS, *LIVOX_CLOUDS, ros.POINT_CLOUD, ros.LASER_SCAN)
"""Types of messages with scans, those preferred first."""


@dataclass
class _Topic:
    """The messages of one name and type."""

    name: str
    type: str
    messages: int
    first_ns: int
    last_ns: int

    @property
    def is_dji(self) -> bool:
        """Whether it is of the autopilot, by DJI's node."""
        return not _DJI_NODES.isdisjoint(self.name.split("/"))


class _RosBag(FileReader):
    """What bags of ROS 1 and ROS 2 have in common.

    Reading takes two passes over the messages: one to list the topics, because a bag's index may be missing or wrong,
    and one for the messages of the chosen topic.
    """

    def __init__(self, paths: Sequence[Path], options: ReadOptions) -> None:
        super().__init__(paths, options)
        if find_spec("rosbags") is None or find_spec("lz4") is None:
            raise InputError("extra-missing.bags", path=self.paths[0])
        self.clock = Clock.RECORDER
        self.clocks: tuple[ClockReading, ...] = ()
        self.share_read = 0.0
        self._topics: list[_Topic] | None = None

    def scans(self) -> Iterator[Scan]:
        """The scans of the topic that `options` name, else of that with the most packets, point clouds, or sweeps."""
        chosen = self._choose("laser scans", *_SCAN_TYPES, wanted=self.options.source)
        yield from self._scans(chosen, self._decoder(chosen))

    def track(self) -> GnssTrack:
        """The positions of the topic that `options` name, else in NMEA sentences, else in NavSatFix messages.

        Those of a DJI autopilot are read if there are no others.
        """
        return self._positions()[0]

    def inertial(self) -> InertialTrack:
        """The measurements of the topic that `options` name, else of that with the most Imu messages."""
        return self._inertial()[0]

    def attitude(self) -> AttitudeTrack:
        """The orientations of the topic that `options` name, else of that with the most Imu messages."""
        return self._attitudes()[0]

    def images(self) -> Images:
        """The images of the topic that `options` name, else of that with the most messages; their bytes are on disk."""
        chosen, log = self._images(kept=True)
        if log.left_out:
            every_s = self.options.glance_s
            source = self._source(chosen)
            self._add_notices(Notice("images-left-out", source=source, left_out=log.left_out, every_s=every_s))
        return log.images()

    def camera(self) -> Camera:
        """The camera of these images by its CameraInfo messages."""
        chosen = self._choose("images", ros.IMAGE, ros.COMPRESSED_IMAGE, wanted=self.options.topic)
        name = info_topic(chosen.name, [topic.name for topic in self._found() if topic.type == ros.CAMERA_INFO])
        why = "no CameraInfo messages"
        if name is not None:
            info = self._choose("the camera's intrinsics", ros.CAMERA_INFO, wanted=name)
            try:
                return next(self._read(info, lambda content, _: camera_of_info(content, chosen.name)))
            except ValueError as error:
                why = f"{name} does not serve, because {error}"
        raise InputError("no-intrinsics", chosen=self._source(chosen), why=why)

    def inspect(self) -> Inspection:
        """Read the whole first bag and report what it contains."""
        if len(self.paths) > 1:
            return type(self)(self.paths[:1], self.options).inspect()
        topics = self._found()
        first_s, last_s = min(t.first_ns for t in topics) * 1e-9, max(t.last_ns for t in topics) * 1e-9
        facts: dict[str, Any] = {
            "messages": sum(topic.messages for topic in topics),
            "first": iso_utc(first_s),
            "last": iso_utc(last_s),
            "span_s": round(last_s - first_s, 3),
            "topics": {
                topic.name: {
                    "type": topic.type,
                    "messages": topic.messages,
                    "first": iso_utc(topic.first_ns * 1e-9),
                    "last": iso_utc(topic.last_ns * 1e-9),
                }
                for topic in topics
            },
        }
        clocks = [ClockReading(Clock.RECORDER, first_s, last_s, "times of reception by the recorder")]
        looks = [("imu", self._imu_facts), ("scans", self._scan_facts), ("positions", self._position_facts)]
        if any(topic.type in (ros.QUATERNION, ros.DJI_ATTITUDE) for topic in topics):
            looks.append(("attitudes", self._attitude_facts))
        if any(topic.type in (ros.IMAGE, ros.COMPRESSED_IMAGE) for topic in topics):
            looks.append(("images", self._image_facts))
        for name, look_into in looks:
            try:
                found, clock = look_into()
            except InputError as error:
                facts[name] = "none"
                if error.code != "bag-nothing-usable":
                    self._add_notices(Notice.from_error(error))
            else:
                facts[name] = found
                clocks.append(clock)
        return Inspection(self.paths[0], self.format, self.title, facts, tuple(clocks), tuple(self.notices))

    def _found(self) -> list[_Topic]:
        """All topics, from one pass over all messages."""
        if self._topics is None:
            files = BagFiles(self.paths)
            found: dict[tuple[str, str], _Topic] = {}
            for message in files.messages():
                now = message.received_ns
                topic = found.setdefault(
                    (message.topic, message.type), _Topic(message.topic, message.type, 0, now, now)
                )
                topic.messages += 1
                topic.first_ns, topic.last_ns = min(topic.first_ns, now), max(topic.last_ns, now)
            self._add_notices(*files.notices)
            if not found:
                why = " ".join(notice.text for notice in files.notices)
                raise InputError("bag-empty", paths=self.paths[0], why=why or None)
            self._topics = list(found.values())
        return self._topics

    def _choose(self, what: str, *kinds: str, wanted: str | None = None) -> _Topic:
        """The topic to read for `what`: `wanted`, else of the first recorded type the one with the most messages.

        An autopilot's topics come after those of other devices, which are recorded because they are more accurate.
        """
        found = [topic for topic in self._found() if topic.type in kinds and wanted in (None, topic.name)]
        if not found:
            there = ", ".join(f"{topic.name} ({topic.type})" for topic in self._found()[:8])
            raise InputError(
                "bag-nothing-usable",
                paths=self.paths[0],
                wanted=wanted or None,
                what=what,
                there=there,
                kinds=" or ".join(kinds),
            )
        chosen, *others = sorted(found, key=lambda t: (t.is_dji, kinds.index(t.type), -t.messages, t.name))
        if others:
            rest = ", ".join(f"{topic.name} ({topic.messages})" for topic in others)
            source = self._source(chosen)
            self._add_notices(Notice("bag-topic-chosen", source=source, messages=chosen.messages, what=what, rest=rest))
        return chosen

    def _decoder(self, chosen: _Topic) -> PacketScans | OusterMessages | CloudScans | LineScans:
        source = self._source(chosen)
        if chosen.type not in ros.PACKET_SCANS:
            return LineScans(source) if chosen.type == ros.LASER_SCAN else CloudScans(source)
        from furrowmap.core.readers.rosbag.packets import OusterMessages, PacketScans

        if ros.PACKET_SCANS[chosen.type] == "Ouster":
            texts = [topic for topic in self._found() if topic.type == ros.TEXT and "metadata" in topic.name]
            own = chosen.name.rpartition("/")[0]
            texts = [topic for topic in texts if topic.name.rpartition("/")[0] == own] or texts
            told = [(topic.name, next(self._read(topic, lambda content, _: str(content.data)))) for topic in texts]
            return OusterMessages(self.paths[0], told, self.options)
        return PacketScans(source, self.paths[0], chosen.type, self.options)

    def _scans(self, chosen: _Topic, decoder: PacketScans | OusterMessages | CloudScans | LineScans) -> Iterator[Scan]:
        first_s, last_s = float("inf"), float("-inf")

        def batches() -> Iterator[list[Scan]]:
            yield from self._read(chosen, decoder.push)
            yield decoder.finish()

        for scans in batches():
            self.clock = decoder.clock
            for scan in scans:
                first_s, last_s = min(first_s, float(scan.t_s[0])), max(last_s, float(scan.t_s[-1]))
                yield scan
        self.clocks = (ClockReading(self.clock, first_s, last_s, _POINT_TIMES),) if first_s <= last_s else ()
        self._add_notices(*decoder.notices())

    def _positions(self) -> tuple[GnssTrack, _Topic, FixLog | SentenceLog]:
        """The positions, their topic, and its messages."""
        from furrowmap.core.readers.facts import jump_notices

        chosen = self._choose("positions", ros.SENTENCE, ros.NAV_SAT_FIX, ros.DJI_POSITION, wanted=self.options.topic)
        log: FixLog | SentenceLog
        if chosen.type == ros.SENTENCE:
            log = self._collect(chosen, SentenceLog())
            positions = log.positions(self._source(chosen), self.options.date)
            track, fault = positions.track, positions.fault
            if fault is None:
                self._add_notices(*positions.notices)
            else:
                if self.options.topic is not None or all(topic.type != ros.NAV_SAT_FIX for topic in self._found()):
                    raise fault
                self._add_notices(Notice("bag-sentences-unused", value=fault.what.rstrip(".")))
                chosen = self._choose("positions", ros.NAV_SAT_FIX)
        if chosen.type != ros.SENTENCE:
            log = self._collect(chosen, FixLog())
            track, notices = log.track(self._source(chosen))
            self._add_notices(*notices)
            if chosen.is_dji or chosen.type == ros.DJI_POSITION:
                self._add_notices(Notice("positions-of-autopilot", source=self._source(chosen)))
        track, _, dropped = drop_implausible_positions(track)
        self._add_notices(*dropped, *jump_notices(track))
        return track, chosen, log

    def _inertial(self) -> tuple[InertialTrack, _Topic, ImuLog]:
        chosen = self._choose("inertial measurements", ros.IMU, wanted=self.options.topic)
        log = self._collect(chosen, ImuLog())
        notices: list[Notice] = []
        track = log.track(self._source(chosen), notices)
        self._add_notices(*notices)
        return track, chosen, log

    def _attitudes(self) -> tuple[AttitudeTrack, _Topic, AttitudeLog]:
        chosen = self._choose("attitudes", ros.IMU, ros.QUATERNION, ros.DJI_ATTITUDE, wanted=self.options.topic)
        log = self._collect(chosen, AttitudeLog())
        notices: list[Notice] = []
        true_north = chosen.is_dji or chosen.type == ros.DJI_ATTITUDE
        track = log.attitude(self._source(chosen), notices, true_north=true_north)
        self._add_notices(*notices)
        return track, chosen, log

    def _images(self, *, kept: bool) -> tuple[_Topic, ImageLog]:
        chosen = self._choose("images", ros.IMAGE, ros.COMPRESSED_IMAGE, wanted=self.options.topic)
        return chosen, self._collect(chosen, ImageLog(self.options.glance_s or 0.0, kept=kept))

    def _collect(self, chosen: _Topic, log: Log) -> Log:
        """The log, with all messages of the topic."""
        for _ in self._read(chosen, log.add):
            pass
        return log

    def _read(self, chosen: _Topic, take: Callable[[Any, BagMessage], T]) -> Iterator[T]:
        """`take` applied to each message of a topic; those that cannot be decoded are skipped and counted."""
        files = BagFiles(self.paths)
        taken = damaged = 0
        first = ""
        for message in files.messages({chosen.name}):
            self.share_read = files.share_read
            if message.type != chosen.type:
                continue
            try:
                result = take(deserialize(message), message)
            except Damage as damage:
                damaged += 1
                first = first or f"{damage}, received {iso_utc(message.received_ns * 1e-9)}"
            else:
                taken += 1
                yield result
        self.share_read = files.share_read
        if not taken:
            raise InputError("bag-undecodable", chosen=self._source(chosen), damaged=damaged, first=first)
        if damaged:
            source = self._source(chosen)
            self._add_notices(Notice("bag-messages-damaged", source=source, damaged=damaged, first=first))

    def _scan_facts(self) -> tuple[dict[str, Any], ClockReading]:
        chosen = self._choose("laser scans", *_SCAN_TYPES, wanted=self.options.source)
        decoder = self._decoder(chosen)
        scans = points = 0
        first_s, last_s = float("inf"), float("-inf")
        for scan in self._scans(chosen, decoder):
            scans += 1
            points += len(scan)
            first_s, last_s = min(first_s, float(scan.t_s[0])), max(last_s, float(scan.t_s[-1]))
        facts = {"topic": chosen.name, "scans": scans, "points": points} | decoder.facts()
        sensors = [topic.name for topic in self._found() if topic.type == chosen.type]
        if len(sensors) > 1:
            facts["sensors"] = sensors
        return facts, ClockReading(self.clock, first_s, last_s, _POINT_TIMES)

    def _imu_facts(self) -> tuple[dict[str, Any], ClockReading]:
        from furrowmap.core.readers.inertial_rows import imu_notices, inertial_facts

        track, chosen, log = self._inertial()
        self._add_notices(*imu_notices(track))
        facts = {"topic": chosen.name, "frame_id": log.frame_id, **inertial_facts(track), "oriented": log.oriented()}
        note = f"time stamps of the ros.IMU by its driver; received {log.delay_s():.3f} s later (median)"
        return facts, ClockReading(Clock.RECORDER, float(track.t_s[0]), float(track.t_s[-1]), note)

    def _attitude_facts(self) -> tuple[dict[str, Any], ClockReading]:
        from furrowmap.core.readers.inertial_rows import attitude_facts

        track, chosen, log = self._attitudes()
        note = f"time stamps of the attitudes by their driver; received {log.delay_s():.3f} s later (median)"
        clock = ClockReading(Clock.RECORDER, float(track.t_s[0]), float(track.t_s[-1]), note)
        return {"topic": chosen.name, **attitude_facts(track)}, clock

    def _position_facts(self) -> tuple[dict[str, Any], ClockReading]:
        from furrowmap.core.readers.facts import position_facts, timing_facts

        track, chosen, log = self._positions()
        facts = {"topic": chosen.name, "epochs": len(track)} | timing_facts(track.t_s) | position_facts(track)
        stamps = (
            "times in the sentences" if chosen.type == ros.SENTENCE else "time stamps of the positions by their driver"
        )
        note = f"{stamps}; received {log.delay_s():.3f} s later (median)"
        return facts, ClockReading(Clock.GNSS, float(track.t_s[0]), float(track.t_s[-1]), note)

    def _image_facts(self) -> tuple[dict[str, Any], ClockReading]:
        from furrowmap.core.readers.facts import timing_facts

        chosen, log = self._images(kept=False)
        facts: dict[str, Any] = {"topic": chosen.name, "images": len(log), "encoding": log.encoding, "size": log.size}
        try:
            camera = self.camera()
        except InputError:
            facts["intrinsics"] = "none"
        else:
            names = (*PINHOLE, *DISTORTION)
            facts["intrinsics"] = {name: round(getattr(camera, name), 6) for name in names}
            facts["size"] = facts["size"] or f"{camera.width} × {camera.height}"
        note = f"time stamps of the images by their driver; received {log.delay_s():.3f} s later (median)"
        return facts | timing_facts(log.t_s), ClockReading(Clock.RECORDER, float(log.t_s[0]), float(log.t_s[-1]), note)

    def _source(self, topic: _Topic) -> str:
        return f"{self.paths[0]}, {topic.name}"

    def _add_notices(self, *notices: Notice) -> None:
        """Add those that are new: a bag may be inspected, and read for positions and for scans."""
        self.notices += [notice for notice in notices if notice not in self.notices]


class RosBag1(_RosBag):
    """A ROS 1 bag (.bag), with or without an index, complete or truncated."""

    format: ClassVar[str] = "rosbag1"
    title: ClassVar[str] = "ROS 1 bag"

    @classmethod
    def recognise(cls, head: Head) -> float:
        """Certain by the first bytes."""
        return 1.0 if head.data.startswith(ROSBAG1_MAGIC) else 0.0


class RosBag2(_RosBag):
    """A ROS 2 bag: its folder, or one of its files (.db3, .mcap)."""

    format: ClassVar[str] = "rosbag2"
    title: ClassVar[str] = "ROS 2 bag (folder, .db3 or .mcap)"

    @classmethod
    def recognise(cls, head: Head) -> float:
        """Certain by the first bytes (of an SQLite file: by its tables) or by the files in a folder."""
        if head.path.is_dir():
            return 0.9 if (head.path / METADATA).is_file() or storage_files(head.path) else 0.0
        if head.data.startswith(MCAP_MAGIC):
            return 1.0
        if head.data.startswith(SQLITE_MAGIC):
            return 1.0 if all(word in head.data for word in (b"messages", b"topics", b"topic_id")) else 0.0
        return 0.0
