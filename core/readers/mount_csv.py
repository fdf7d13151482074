"""Attitude of a moving mount in CSV."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from furrowmap.core.readers.csv_header import columns_of
from furrowmap.core.readers.csv_numbers import complete_rows, pieces
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.source import Source
from furrowmap.core.readers.time_scale import utc_of
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.foreign_content import binary_kind
from furrowmap.core.values.mount_motion import MountMotion

TIMES: Final = {"time_unix_s": "unix", "time_gps_s": "gps"}
ANGLES: Final = ("roll_deg", "pitch_deg", "yaw_deg")
LARGEST_DEG: Final = 720.0


def read_mount(path: Path, near_s: float, notices: list[Notice]) -> MountMotion:
    """The motion of a mount from the columns `time_unix_s` (or `time_gps_s`), `roll_deg`, `pitch_deg`, `yaw_deg`.

    Args:
        near_s: a time of the recording, for times that count from the start of a week.
        notices: those about the file are added.

    Raises:
        InputError: if columns are missing, a field is no number, or the times do not increase.
    """
    with Source(path) as source:
        lines = pieces(source, notices)
        first = next(lines, b"")
        if (kind := binary_kind(first)) is not None:
            raise InputError("not-a-table.read-mount", path=path, kind=kind, angles=", ".join(ANGLES))
        names, separator = columns_of(first.decode("utf-8", "replace"))
        time = next((name for name in TIMES if name in names), None)
        missing = [name for name in (time or "time_unix_s", *ANGLES) if name not in names]
        if time is None or missing:
            raise InputError(
                "missing-column.read-mount", path=path, missing=", ".join(missing), angles=", ".join(ANGLES)
            )
        rows = complete_rows(source, lines, (names, separator), (time, *ANGLES), notices)
    t_s = utc_of(rows[:, 0], TIMES[time], str(path), ReadOptions(near_s=near_s)) if len(rows) else rows[:, 0]
    if len(rows) < 2 or not bool(np.all(np.diff(t_s) > 0)):
        raise InputError("time-disorder.read-mount", path=path, rows=len(rows))
    if float(np.abs(rows[:, 1:]).max()) > LARGEST_DEG:
        raise InputError("value-out-of-range.read-mount", path=path, rows=float(np.abs(rows[:, 1:]).max()))
    turned = Rotation.from_euler("ZYX", rows[:, :0:-1], degrees=True)
    return MountMotion(t_s, turned.as_quat(scalar_first=True))
