"""Logs of VectorNav sensors as inertial measurements and attitudes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from furrowmap.core.readers.imu_check import imu_notices
from furrowmap.core.readers.inertial_rows import attitude_track, first_beyond, inertial_facts, inertial_track
from furrowmap.core.readers.messages import MessageCounts, scan_stream
from furrowmap.core.readers.reader import FileReader, Inspection
from furrowmap.core.readers.source import Head, Source, cut_notice
from furrowmap.core.readers.vectornav.binary import ROW_COLUMNS, SYNC, BinaryMessages
from furrowmap.core.readers.vectornav.sentences import MEASURED_FIELDS, AsciiSentences
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.values.clock import gps_to_utc_s
from furrowmap.core.values.clock_readings import ClockReading
from furrowmap.core.values.inertial import InertialTrack
from furrowmap.core.values.pose_track import UNSTATED_NORTH, AttitudeTrack
from furrowmap.core.values.scan import Clock


class _VectorNav(FileReader, ABC):
    """What both forms of logs have in common."""

    format: ClassVar[str]
    title: ClassVar[str]

    @abstractmethod
    def _rows(self) -> FloatArray:
        """Rows (n, 10) of all files, see :data:`ROW_COLUMNS`; nan for what a row does not have."""

    def inertial(self) -> InertialTrack:
        """All measurements, in the axes of the sensor: forward, right, down."""
        rows, name = self._rows(), self.name
        measured = rows[np.isfinite(rows[:, 1:7]).all(axis=1)]
        timed = measured[np.isfinite(measured[:, 0])]
        if len(timed) < 2:
            if len(measured):
                raise InputError("imu-no-times", name=name, measured=len(measured))
            raise InputError("imu-no-measurements", name=name)
        if len(timed) < len(measured):
            self.notices.append(
                Notice(
                    "rows-incomplete.inertial",
                    name=name,
                    measured=len(measured) - len(timed),
                    measured_count=len(measured),
                )
            )
        beyond = first_beyond(timed[:, 1:])
        if beyond is not None:
            raise InputError("value-out-of-range.inertial", name=name, beyond=beyond[0])
        return inertial_track(timed[:, 0], timed[:, 1:7], name, self.notices)

    def attitude(self) -> AttitudeTrack:
        """The attitudes by the device's own filter; it does not say from which north they count."""
        rows = self._rows()
        rows = rows[np.isfinite(rows[:, [0, 7, 8, 9]]).all(axis=1)]
        angles = np.column_stack([rows[:, 9], rows[:, 8], rows[:, 7] % 360.0])
        return attitude_track(rows[:, 0], angles, UNSTATED_NORTH, self.name, self.notices)

    def inspect(self) -> Inspection:
        """Read the whole first file and report rates, span and the mean specific force."""
        reader = type(self)(self.paths[:1], self.options)
        track = reader.inertial()
        clock = ClockReading(Clock.STATED, float(track.t_s[0]), float(track.t_s[-1]), "of the sensor")
        notices = (*reader.notices, *imu_notices(track))
        return Inspection(self.paths[0], self.format, self.title, inertial_facts(track), (clock,), notices)

    def _scan(self, path: Path, counts: MessageCounts[Any], scan: Callable[[bytes, int, bool], int]) -> None:
        """Pass a file to `scan`, and report what is damaged."""
        with Source(path) as source:
            scan_stream(source, counts, scan)
        if source.fault:
            self.notices.append(cut_notice(path, source.fault))
        if counts.bad:
            notice = Notice("sentences-damaged.damaged", paths=self.name, bad=counts.bad, intact=counts.intact)
            self.notices += [notice] if notice not in self.notices else []


class VectorNavBinary(_VectorNav):
    """Binary output messages with GPS time (TimeGps, or GpsTow and GpsWeek), angular rate and specific force."""

    format: ClassVar[str] = "vectornav-binary"
    title: ClassVar[str] = "VectorNav binary messages"

    @classmethod
    def recognise(cls, head: Head) -> float:
        """Certain with intact messages that hold measurements."""
        if bytes((SYNC,)) not in head.data[:8192]:
            return 0.0
        found = BinaryMessages()
        found.scan(head.data)
        if found.counts.intact < 2:
            return 0.0
        return 1.0 if any(layout.is_inertial for layout in found.layouts.values()) else 0.6

    def _rows(self) -> FloatArray:
        parts = [np.empty((0, ROW_COLUMNS))]
        for path in self.paths:
            found = BinaryMessages()
            self._scan(path, found.counts, found.scan)
            outputs = [found.rows(header) for header in found.found]
            # Of several binary outputs, measurements and attitudes of the one with most of them each are used.
            for columns in (slice(1, 7), slice(7, 10)):
                count = [int(np.isfinite(rows[:, [0, columns.start]]).all(axis=1).sum()) for rows in outputs]
                for k, rows in enumerate(outputs):
                    if k != int(np.argmax(count)):
                        rows[:, columns] = np.nan
            parts += outputs
        return np.concatenate(parts)


class VectorNavAscii(_VectorNav):
    """ASCII sentences `VNIMU`, `VNYMR` or `VNMAR`.

    Their times are those that a logger wrote before each, or of `VNINS` or `VNGPS` between them. Between sentences
    with GPS time the others are spread evenly, so both should come at constant rates.
    """

    format: ClassVar[str] = "vectornav-ascii"
    title: ClassVar[str] = "VectorNav ASCII sentences"

    @classmethod
    def recognise(cls, head: Head) -> float:
        """Certain with intact sentences of measurements."""
        if b"$VN" not in head.data:
            return 0.0
        found = AsciiSentences()
        found.scan(head.data)
        if not found.counts.kinds:
            return 0.0
        return 1.0 if any(kind.encode() in MEASURED_FIELDS for kind in found.counts.kinds) else 0.4

    def _rows(self) -> FloatArray:
        parts = [np.empty((0, ROW_COLUMNS))]
        for path in self.paths:
            found = AsciiSentences()
            self._scan(path, found.counts, found.scan)
            table = found.table()
            parts.append(np.column_stack([_times_s(table), table[:, 3:]]))
        return np.concatenate(parts)


def _times_s(table: FloatArray) -> FloatArray:
    """UTC (n,) of sentences (n, 12): as the logger wrote it, else between those with GPS time; else nan."""
    stamped, timed = np.isfinite(table[:, 0]), np.isfinite(table[:, 1])
    measured = np.isfinite(table[:, 3])
    if stamped[measured].any():
        return table[:, 0]
    if timed.sum() < 2:
        return np.full(len(table), np.nan)
    utc_s = gps_to_utc_s(table[timed, 1])
    line = table[timed, 2]
    inside = (table[:, 2] >= line[0]) & (table[:, 2] <= line[-1])
    return np.where(inside, np.interp(table[:, 2], line, utc_s), np.nan)
