"""Logs of NovAtel's OEM receivers and Unicore's: positions, and the trajectory of an inertial system (SPAN)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.facts import pose_facts
from furrowmap.core.readers.messages import MessageCounts, Messages, at_equal
from furrowmap.core.readers.novatel.messages import KIND_NUMBERS, LAYOUTS, SOL_COMPUTED, read_messages, scan_bytes
from furrowmap.core.readers.poses.file import RawPoses
from furrowmap.core.readers.position_log import LoggedPositions, PositionLog, byte_place
from furrowmap.core.readers.reader import Inspection, recording_name
from furrowmap.core.readers.receiver_log import MIN_INTACT_SHARE, dated_positions, has_position, log_facts
from furrowmap.core.readers.source import Head
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.clock import gps_to_utc_s
from furrowmap.core.values.gnss import Fix
from furrowmap.core.values.pose_track import PoseTrack

POSITIONS: Final = ("BESTPOS", "BESTNAV", "PVTSLN", "INSPVAX", "INSPVA", "INSPVAS")
"""Messages with positions: the first of them that a log has is read."""
POSES: Final = ("INSPVAX", "INSPVA", "INSPVAS")
HEADINGS: Final = ("HEADING2", "HEADING", "UNIHEADING")
_INS_GOOD: Final = (3, 6, 7)
"""Statuses of an inertial solution that is aligned: good, free, alignment complete."""
_FIX_KINDS: Final = {
    Fix.SINGLE: ("SINGLE", "INS_PSRSP", "OPERATIONAL", "WARNING", "OUT_OF_BOUNDS"),
    Fix.DGPS: ("PSRDIFF", "WAAS", "INS_SBAS", "INS_PSRDIFF"),
    Fix.FIXED: ("L1_INT", "WIDE_INT", "NARROW_INT", "INS_RTKFIXED"),
    Fix.FLOAT: ("L1_FLOAT", "IONOFREE_FLOAT", "NARROW_FLOAT", "RTK_DIRECT_INS", "INS_RTKFLOAT"),
    Fix.ESTIMATED: ("PROPAGATED",),
    Fix.MANUAL: ("FIXEDPOS", "FIXEDHEIGHT"),
    Fix.PPP: tuple(word for word in KIND_NUMBERS if "PPP" in word),
}
NOVATEL_FIXES: Final = {KIND_NUMBERS[word]: fix for fix, words in _FIX_KINDS.items() for word in words}
"""Fix by the number of the type of position; all others are none."""
_FIX_BY_KIND: Final = np.array([NOVATEL_FIXES.get(kind, Fix.NONE) for kind in range(256)], np.int8)
_KIND_WORDS: Final = {number: word for word, number in reversed(KIND_NUMBERS.items())}
_SBAS: Final = (KIND_NUMBERS["WAAS"], KIND_NUMBERS["INS_SBAS"])


class NovatelLog(PositionLog):
    """The positions and poses in a log of NovAtel's or Unicore's messages, in ASCII or binary.

    BESTPOS makes the epoch, or the first of :data:`POSITIONS` that the log has. BESTVEL and the heading of two antennas
    (HEADING2, HEADING or UNIHEADING, with fixed ambiguities) are joined by equal time stamp. Times are GPS week and
    milliseconds. Heights are altitude + undulation, those of INSPVA above the ellipsoid. INSPVAX, or INSPVA, makes
    poses: those of an aligned inertial system, in the vehicle frame that is configured in the receiver.
    """

    format: ClassVar[str] = "novatel"
    title: ClassVar[str] = "NovAtel or Unicore log"

    @classmethod
    def recognise(cls, head: Head) -> float:
        """By intact messages with positions; possible (0.3) where there are others."""
        counts = MessageCounts[str]()
        found, _ = scan_bytes(head.data, counts, last=True)
        if any(len(found.get(name, ())) for name in POSITIONS):
            return 0.95
        return 0.3 if counts.message_bytes >= MIN_INTACT_SHARE * max(len(head.data), 1) else 0.0

    def poses(self) -> PoseTrack:
        """All poses of all files; InputError if there are none, or too many are out of order."""
        self.notices = []
        messages, _, _ = self._messages(self.paths)
        poses = _raw_poses(messages, recording_name(self.paths))
        if not len(poses.seconds):
            raise InputError("no-poses.inertial", name=self.name)
        return poses.track(self.options, self.notices)

    def inspect(self) -> Inspection:
        """Read the whole first file and report what it contains."""
        found = super().inspect()
        if not any(name in found.facts["messages"] for name in POSES):
            return replace(found, facts=found.facts | {"poses": "none"})
        inspected = NovatelLog(self.paths[:1], self.options)
        try:
            facts = pose_facts(inspected.poses())
        except InputError:
            facts = {"poses": "none"}
        return replace(found, facts=found.facts | facts)

    def _messages(self, paths: list[Path]) -> tuple[dict[str, Messages], MessageCounts[str], list[int]]:
        """The messages by name, their counts, and where each file ends in the stream of all."""
        counts, ends = MessageCounts[str](), list[int]()
        parts: dict[str, list[Messages]] = {name: [] for name in LAYOUTS}
        for source in self._sources(paths):
            for name, pieces in read_messages(source, counts).items():
                parts[name] += pieces
            ends.append(counts.stream_bytes)
        return {name: Messages.joined(pieces, LAYOUTS[name].read) for name, pieces in parts.items()}, counts, ends

    def _read(self, paths: list[Path]) -> LoggedPositions:
        messages, counts, ends = self._messages(paths)
        name = recording_name(paths)
        facts = log_facts(counts, "messages", str, name, self.notices)
        of = next((of for of in POSITIONS if len(messages[of])), None)
        if of is None:
            kinds = ", ".join(kind for kind, _ in counts.kinds.most_common(4))
            fault = InputError("no-positions.novatel", name=name, frames=kinds or None)
            return replace(LoggedPositions.none(name, fault), facts=facts)
        base = messages[of]
        columns, kind = _columns(of, base, messages)
        numbers, times = (found.tolist() for found in np.unique(kind, return_counts=True))
        words = [_KIND_WORDS.get(number, f"type {number}") for number in numbers]
        facts |= {"positions_from": of, "solutions": dict(zip(words, times, strict=True))}
        gps_s = base.column("gps_ms", 1e-3)
        columns["t_s"] = np.where(gps_s >= 0.0, gps_to_utc_s(gps_s), np.nan)
        return dated_positions(
            columns, base.at, byte_place(paths, ends), name=name, what=f"{of} messages", facts=facts,
            service=_service(kind[has_position(columns)]),
        )  # fmt: skip


def _columns(
    of: str, base: Messages, messages: Mapping[str, Messages]
) -> tuple[dict[str, NDArray[Any]], NDArray[np.int64]]:
    """The columns (n,) of the positions in messages named `of`, and the numbers (n,) of their types of position."""
    values = base.values
    names = values.dtype.names or ()
    nothing = np.full(len(base), np.nan)
    field = {name: base.column(name) for name in names}
    kind = values["kind"].astype(np.int64) if "kind" in names else np.full(len(base), KIND_NUMBERS["PROPAGATED"])
    fix = _FIX_BY_KIND[np.minimum(kind, 255)]
    if "status" in names:
        fix = np.where(np.isin(values["status"], _INS_GOOD if of in POSES else SOL_COMPUTED), fix, Fix.NONE)
    if "vn" in names:
        speed = np.hypot(field["ve"], field["vn"])
        course = np.degrees(np.arctan2(field["ve"], field["vn"]))
    elif of == "BESTNAV":
        computed = values["velocity_status"] == SOL_COMPUTED
        speed, course = (np.where(computed, field[name], np.nan) for name in ("speed", "course"))
    else:
        other = messages["BESTVEL"]
        other = other[other.values["status"] == SOL_COMPUTED]
        speed, course = (_at_equal(base, other, name) for name in ("speed", "course"))
    if "heading" in names:
        heading = np.where(_FIX_BY_KIND[np.minimum(values["heading_kind"], 255)] == Fix.FIXED, field["heading"], np.nan)
    else:
        other = next((messages[name] for name in HEADINGS if len(messages[name])), messages["HEADING2"])
        fixed = _FIX_BY_KIND[np.minimum(other.values["kind"], 255)] == Fix.FIXED
        heading = _at_equal(base, other[fixed & (other.values["status"] == SOL_COMPUTED)], "heading")
    satellites = field.get("satellites", nothing)
    on_earth = (np.abs(field["lat"]) <= 90.0) & (np.abs(field["lon"]) <= 360.0)
    columns: dict[str, NDArray[Any]] = {
        "lon_deg": np.where(on_earth, field["lon"], np.nan),
        "lat_deg": np.where(on_earth, field["lat"], np.nan),
        "height_m": field["height"] + field.get("undulation", 0.0),
        "fix": fix,
        "speed_mps": speed,
        "course_deg": course % 360.0,
        "heading_deg": heading % 360.0,
        "satellites": np.where((satellites >= 0) & (satellites < 255), satellites, -1).astype(np.int16),
        "age_s": field.get("age", nothing),
    }
    sigmas = {f"sigma_{axis}_m": _positive(field.get(f"sigma_{axis}", nothing)) for axis in "enh"}
    return columns | sigmas, kind


def _at_equal(base: Messages, other: Messages, name: str) -> FloatArray:
    """A field (n,) of other messages with the times of `base`; nan elsewhere."""
    known = other[other.values["gps_ms"] >= 0]
    return at_equal(base.values["gps_ms"], known.values["gps_ms"], known.column(name))


def _positive(sigma: FloatArray) -> FloatArray:
    """Standard deviations (n,); nan for 0, which means unknown."""
    return np.where(sigma > 0.0, sigma, np.nan)


def _service(kind: NDArray[np.int64]) -> str:
    """The correction service of most positions, by their types."""
    if 2 * np.sum(np.isin(kind, _SBAS)) > len(kind):
        return "sbas"
    return "ppp" if 2 * np.sum(_FIX_BY_KIND[np.minimum(kind, 255)] == Fix.PPP) > len(kind) else ""


def _raw_poses(messages: Mapping[str, Messages], name: str) -> RawPoses:
    """The poses of an aligned inertial system."""
    of = next((of for of in POSES if len(messages[of])), POSES[0])
    poses = messages[of]
    usable = np.isin(poses.values["status"], _INS_GOOD) & (poses.values["gps_ms"] >= 0)
    field = {column: poses.column(column) for column in poses.values.dtype.names or ()}
    nothing = np.full(len(poses), np.nan)
    height = field["height"] + field.get("undulation", 0.0)
    values = np.column_stack([field["lon"], field["lat"], height, field["roll"], field["pitch"], field["azimuth"]])
    axes = ("e", "n", "h", "roll", "pitch", "azimuth")
    sigmas = np.column_stack([_positive(field.get(f"sigma_{axis}", nothing)) for axis in axes])
    usable &= np.isfinite(values).all(axis=1) & (np.abs(values[:, :2]) <= (360.0, 90.0)).all(axis=1)
    return RawPoses(
        seconds=field["gps_ms"][usable] * 1e-3,
        scale="gps",
        scale_note="GPS time of its messages",
        values=np.hstack([values, sigmas])[usable],
        projected=False,
        true_north=True,
        name=name,
    )
