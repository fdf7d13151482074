"""ROS bags: laser scans from packets or point clouds, GNSS positions, inertial measurements, and images."""

import mmap
import re
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path, PurePath
from typing import Any, ClassVar, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.epochs import timing_facts
from furrowmap.core.readers.facts import jump_notices, position_facts
from furrowmap.core.readers.hesai.captures import HESAI
from furrowmap.core.readers.image_pixels import MAX_PIXELS, layout_fault
from furrowmap.core.readers.implausible_positions import drop_implausible_positions
from furrowmap.core.readers.inertial_rows import attitude_facts, imu_notices, inertial_facts, inspected_track
from furrowmap.core.readers.ouster.captures import looks_like_data, sensors_of
from furrowmap.core.readers.ouster.metadata import Metadata, metadata_beside
from furrowmap.core.readers.ouster.packets import OusterDecoder
from furrowmap.core.readers.pcap import Datagrams
from furrowmap.core.readers.reader import FileReader, Inspection, ReadOptions
from furrowmap.core.readers.rosbag import ros_messages as ros
from furrowmap.core.readers.rosbag.bag_storage import (
    MCAP_MAGIC,
    ROSBAG1_MAGIC,
    SQLITE_MAGIC,
    BagMessage,
    BagStorage,
    Damage,
    Db3Storage,
    McapStorage,
    Rosbag1Storage,
    decompress_message,
)
from furrowmap.core.readers.rosbag.cloud_messages import CloudScans, LineScans
from furrowmap.core.readers.rosbag.topic_content import (
    LOOKED_INTO,
    MESSAGES_LOOKED_AT,
    SCAN_TYPES,
    TopicContent,
    is_second_scanner,
)
from furrowmap.core.readers.source import Head, look
from furrowmap.core.readers.spinning.packet_decoder import PacketDecoder
from furrowmap.core.readers.spinning.scanner_model import AngleTable, ByteArray
from furrowmap.core.readers.velodyne.captures import VELODYNE
from furrowmap.core.runtime.arrays import scratch_file
from furrowmap.core.runtime.errors import InputError, MissingExtraError, Notice
from furrowmap.core.runtime.file_names import is_file_name
from furrowmap.core.runtime.iteration import close, concluded
from furrowmap.core.runtime.languages.texts import Text, Words, reason
from furrowmap.core.runtime.memory import expect_growth
from furrowmap.core.runtime.plain_reads import read_plain_text
from furrowmap.core.runtime.write_errors import writing_scratch
from furrowmap.core.values.camera import DISTORTION, PINHOLE, Camera
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.images import Images, RawLayout, StoredImage
from furrowmap.core.values.inertial import InertialTrack, StatedUnits
from furrowmap.core.values.pose_track import AttitudeTrack
from furrowmap.core.values.scan import Clock, ClockReading, Scan

_SUFFIXES: Final = {b"\xff\xd8\xff": ".jpg", b"\x89PNG": ".png"}
"""By the first bytes of the formats of CompressedImage that are read."""
_EARLY_S: Final = 1e-3
"""Frames of a camera may come this much earlier than its rate states."""
_COMPRESSED_TOPIC: Final = re.compile(r"/compressed$")


