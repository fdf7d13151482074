"""An open session: its paths resolved once, its map frame, and the readers of its files."""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec

from furrowmap.core.geodesy.projection import MapFrame, map_frame
from furrowmap.core.readers.agopengps import is_field_folder
from furrowmap.core.readers.antex import antenna_model
from furrowmap.core.readers.imu_csv import ImuCsv
from furrowmap.core.readers.isoxml.content import is_task_data
from furrowmap.core.readers.reader import (
    GivesAttitude,
    GivesBeams,
    GivesImages,
    GivesInertial,
    GivesPoses,
    GivesScans,
    GivesTrack,
    Reader,
    ReadOptions,
    open_recording,
)
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.file_names import leads_out, resolved
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.session.session_camera import camera_of, camera_table, images_of, mounted
from furrowmap.core.session.session_file import load_session
from furrowmap.core.values.camera import Camera
from furrowmap.core.values.images import Images, joined
from furrowmap.core.values.inertial import StatedUnits
from furrowmap.core.values.parcel import SOIL_METHODS
from furrowmap.core.values.scan import ClockReading, Scan
from furrowmap.core.values.session import Session
from furrowmap.core.values.time_span import WHOLE_SPAN, Span, scans_within

R = TypeVar("R", bound=Reader)

_GIVES: Final[dict[type[Reader], str]] = {
    GivesScans: "laser scans",
    GivesTrack: "positions",
    GivesPoses: "trajectory",
    GivesInertial: "inertial measurements",
    GivesAttitude: "attitudes",
    GivesImages: "images",
}


@dataclass(frozen=True)
class ToolInputs:
    """The files of one implement: its states, and what was learned of it in an earlier session."""

    states: tuple[Path, ...] = ()
    learned: Path | None = None


@dataclass(frozen=True, kw_only=True)
class Inputs:
    """The files that a session names, resolved: each exists and lies inside the session's folder.

    `positions` are GNSS logs, or the files of an external trajectory, in time order.
    """

    lidar: tuple[Path, ...]
    further_lidars: tuple[tuple[Path, ...], ...]
    positions: tuple[Path, ...]
    inertial: tuple[Path, ...]
    attitude: tuple[Path, ...]
    camera: tuple[Path, ...]
    mount: Path | None
    boundary: Path | None
    images: Path | None
    parcels: Path | None
    treatments: Path | None
    soil: Path | None
    tools: tuple[ToolInputs, ...]
    control_points: Path | None
    control_pixels: Path | None
    parameters: Path | None
    geoid_grid: Path | None
    within: Path | None
    check_points: Path | None
    ground_control: Path | None
    antex: Path | None

    @classmethod
    def find(cls, session_file: Path, session: Session) -> "Inputs":
        """The files that a session names. Raises InputError if one is missing, or outside the session's folder."""

        def one(name: str | None) -> Path | None:
            return resolve(session_file, name) if name is not None else None

        def several(names: tuple[str, ...]) -> tuple[Path, ...]:
            return tuple(resolve(session_file, name) for name in names)

        stated = session.trajectory
        attitude = session.attitude
        parcels = session.parcels
        camera = session.camera
        return cls(
            lidar=several(session.recording.lidar),
            further_lidars=tuple(several(lidar.files) for lidar in session.lidars[1:]),
            positions=several(stated.files if stated is not None else session.recording.gnss),
            inertial=several(session.imu.files if session.imu is not None else ()),
            attitude=several((attitude.roll_pitch, attitude.heading) if attitude is not None else ()),
            mount=one(session.mount.attitude if session.mount is not None else None),
            boundary=one(session.field.boundary),
            within=one(session.field.within),
            check_points=one(session.field.check_points),
            ground_control=one(session.field.control_points),
            antex=one(session.antenna.antex if session.antenna is not None else None),
            images=camera_table(session_file, camera),
            camera=several(camera.files if camera is not None and camera.topic is not None else ()),
            control_points=one(camera.control_points if camera is not None else None),
            control_pixels=one(camera.control_pixels if camera is not None else None),
            parcels=one(parcels.file if parcels is not None else None),
            treatments=one(parcels.treatments if parcels is not None else None),
            soil=one(parcels.soil if parcels is not None and parcels.soil not in SOIL_METHODS else None),
            tools=tuple(ToolInputs(several(tool.states), one(tool.learned)) for tool in session.implements),
            parameters=one(session.crs.parameters),
            geoid_grid=one(session.crs.geoid_grid),
        )

    @property
    def all(self) -> tuple[Path, ...]:
        """Every file once, laser scanner recordings first, in the order in which the session names them."""
        return tuple(dict.fromkeys(_paths(*vars(self).values())))


