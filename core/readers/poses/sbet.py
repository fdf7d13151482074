"""SBET (smoothed best estimate of trajectory), the format of GNSS/INS post-processors."""

from pathlib import Path
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.poses.pose_file import PoseFile, RawPoses
from furrowmap.core.readers.source import Head, Source, cut_notice
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.runtime.memory import expect_rows

SBET_FIELDS: Final = 17
RECORD_BYTES: Final = 8 * SBET_FIELDS
CHUNK_RECORDS: Final = 1 << 16
TIME_FIELD: Final = 0
LAT_FIELD: Final = 1
LON_FIELD: Final = 2
HEIGHT_FIELD: Final = 3
ROLL_FIELD: Final = 7
PITCH_FIELD: Final = 8
HEADING_FIELD: Final = 9
WANDER_FIELD: Final = 10
"""Indices of the fields that are read."""

FIELD_RANGES: Final = {
    TIME_FIELD: (0.0, 1e10), LAT_FIELD: (-np.pi / 2, np.pi / 2), LON_FIELD: (-np.pi, 2 * np.pi),
    HEIGHT_FIELD: (-1e4, 1e6), ROLL_FIELD: (-np.pi, np.pi), PITCH_FIELD: (-np.pi / 2, np.pi / 2),
    HEADING_FIELD: (-2 * np.pi, 4 * np.pi),
    WANDER_FIELD: (-2 * np.pi, 2 * np.pi),
}  # fmt: skip
MAX_SBET_STEP_S: Final = 3600.0
MIN_ANGLE_RAD: Final = 1e-12
"""Radians. Bytes of other formats, read as doubles, are mostly close to 0; no recording is this close to 0° N 0° E."""


class Sbet(PoseFile):
    """Poses from SBET files.

    A record is 17 little-endian doubles: time, latitude, longitude, ellipsoidal height, three velocities, roll, pitch,
    platform heading, wander angle, three accelerations, three angular rates; angles in radians, body axes x forward,
    y right, z down (Applanix POSPac's SBET). The platform heading counts from the wander-azimuth frame: true heading =
    platform heading − wander angle. Times are GPS seconds of the week or since 1980-01-06; with
    ``ReadOptions.time = "utc"`` the same in UTC, which some processors write. Standard deviations are not part of
    SBET and stay unknown.
    """

    format: ClassVar[str] = "sbet"
    title: ClassVar[Text] = Text("trajectory in SBET")

    @classmethod
    def recognise(cls, head: Head) -> float:
        """By its numbers, as SBET has no signature: coordinates and angles within their limits, increasing times."""
        records = _records(head.data)[:200]
        if not len(records) or not np.isfinite(records).all() or not _plausible(records).all():
            return 0.0
        step = np.diff(records[:, TIME_FIELD])
        if np.any(step <= 0) or np.any(step > MAX_SBET_STEP_S):
            return 0.0
        return 0.95 if len(records) > 1 or head.suffix in (".sbet", ".out") else 0.0

    def _read(self, path: Path) -> RawPoses:
        seconds: list[FloatArray] = [np.empty(0)]
        values: list[FloatArray] = [np.empty((0, 12))]
        count = rest = 0
        with Source(path) as source:
            while block := source.read(CHUNK_RECORDS * RECORD_BYTES):
                records = _records(block)
                bad = ~_plausible(records)
                if bad.any():
                    at = (count + int(np.flatnonzero(bad)[0])) * RECORD_BYTES
                    raise InputError("damaged-record", path=path, at=at)
                seconds.append(records[:, TIME_FIELD].copy())
                position = np.column_stack([np.degrees(records[:, (LON_FIELD, LAT_FIELD)]), records[:, HEIGHT_FIELD]])
                heading = records[:, HEADING_FIELD] - records[:, WANDER_FIELD]
                attitude = np.degrees(np.column_stack([records[:, (ROLL_FIELD, PITCH_FIELD)], heading]))
                values.append(np.column_stack([position, attitude, np.full((len(records), 6), np.nan)]))
                count += len(records)
                expect_rows(path, source.size_bytes, count * RECORD_BYTES)
                rest = len(block) % RECORD_BYTES
            fault = source.fault
        if count < 2:
            found = Text(
                "{count} complete records of {record_bytes} bytes, followed by {rest} bytes",
                count=count,
                record_bytes=RECORD_BYTES,
                rest=rest,
            )
            raise InputError("no-poses", path=path, found=found)
        if rest or fault:
            self.notices.append(cut_notice(path, fault or f"after {count} complete records, {rest} bytes of another"))
        note = "assumed to be GPS time, as usual in SBET" if self.options.time is None else "as stated"
        scale = self.options.time or "gps"
        return RawPoses(
            np.concatenate(seconds),
            scale,
            note,
            np.concatenate(values),
            projected=False,
            true_north=True,
            name=str(path),
        )


def _records(data: bytes) -> FloatArray:
    """The complete records (n, 17) at the start of `data`."""
    count = len(data) // RECORD_BYTES
    return np.frombuffer(data, "<f8", count * SBET_FIELDS).reshape(count, SBET_FIELDS)


def _plausible(records: FloatArray) -> NDArray[np.bool_]:
    """Which records (n, 17) can be poses on or above the Earth."""
    good = np.abs(records[:, (LAT_FIELD, LON_FIELD)]).max(axis=1) > MIN_ANGLE_RAD
    for field, (low, high) in FIELD_RANGES.items():
        good &= (records[:, field] >= low) & (records[:, field] <= high)
    return np.asarray(good)