class ImageLog:
    """Images collected from the messages of one topic, those nearer than `every_s` to the one before left out."""

    def __init__(self, every_s: float, *, kept: bool) -> None:
        self._every_s = every_s
        self._kept = kept
        self._file = scratch_file() if kept else None
        self._rows: list[tuple[str, int, int, RawLayout | None]] = []
        self._times: list[tuple[float, float]] = []
        self.encoding = ""
        self.size = ""
        self.left_out = 0

    def add(self, content: Any, message: BagMessage) -> None:
        """Add one message; Damage if its encoding is not supported, or its bytes are not such an image."""
        at_s = ros.stamp_s(content, message)
        if self._times and 0.0 <= at_s - self._times[-1][0] < self._every_s - _EARLY_S:
            self.left_out += 1
            return
        data = np.asarray(content.data, np.uint8).tobytes()
        layout = None
        suffix = ".raw"
        if hasattr(content, "encoding"):
            step = int(content.step)
            big_endian = bool(content.is_bigendian)
            layout = RawLayout(int(content.width), int(content.height), step, str(content.encoding), big_endian)
            fault = layout_fault(layout, len(data))
            if fault or layout.width * layout.height > MAX_PIXELS:
                raise Damage(
                    fault or Text("it has {width} × {height} pixels", width=layout.width, height=layout.height)
                )
        else:
            suffix = next((suffix for start, suffix in _SUFFIXES.items() if data.startswith(start)), "")
            stated = str(content.format)
            if not suffix or stated.startswith("bayer") or "Depth" in stated:
                raise Damage(Text("the format {stated!r} is not supported (supported: JPEG, PNG)", stated=stated[:40]))
        if not self._times:
            self.encoding = layout.encoding if layout is not None else str(content.format)
            self.size = f"{layout.width} × {layout.height}" if layout is not None else ""
        begin = self._rows[-1][2] if self._rows else 0
        if self._file is not None:
            with writing_scratch():
                self._file.write(data)
        name = f"{message.topic.strip('/').replace('/', '_')}_{at_s:.6f}{suffix}"
        self._rows.append((name, begin, begin + len(data), layout))
        self._times.append((at_s, message.received_ns * 1e-9))

    def __len__(self) -> int:
        return len(self._times)

    @property
    def t_s(self) -> NDArray[np.float64]:
        """Stamps (n,), sorted."""
        return np.sort(np.array([stamp for stamp, _ in self._times], np.float64))

    def delay_s(self) -> float:
        """Median of reception minus stamp."""
        return float(np.median([received - stamp for stamp, received in self._times]))

    def images(self) -> Images:
        """All images in the order of their stamps."""
        assert self._file is not None
        self._file.flush()
        with self._file as file:
            mapped = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
        stored = [StoredImage(name, mapped[begin:end], layout) for name, begin, end, layout in self._rows]
        return Images.sorted(stored, np.array([stamp for stamp, _ in self._times], np.float64))


def camera_of_info(content: Any, topic: str) -> Camera:
    """The camera of a CameraInfo message: K and D, or P for a topic of rectified images.

    ValueError if the message is of a camera that is not calibrated or not supported.
    """
    k, d, p = (np.asarray(getattr(content, n, getattr(content, n.upper(), None)), np.float64).ravel() for n in "kdp")
    if max(content.binning_x, content.binning_y) > 1 or content.roi.x_offset or content.roi.y_offset:
        raise ValueError(Text("it states binning or a region of interest"))
    if "rect" in _COMPRESSED_TOPIC.sub("", topic).rpartition("/")[2]:
        k = p[[0, 1, 2, 4, 5, 6, 8, 9, 10]]
        d = np.zeros(0)
    if not (np.isfinite(k).all() and k[0] > 0.0 and k[4] > 0.0):
        raise ValueError(Text("its matrix K is 0: the camera is not calibrated"))
    known = content.distortion_model in ("plumb_bob", "rational_polynomial", "")
    if d.any() and (not known or np.any(d[5:]) or len(d) < 4):
        raise ValueError(
            Text(
                "its distortion model {model!r} is none with k1, k2, p1, p2 and k3",
                model=content.distortion_model[:30],
            )
        )
    k1, k2, p1, p2, k3 = (float(value) for value in np.pad(d, (0, 5))[:5])
    fx, fy, cx, cy = (float(k[at]) for at in (0, 4, 2, 5))
    return Camera(int(content.width), int(content.height), fx, fy, cx, cy, k1, k2, k3, p1, p2)


_BATCH_PACKETS: Final = 1000
_MAKERS: Final = {maker.name: maker for maker in (VELODYNE, HESAI)}