def _paths(*named: Any) -> Iterator[Path]:
    """The paths in values, and in tuples and tools among them."""
    for value in named:
        if isinstance(value, Path):
            yield value
        elif value is not None:
            yield from _paths(*(value if isinstance(value, tuple) else (value.states, value.learned)))


class LidarRecording:
    """The laser scans of a session in its span, with times by the clock of its positions.

    `[recording] lidar_minus_gnss_s` is subtracted here and nowhere else. The recording may be read several times.
    """

    def __init__(self, reader: GivesScans, minus_gnss_s: float, span_s: Span = WHOLE_SPAN) -> None:
        self._reader = reader
        self._minus_gnss_s = minus_gnss_s
        self._span_s = span_s

    def scans(self) -> Iterator[Scan]:
        """All scans in time order; `notices` and `clocks` are complete when they have ended."""
        return scans_within(self._reader.scans(), self._span_s, self._minus_gnss_s)

    def ahead_by(self, offset_s: float) -> "LidarRecording":
        """The recording of a clock that is ahead by so much more."""
        return LidarRecording(self._reader, self._minus_gnss_s + offset_s, self._span_s) if offset_s else self

    def beam_elevations(self) -> Mapping[str, FloatArray]:
        """Elevations (lasers,) in degrees of the model in use, and then of others that the packets may be of.

        Lowest first; empty before the first scan, and where the packets are of one model alone.
        """
        return self._reader.beam_elevations() if isinstance(self._reader, GivesBeams) else {}

    @property
    def notices(self) -> list[Notice]:
        """Warnings about the files."""
        return self._reader.notices

    @property
    def clocks(self) -> tuple[ClockReading, ...]:
        """First and last reading of each clock in the recording, as recorded; the clock in use first."""
        return self._reader.clocks

    @property
    def share_read(self) -> float:
        """Share of the files read so far, 0 to 1."""
        return self._reader.share_read


@dataclass(frozen=True)
class OpenSession:
    """A session whose files have been found."""

    file: Path
    session: Session
    inputs: Inputs
    frame: MapFrame

    def within(self, polygons: Path) -> "OpenSession":
        """The session with other polygons of the ground to map, which may lie anywhere."""
        try:
            name = Path(os.path.relpath(resolved(polygons), resolved(self.file).parent)).as_posix()
        except ValueError:  # on another drive of Windows
            name = resolved(polygons).as_posix()
        field = msgspec.structs.replace(self.session.field, within=name)
        session = msgspec.structs.replace(self.session, field=field)
        return replace(self, session=session, inputs=replace(self.inputs, within=resolved(polygons)))

    def positions(self) -> Reader:
        """A reader of the GNSS positions, or of the external trajectory; InputError if a file does not give them."""
        recording = self.session.recording
        stated = self.session.trajectory
        options = ReadOptions(
            date=recording.date,
            time=stated.time if stated is not None else None,
            week=stated.week if stated is not None else None,
            task=recording.task,
            topic=recording.gnss_topic,
        )
        if stated is not None:
            return _open(self.inputs.positions, options, GivesPoses, "trajectory.files")
        return _open(self.inputs.positions, options, GivesTrack, "recording.gnss")

    def inertial(self, near_s: float) -> GivesInertial:
        """A reader of the IMU; `near_s` is a time of the recording, for times from the start of a week."""
        table = self.session.imu
        assert table is not None
        columns = {name: (column.quantity, column.unit, column.scale) for name, column in table.columns.items()}
        units = StatedUnits(table.rate_unit, table.force_unit, table.rate_scale, table.force_scale)
        options = ReadOptions(near_s=near_s, topic=table.topic, columns=columns, units=units)
        if columns:
            return ImuCsv(self.inputs.inertial, options)
        return _open(self.inputs.inertial, options, GivesInertial, "imu.files")

    def attitude(self, near_s: float) -> tuple[GivesAttitude, GivesAttitude]:
        """Readers of roll and pitch, and of the heading; `near_s` as for :meth:`inertial`."""
        table = self.session.attitude
        assert table is not None
        stated = {"attitude.roll_pitch": table.roll_pitch_topic, "attitude.heading": table.heading_topic}
        level, heading = (
            _open([path], ReadOptions(near_s=near_s, topic=topic), GivesAttitude, key)
            for path, (key, topic) in zip(self.inputs.attitude, stated.items(), strict=True)
        )
        return level, heading

    def images(self) -> tuple[Images, list[Notice]]:
        """The images, by the clock of the positions, and notices. Raises InputError if a file cannot be read."""
        camera = self.session.camera
        assert camera is not None
        files, notices = images_of(self.file, camera)
        if camera.topic is None:
            return files, notices
        images, warnings = self._recorded
        return joined([files, images.earlier_by(camera.minus_gnss_s)]), notices + warnings

    def camera(self) -> Camera:
        """The camera: as stated, else as recorded. Raises InputError if neither has its intrinsics."""
        camera = self.session.camera
        assert camera is not None
        if camera.has_intrinsics:
            return camera_of(camera)
        if camera.topic is None:
            raise InputError("no-camera.no-intrinsics", file=self.file)
        return mounted(self._image_reader().camera(), camera)

    @cached_property
    def _recorded(self) -> tuple[Images, list[Notice]]:
        """The images of a recording, read once: their bytes stay in a scratch file."""
        reader = self._image_reader()
        return reader.images(), reader.notices

    def _image_reader(self) -> GivesImages:
        camera = self.session.camera
        assert camera is not None
        options = ReadOptions(topic=camera.topic, glance_s=camera.every_s or None)
        return _open(self.inputs.camera, options, GivesImages, "camera.files")

    def lidar(self, near_s: float, glance_s: float | None = None, number: int = 0) -> LidarRecording:
        """The laser scans of a scanner, by its number; one in `glance_s` is enough.

        `near_s` is a time of the drive by the clock of the positions, for scanner clocks that show only part of a time.
        """
        lidar = self.session.lidars[number]
        minus_gnss_s = lidar.minus_gnss_s or 0.0
        paths = (self.inputs.lidar, *self.inputs.further_lidars)[number]
        options = ReadOptions(model=lidar.model, source=lidar.source, near_s=near_s + minus_gnss_s, glance_s=glance_s)
        reader = _open(paths, options, GivesScans, "lidar.files" if number else "recording.lidar")
        return LidarRecording(reader, minus_gnss_s, self.session.recording.span_s)


