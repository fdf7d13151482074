"""Attitude of a moving mount in CSV."""

from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from furrowmap.core.readers.csv_file import TIME_COLUMN, Column, CsvFile
from furrowmap.core.readers.epochs import utc_of
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.values.pose_track import MountMotion

MOUNT_SCHEMA: Final = (
    TIME_COLUMN,
    *(Column({name: 1.0}, (-720.0, 720.0)) for name in ("roll_deg", "pitch_deg", "yaw_deg")),
)


def read_mount(path: Path, near_s: float) -> tuple[MountMotion, list[Notice]]:
    """The motion of a mount from the columns `time_unix_s` (or `time_gps_s`), `roll_deg`, `pitch_deg`, `yaw_deg`.

    `near_s` is a time of the recording, for times that count from the start of a week. InputError if columns are
    missing, a field is no number, or the times do not increase.
    """
    with CsvFile(path) as file:
        rows = file.rows(MOUNT_SCHEMA, "missing-column.of-mount")
    t_s = utc_of(rows[:, 0], file.time_scale, str(path), ReadOptions(near_s=near_s))
    if len(rows) < 2 or not bool(np.all(np.diff(t_s) > 0)):
        raise InputError("time-disorder.mount-rows", path=path, rows=len(rows))
    turned = Rotation.from_euler("ZYX", rows[:, :0:-1], degrees=True)
    return MountMotion(t_s, turned.as_quat(scalar_first=True)), file.notices