class _PacketMessages(ABC):
    """Decodes the messages of one topic into scans, many packets together."""

    def __init__(self) -> None:
        self._held: list[tuple[ByteArray, float]] = []

    @abstractmethod
    def _packets(self, content: Any, message: BagMessage) -> Iterator[tuple[ByteArray, float]]:
        """The packets of a message, and when the recorder or the driver received each."""

    @abstractmethod
    def _decode(self, packets: Datagrams) -> list[Scan]:
        """The scans that packets complete."""

    def push(self, content: Any, message: BagMessage) -> list[Scan]:
        """The scans that this message completes."""
        self._held += self._packets(content, message)
        return self._decode_held() if len(self._held) >= _BATCH_PACKETS else []

    def _decode_held(self) -> list[Scan]:
        if not self._held:
            return []
        payloads = [payload for payload, _ in self._held]
        length = np.array([len(payload) for payload in payloads])
        host_s = np.array([at_s for _, at_s in self._held])
        self._held = []
        senders = np.zeros(len(length), np.uint64)
        return self._decode(Datagrams(np.concatenate(payloads), np.cumsum(length) - length, length, host_s, senders))


class PacketScans(_PacketMessages):
    """Packets of spinning scanners in a bag, beside which a calibration may be; options are `model` and `near_s`."""

    def __init__(self, source: str, path: Path, kind: str, options: ReadOptions) -> None:
        super().__init__()
        maker = _MAKERS[ros.PACKET_SCANS[kind]]
        angles = AngleTable.beside([path]) if maker.calibrated else None
        self._maker = maker
        self._decoder = PacketDecoder(maker, options.model, angles=angles, where=source, near_s=options.near_s)

    def _packets(self, content: Any, message: BagMessage) -> Iterator[tuple[ByteArray, float]]:
        at_s = ros.stamp_s(content, message)
        for packet in content.packets:
            data = np.asarray(packet.data, np.uint8)
            yield data[: packet.size] if hasattr(packet, "size") else data, ros.seconds(packet.stamp) or at_s

    def _decode(self, packets: Datagrams) -> list[Scan]:
        product = self._maker.products(packets.data, packets.offset, packets.length)
        return self._decoder.push_at(packets.data, packets.offset, product, packets.time_s)

    def finish(self) -> list[Scan]:
        """The scans that are still open."""
        return self._decode_held() + self._decoder.finish()

    @property
    def clock(self) -> Clock:
        """The clock that the times come from; known with the first scan."""
        return self._decoder.kind

    def facts(self) -> dict[str, Any]:
        """What `inspect` reports."""
        counts = self._decoder.counts
        model = self._decoder.model
        return {
            "model": model.name if model else None,
            **self._decoder.angles,
            "return_modes": {self._maker.mode_name(mode): n for mode, n in counts.modes.items()},
            "packets": counts.packets,
            "rpm": round(counts.rpm, 1),
        }

    def notices(self) -> list[Notice]:
        """What is unusual; complete after `finish`."""
        return self._decoder.notices()