def open_session(session_file: Path) -> OpenSession:
    """The session in a file, with the files it names found and its map frame.

    InputError if the session file or a file that it names cannot be used, RefusedError if the map frame is ambiguous.
    """
    session = load_session(session_file)
    inputs = Inputs.find(session_file, session)
    session = with_phase_centre(session, inputs.antex)
    return OpenSession(session_file, session, inputs, map_frame(session.crs, inputs.parameters, inputs.geoid_grid))


def with_phase_centre(session: Session, antex: Path | None) -> Session:
    """The session with the phase centre of its antenna as the lever arm; unchanged without a model.

    Only the offset upwards is used: how the mark of an antenna is turned in the vehicle is not known, and the others
    are a millimetre or two.

    Raises:
        InputError: if the file is no ANTEX, or has no such antenna.
    """
    antenna = session.antenna
    if antenna is None or antenna.model is None or antex is None:
        return session
    up_m = antenna_model(antex, antenna.model).phase_centre_m(ionosphere_free=antenna.phase == "ionosphere-free")[2]
    x, y, z = antenna.xyz_m
    place = (x, y, round(z + float(up_m), 5))
    return msgspec.structs.replace(
        session, antenna=msgspec.structs.replace(antenna, xyz_m=place, model=None, antex=None)
    )


def watched(scans: Iterator[Scan], recording: LidarRecording, progress: Progress, stage: str) -> Iterator[Scan]:
    """The scans; reports to `progress` how much of the recording has been read."""
    for scan in scans:
        yield scan
        progress(stage, recording.share_read)
    progress(stage, 1.0)


def _open(paths: Sequence[Path], options: ReadOptions, kind: type[R], key: str) -> R:
    """A reader of files; raises InputError if they do not hold what the session names them for."""
    reader = open_recording(paths, options)
    if not isinstance(reader, kind):
        raise InputError("wrong-kind-of-file", path=paths[0], title=reader.title, gives=_GIVES[kind], key=key)
    return reader


def resolve(session_file: Path, named: str) -> Path:
    """The path of a file that a session names, relative to the session file and inside its folder.

    A folder is accepted if it is a ROS 2 bag, a field of AgOpenGPS or holds task data. Raises InputError for what is
    outside, or missing.
    """
    folder = resolved(session_file).parent
    try:
        path = resolved(folder / named)
        inside = list(path.iterdir()) if path.is_dir() else []
        is_bag = any(file.name == "metadata.yaml" or not {".db3", ".mcap"}.isdisjoint(file.suffixes) for file in inside)
        is_whole = bool(inside) and (is_bag or is_field_folder(path) or is_task_data(path))
        if is_whole:
            inside += [file for below in inside if below.is_dir() for file in below.iterdir()]
        is_outside = any(leads_out(place, folder) for place in (path, *(inside if is_whole else ())))
        is_file = path.is_file()
        is_folder = path.is_dir()
    except (OSError, ValueError) as error:
        raise InputError(
            "session-file-missing.invalid-name", session_file=session_file, named=named, error=error
        ) from None
    if is_outside:
        raise InputError("session-path-outside.by-name", session_file=session_file, named=named)
    if not is_file and not is_whole:
        raise InputError("session-file-missing", session_file=session_file, named=named, is_folder=bool(is_folder))
    return path
