"""Reading recordings as the commands do, to the end."""

from __future__ import annotations

import json
from collections import deque
from pathlib import Path

import numpy as np

from furrowmap.cli.session_commands import _inspection_value, _inspection_words
from furrowmap.core.readers.las.cloud import open_cloud
from furrowmap.core.readers.reader import (
    GivesAttitude,
    GivesInertial,
    GivesPoses,
    GivesScans,
    GivesStates,
    GivesTrack,
    Reader,
    ReadOptions,
    Recognised,
)
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.json_text import plain

OPTIONS = ReadOptions(date="2026-06-11", week=2422)


def inspect_recording(path: Path) -> None:
    """What `furrowmap inspect` reports of a file, as words and as JSON."""
    inspection = Recognised.by_content(path).inspect(OPTIONS)
    json.dumps(plain(_inspection_value(inspection)), allow_nan=False)
    _inspection_words(inspection)


def read_recording(path: Path) -> None:
    """All that a file gives."""
    read_whole(Recognised.by_content(path).open(OPTIONS))


EACH_WAY = (inspect_recording, read_recording)
OF_THE_FOLDER = tuple(lambda path, way=way: way(path.parent) for way in EACH_WAY)
"""Of recordings that are folders; the path is that of a file in them."""


def read_whole(reader: Reader) -> None:
    """All that a reader gives."""
    gives = [
        (GivesScans, lambda: deque(reader.scans(), maxlen=0)),  # type: ignore[attr-defined]
        (GivesTrack, lambda: reader.track()),  # type: ignore[attr-defined]
        (GivesPoses, lambda: reader.poses()),  # type: ignore[attr-defined]
        (GivesInertial, lambda: reader.inertial()),  # type: ignore[attr-defined]
        (GivesAttitude, lambda: reader.attitude()),  # type: ignore[attr-defined]
        (GivesStates, lambda: reader.states()),  # type: ignore[attr-defined]
    ]
    optional = (
        {GivesInertial, GivesAttitude} if isinstance(reader, GivesScans) else set()
    )  # in bags: entries of their own
    optional |= {GivesAttitude} if isinstance(reader, GivesInertial) else set()  # columns beside those of an IMU
    refused = None
    for kind, give in gives:
        if isinstance(reader, kind) and kind not in optional:
            try:
                give()
            except InputError as error:
                refused = error
    if refused is not None:
        raise refused


def read_cloud(path: Path) -> None:
    """A cloud's points, all of them and those of a box."""
    cloud = open_cloud(path)
    for batch in cloud.batches((0.0, 0.0, 1e6, 1e7), 1.0):
        assert np.isfinite(batch.xyz_m).all()