class OusterMessages(_PacketMessages):
    """Messages of single packets of an Ouster.

    `texts` are name and text of messages of the bag that may be the sensor's metadata; without any, they are sought in
    the folder of the bag. Of the options, `model` is used.
    """

    def __init__(self, path: Path, texts: Sequence[tuple[str, str]], options: ReadOptions) -> None:
        super().__init__()
        self._path = path
        self._texts = texts
        self._options = options
        self._decoder: OusterDecoder | None = None
        self._length = 0
        self._uncertain: list[Notice] = []

    def _packets(self, content: Any, message: BagMessage) -> Iterator[tuple[ByteArray, float]]:
        yield np.asarray(content.buf, np.uint8), message.received_ns * 1e-9

    def _decode(self, packets: Datagrams) -> list[Scan]:
        if self._decoder is None:
            self._decoder = self._started(packets)
        mine = packets.length == self._length
        return self._decoder.push(packets.data, packets.offset[mine], packets.time_s[mine])

    def finish(self) -> list[Scan]:
        """The scans that are still open."""
        return self._decode_held() + (self._decoder.finish() if self._decoder else [])

    def _started(self, packets: Datagrams) -> OusterDecoder:
        """The decoder with the metadata of the sensor that sends these packets."""
        found = looks_like_data(packets)
        if not found:
            raise InputError(
                "no-packets", paths=self._path, frames=Text("{count:,} other messages", count=len(packets))
            )
        told = list[Metadata]()
        faults = list[str]()
        for name, text in self._texts:
            try:
                metadata = Metadata.parse(text, f"{self._path.name} {name}")
            except ValueError as error:
                faults.append(f"{name}: {error}")
            else:
                told += [metadata] if metadata else []
        beside = (told, faults) if told else metadata_beside(self._path)
        sensors, self._uncertain = sensors_of(self._path, found, beside, self._options.model)
        self._length = sensors[0].sender.length
        return OusterDecoder(sensors[0].metadata)

    @property
    def clock(self) -> Clock:
        """The clock that the times come from; known with the first scan."""
        return self._decoder.clock if self._decoder else Clock.RECORDER

    def facts(self) -> dict[str, Any]:
        """What `inspect` reports."""
        return self._decoder.facts() if self._decoder else {}

    def notices(self) -> list[Notice]:
        """What is unusual; complete after `finish`."""
        return [*self._uncertain, *(self._decoder.notices() if self._decoder else [])]


METADATA: Final = "metadata.yaml"

_STORAGE_NAME: Final = re.compile(r".+\.(db3|mcap)(\.(zstd|zst|gz|xz))?", re.IGNORECASE)
# Recorders write metadata.yaml in one form, indented by two spaces; only these two entries are needed. A YAML parser
# would take minutes for a hostile file with a few thousand brackets.
_FILES: Final = re.compile(r"^ {2}relative_file_paths: *\n((?: *- .+\n)+)", re.MULTILINE)
_MESSAGES: Final = re.compile(r"^ {2}message_count: (\d{1,18}) *$", re.MULTILINE)


class BagFiles:
    """The files of a recording in the order of time, also of folders of ROS 2 bags; InputError if a folder has none.

    Notices of files that are missing or damaged are complete when the messages have ended.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self.notices: list[Notice] = []
        self._declared = 0
        self._files = [file for path in paths for file in self._files_of(path)]
        self._sizes = [file.stat().st_size for file in self._files]
        self._behind = 0
        self._open: BagStorage | None = None

    @property
    def size_bytes(self) -> int:
        """Of all files."""
        return sum(self._sizes)

    @property
    def share_read(self) -> float:
        """How much has been read, 0 to 1."""
        now = self._sizes[self._behind] * self._open.share_read if self._open else 0.0
        return (sum(self._sizes[: self._behind]) + now) / max(sum(self._sizes), 1)

    def messages(self, topics: Collection[str] | None = None) -> Iterator[BagMessage]:
        """The messages (of some topics) of all files, each file's in order.

        InputError if the only file cannot be read.
        """
        total = 0
        for behind, file in enumerate(self._files):
            self._behind = behind
            try:
                storage = self._open = _open_storage(file)
                count = 0
                for message in storage.messages(topics):
                    count += 1
                    yield message
            except InputError as error:
                if len(self._files) == 1:
                    raise
                self.notices.append(Notice.from_error(error))
                continue
            self.notices += storage.notices
            total += count
            if topics is None and storage.declared not in (None, count):
                self.notices.append(Notice("bag-count.by-index", file=file, count=count, declared=storage.declared))
        if topics is None and self._declared and total != self._declared:
            self.notices.append(Notice("bag-count", total=total, declared=self._declared))

    def _files_of(self, path: Path) -> list[Path]:
        """The file itself; of a folder, the files named in its metadata, else those with the names of bag files."""
        if not path.is_dir():
            return [path]
        names = self._names_in_metadata(path / METADATA)
        missing = [name for name in names if not (is_file_name(name) and (path / name).is_file())]
        if missing:
            self.notices.append(Notice("bag-file-missing", path=path, missing=", ".join(missing)))
        files = [path / name for name in names if name not in missing] or storage_files(path)
        if not files:
            raise InputError("bag-folder-empty", path=path)
        return files

    def _names_in_metadata(self, file: Path) -> list[str]:
        """The files that metadata.yaml names; none, with a notice, if it is missing or damaged."""
        try:
            text = read_plain_text(file, errors="replace")
        except OSError as error:
            self.notices.append(Notice("bag-no-metadata", file=file, reason=error.strerror))
            return []
        files = _FILES.search(text)
        messages = _MESSAGES.search(text)
        if files is None or messages is None:
            self.notices.append(Notice("bag-metadata-damaged", file=file))
            return []
        self._declared += int(messages[1])
        # Folders in the names are ignored, so that nothing outside the bag is read.
        return [PurePath(line.strip().removeprefix("- ").strip("\"'")).name for line in files[1].splitlines()]


def storage_files(folder: Path) -> list[Path]:
    """Files in a folder with the names of ROS 2 bag files, in the order of their numbers."""
    return sorted(
        (file for file in folder.iterdir() if _STORAGE_NAME.fullmatch(file.name) and file.is_file()),
        key=lambda file: [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", file.name)],
    )


def _open_storage(path: Path) -> BagStorage:
    """The file's storage, by its content."""
    data = look(path).data
    for magic, storage in ((ROSBAG1_MAGIC, Rosbag1Storage), (MCAP_MAGIC, McapStorage), (SQLITE_MAGIC, Db3Storage)):
        if data.startswith(magic):
            return storage(path)
    raise InputError("bag-unknown-storage", path=path)


T = TypeVar("T")
Log = TypeVar("Log", ros.FixLog, ros.SentenceLog, ros.ImuLog, ros.AttitudeLog, ImageLog)
_DJI_NODES: Final = frozenset({"dji_sdk", "dji_osdk_ros"})
_POINT_TIMES: Final = "time stamps of the points, the clock of the scans"


@dataclass
class _Topic:
    """The messages of one name and type."""

    name: str
    type: str
    messages: int
    first_ns: int
    last_ns: int
    content: TopicContent = field(default_factory=TopicContent)
    """Of topics with the type of a scanner or an IMU."""

    @property
    def is_dji(self) -> bool:
        """Whether it is of the autopilot, by DJI's node."""
        return not _DJI_NODES.isdisjoint(self.name.split("/"))


def _preference(topic: _Topic, kinds: Sequence[str]) -> tuple[object, ...]:
    """To sort topics by for one of these types: first one that is to be read."""
    without_data, *content = topic.content.rank
    return topic.is_dji, without_data, kinds.index(topic.type), *content, -topic.messages, topic.name


class _RosBag(FileReader):
    """What bags of ROS 1 and ROS 2 have in common.

    Reading takes two passes over the messages: one to list the topics, because a bag's index may be missing or wrong,
    and one for the messages of the chosen topic.
    """

    def __init__(self, paths: Sequence[Path], options: ReadOptions) -> None:
        super().__init__(paths, options)
        if find_spec("rosbags") is None or find_spec("lz4") is None:
            raise MissingExtraError(
                Text("{packages:or}", packages=("rosbags", "lz4")),
                "bags",
                Text("{path} is a ROS bag, which is read by it.", path=self.paths[0]),
            )
        self.clock = Clock.RECORDER
        self.clocks: tuple[ClockReading, ...] = ()
        self.share_read = 0.0
        self._topics: list[_Topic] | None = None

    def scans(self) -> Iterator[Scan]:
        """The scans of the topic that `options` name, else of that with the most packets, point clouds, or sweeps."""
        chosen = self._choose("laser scans", *SCAN_TYPES, wanted=self.options.source)
        yield from self._scans(chosen, self._decoder(chosen))

    def track(self) -> GnssTrack:
        """The positions of the topic that `options` name, else in NMEA sentences, else in NavSatFix messages.

        Those of a DJI autopilot are read if there are no others.
        """
        return self._positions()[0]

    def inertial(self) -> InertialTrack:
        """The measurements of the topic that `options` name, else of that with the most Imu messages."""
        return self._inertial(*self._imu_messages(), self.options.units)

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
        infos = [topic.name for topic in self._found() if topic.type == ros.CAMERA_INFO]
        # Beside the images (image_transport), else the only one.
        beside = f"{_COMPRESSED_TOPIC.sub('', chosen.name).rpartition('/')[0]}/camera_info"
        name = beside if beside in infos else infos[0] if len(infos) == 1 else None
        why = Text("no CameraInfo messages")
        if name is not None:
            info = self._choose("the camera's intrinsics", ros.CAMERA_INFO, wanted=name)
            try:
                return next(self._read(info, lambda content, _: camera_of_info(content, chosen.name)))
            except ValueError as error:
                why = Text("{name} does not serve, because {why}", name=name, why=error)
        raise InputError("no-intrinsics", chosen=self._source(chosen), why=why)

    def inspect(self) -> Inspection:
        """Read the whole first bag and report what it contains."""
        if len(self.paths) > 1:
            return type(self)(self.paths[:1], self.options).inspect()
        topics = self._found()
        first_s = min(t.first_ns for t in topics) * 1e-9
        last_s = max(t.last_ns for t in topics) * 1e-9
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
                if topic.messages <= MESSAGES_LOOKED_AT and topic.type in LOOKED_INTO:
                    topic.content.look(message)
            self._add_notices(*files.notices)
            if not found:
                why = " ".join(notice.text for notice in files.notices)
                raise InputError("bag-empty", paths=self.paths[0], why=why or None)
            self._topics = list(found.values())
        return self._topics

    def _choose(self, what: str, *kinds: str, wanted: str | None = None) -> _Topic:
        """The topic to read for `what`: `wanted`, else of the first recorded type the one with the most messages.

        Of types of scanners and IMUs it is the one that holds most of their data. An autopilot's topics come after
        those of other devices, which are recorded because they are more accurate.
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
        chosen, *others = sorted(found, key=lambda t: _preference(t, kinds))
        if others:
            rest = ", ".join(f"{topic.name} ({topic.messages})" for topic in others)
            source = self._source(chosen)
            self._add_notices(Notice("bag-topic-chosen", source=source, messages=chosen.messages, what=what, rest=rest))
        return chosen

    def _decoder(self, chosen: _Topic) -> PacketScans | OusterMessages | CloudScans | LineScans:
        source = self._source(chosen)
        if chosen.type not in ros.PACKET_SCANS:
            return LineScans(source) if chosen.type == ros.LASER_SCAN else CloudScans(source)
        if ros.PACKET_SCANS[chosen.type] == "Ouster":
            texts = [topic for topic in self._found() if topic.type == ros.TEXT and "metadata" in topic.name]
            own = chosen.name.rpartition("/")[0]
            texts = [topic for topic in texts if topic.name.rpartition("/")[0] == own] or texts
            told = [(topic.name, next(self._read(topic, lambda content, _: str(content.data)))) for topic in texts]
            return OusterMessages(self.paths[0], told, self.options)
        return PacketScans(source, self.paths[0], chosen.type, self.options)

    def _scans(self, chosen: _Topic, decoder: PacketScans | OusterMessages | CloudScans | LineScans) -> Iterator[Scan]:
        first_s, last_s = float("inf"), float("-inf")

        messages = self._read(chosen, decoder.push)

        def batches() -> Iterator[list[Scan]]:
            yield from messages
            yield decoder.finish()

        def decoded() -> Iterator[Scan]:
            nonlocal first_s, last_s
            for scans in batches():
                self.clock = decoder.clock
                for scan in scans:
                    first_s = min(first_s, float(scan.t_s[0]))
                    last_s = max(last_s, float(scan.t_s[-1]))
                    yield scan

        def conclude() -> None:
            close(messages)
            decoder.finish()  # of scans that nobody takes: the counts are complete
            self.clocks = (ClockReading(self.clock, first_s, last_s, _POINT_TIMES),) if first_s <= last_s else ()
            self._add_notices(*decoder.notices())

        yield from concluded(decoded(), conclude)

    def _positions(self) -> tuple[GnssTrack, _Topic, ros.FixLog | ros.SentenceLog]:
        """The positions, their topic, and its messages."""
        chosen = self._choose("positions", ros.SENTENCE, ros.NAV_SAT_FIX, ros.DJI_POSITION, wanted=self.options.topic)
        log: ros.FixLog | ros.SentenceLog
        if chosen.type == ros.SENTENCE:
            log = self._collect(chosen, ros.SentenceLog())
            positions = log.positions(self._source(chosen), self.options.date)
            track = positions.track
            fault = positions.fault
            if fault is None:
                self._add_notices(*positions.notices)
            else:
                if self.options.topic is not None or all(topic.type != ros.NAV_SAT_FIX for topic in self._found()):
                    raise fault
                self._add_notices(Notice("bag-sentences-unused", value=fault.words("what")))
                chosen = self._choose("positions", ros.NAV_SAT_FIX)
        if chosen.type != ros.SENTENCE:
            log = self._collect(chosen, ros.FixLog())
            track, notices = log.track(self._source(chosen))
            self._add_notices(*notices)
            if chosen.is_dji or chosen.type == ros.DJI_POSITION:
                self._add_notices(Notice("positions-of-autopilot", source=self._source(chosen)))
        track, _, dropped = drop_implausible_positions(track)
        self._add_notices(*dropped, *jump_notices(track))
        return track, chosen, log

    def _imu_messages(self) -> tuple[_Topic, ros.ImuLog]:
        chosen = self._choose("inertial measurements", ros.IMU, wanted=self.options.topic)
        return chosen, self._collect(chosen, ros.ImuLog())

    def _inertial(self, chosen: _Topic, log: ros.ImuLog, units: StatedUnits) -> InertialTrack:
        track, late = log.track(self._source(chosen), units)
        self._add_notices(*late)
        return track

    def _attitudes(self) -> tuple[AttitudeTrack, _Topic, ros.AttitudeLog]:
        chosen = self._choose("attitudes", ros.IMU, ros.QUATERNION, ros.DJI_ATTITUDE, wanted=self.options.topic)
        log = self._collect(chosen, ros.AttitudeLog())
        true_north = chosen.is_dji or chosen.type == ros.DJI_ATTITUDE
        track, late = log.attitude(self._source(chosen), true_north=true_north)
        self._add_notices(*late)
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
        taken = 0
        damaged = 0
        unpacked = 0
        first: Words = ""
        lacking: Counter[str] = Counter()

        def decoded() -> Iterator[T]:
            nonlocal taken, damaged, unpacked, first
            for message in files.messages({chosen.name}):
                self.share_read = files.share_read
                if message.type != chosen.type:
                    continue
                try:
                    content = decompress_message(message.data) if message.encoding == "cdr" else message.data
                    unpacked += len(content)
                    expect_growth(self.paths[0], files.size_bytes, unpacked)
                    result = take(ros.deserialize(message._replace(data=content)), message)
                except Damage as damage:
                    damaged += 1
                    first = first or Text(
                        "{damage}, received {time}",
                        damage=reason(damage),
                        time=iso_utc(message.received_ns * 1e-09),
                    )
                except ros.NotMeasured as statement:
                    lacking[str(statement)] += 1
                else:
                    taken += 1
                    yield result

        def conclude() -> None:
            self.share_read = files.share_read
            source = self._source(chosen)
            if lacking:
                quantity, count = lacking.most_common(1)[0]
                key = "bag-not-measured.in_part" if taken else "bag-not-measured"
                about = {"chosen": source, "no_rate": quantity == ros.RATE, "count": count}
                if not taken:
                    raise InputError(key, **about)
                self._add_notices(Notice(key, **about))
            if not taken:
                raise InputError("bag-undecodable", chosen=source, damaged=damaged, first=first)
            if damaged:
                self._add_notices(Notice("bag-messages-damaged", source=source, damaged=damaged, first=first))

        yield from concluded(decoded(), conclude)

    def _scan_facts(self) -> tuple[dict[str, Any], ClockReading]:
        chosen = self._choose("laser scans", *SCAN_TYPES, wanted=self.options.source)
        decoder = self._decoder(chosen)
        sizes = [len(scan) for scan in self._scans(chosen, decoder)]
        facts = {"topic": chosen.name, "scans": len(sizes), "points": sum(sizes)} | decoder.facts()
        sensors = [
            topic.name
            for topic in self._found()
            if topic is chosen or (topic.type == chosen.type and is_second_scanner(topic.content, chosen.content))
        ]
        if len(sensors) > 1:
            facts["sensors"] = sensors
        nothing = ClockReading(self.clock, float("inf"), float("-inf"), _POINT_TIMES)
        return facts, next(iter(self.clocks), nothing)

    def _imu_facts(self) -> tuple[dict[str, Any], ClockReading]:
        chosen, log = self._imu_messages()
        track = inspected_track(lambda units: self._inertial(chosen, log, units), self.options.units)
        self._add_notices(*imu_notices(track))
        facts = {"topic": chosen.name, "frame_id": log.frame_id, **inertial_facts(track), "oriented": log.oriented()}
        note = f"time stamps of the ros.IMU by its driver; received {log.delay_s():.3f} s later (median)"
        return facts, ClockReading(Clock.RECORDER, float(track.t_s[0]), float(track.t_s[-1]), note)

    def _attitude_facts(self) -> tuple[dict[str, Any], ClockReading]:
        track, chosen, log = self._attitudes()
        note = f"time stamps of the attitudes by their driver; received {log.delay_s():.3f} s later (median)"
        clock = ClockReading(Clock.RECORDER, float(track.t_s[0]), float(track.t_s[-1]), note)
        return {"topic": chosen.name, **attitude_facts(track)}, clock

    def _position_facts(self) -> tuple[dict[str, Any], ClockReading]:
        track, chosen, log = self._positions()
        facts = {"topic": chosen.name, "epochs": len(track)} | timing_facts(track.t_s) | position_facts(track)
        stamps = (
            "times in the sentences" if chosen.type == ros.SENTENCE else "time stamps of the positions by their driver"
        )
        note = f"{stamps}; received {log.delay_s():.3f} s later (median)"
        return facts, ClockReading(Clock.GNSS, float(track.t_s[0]), float(track.t_s[-1]), note)

    def _image_facts(self) -> tuple[dict[str, Any], ClockReading]:
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


class RosBag1(_RosBag):
    """A ROS 1 bag (.bag), with or without an index, complete or truncated."""

    format: ClassVar[str] = "rosbag1"
    title: ClassVar[Text] = Text("ROS 1 bag")

    @classmethod
    def recognise(cls, head: Head) -> float:
        """Certain by the first bytes."""
        return 1.0 if head.data.startswith(ROSBAG1_MAGIC) else 0.0


class RosBag2(_RosBag):
    """A ROS 2 bag: its folder, or one of its files (.db3, .mcap)."""

    format: ClassVar[str] = "rosbag2"
    title: ClassVar[Text] = Text("ROS 2 bag (folder, .db3 or .mcap)")

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
