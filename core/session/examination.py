"""Examination of recordings, and of their overlap in time."""

import math
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Final

from furrowmap.core.readers.reader import (
    GivesAttitude,
    GivesInertial,
    GivesPoses,
    GivesScans,
    GivesTrack,
    Inspection,
    Reader,
    Recognised,
)
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text, figure_text
from furrowmap.core.values.clock import DAY_S, HOUR_S, iso_utc
from furrowmap.core.values.scan import Clock, ClockReading, likely_offset, overlap_s

_POSSIBLE: Final = 0.5
"""Certainty of a reader that takes any capture, to say what is in it."""
_LONGEST_S: Final = 1e10
"""Centuries: a clock that is off by more shows no time at all."""


@dataclass(frozen=True)
class Examined:
    """A recording that has been read completely."""

    inspection: Inspection
    reader: Reader

    @classmethod
    def read(cls, path: Path) -> "Examined":
        """Read the file at `path` completely. Raises InputError if its format is unknown, or it cannot be read."""
        return next(cls._of_makers(path))

    @classmethod
    def each(cls, path: Path) -> "list[Examined]":
        """As :meth:`read`, once for each maker whose scanner is in a capture and can be read."""
        makers = cls._of_makers(path)
        found = list[Examined]()
        found.append(next(makers))
        with suppress(InputError):
            found += makers
        return found

    @classmethod
    def _of_makers(cls, path: Path) -> "Iterator[Examined]":
        first, *others = Recognised.each_by_content(path)
        known = [first]
        if hasattr(first.reader, "scans"):
            known += [one for one in others if hasattr(one.reader, "scans") and one.certainty > _POSSIBLE]
        for one in known:
            reader = one.open()
            inspection = reader.inspect()
            inspection = replace(inspection, facts=inspection.facts | _tried_on(inspection))
            if len(known) > 1:
                titles = tuple(other.reader.title for other in known if other is not one)
                inspection = replace(inspection, notices=(*inspection.notices, Notice("several-makers", others=titles)))
            yield cls(inspection, reader)

    @property
    def path(self) -> Path:
        """The file."""
        return self.inspection.path

    def gives(self, kind: type[Reader]) -> bool:
        """Whether it holds what readers of a kind give: containers may hold none of it.

        The attitudes beside an IMU's measurements, poses or positions do not count as such.
        """
        if kind is GivesAttitude and isinstance(self.reader, GivesInertial | GivesPoses | GivesTrack):
            return False
        fact = {GivesScans: "scans", GivesTrack: "positions", GivesPoses: "poses", GivesInertial: "imu"}.get(kind, "")
        return isinstance(self.reader, kind) and self.inspection.facts.get(fact) != "none"

    @property
    def scan_clock(self) -> ClockReading | None:
        """The reading of the clock that stamps its scans."""
        if not (self.gives(GivesScans) and isinstance(self.reader, GivesScans)):
            return None
        return next((c for c in reversed(self.inspection.clocks) if c.clock == self.reader.clock), None)

    @property
    def position_clock(self) -> ClockReading | None:
        """The reading of the clock that stamps its positions or poses."""
        if not any(map(self.gives, (GivesTrack, GivesPoses, GivesInertial, GivesAttitude))):
            return None
        return next((c for c in self.inspection.clocks if c.clock in (Clock.GNSS, Clock.STATED)), None)

    @property
    def first_s(self) -> float:
        """When its content begins; infinity without a clock."""
        clock = self.scan_clock or self.position_clock
        return clock.first_s if clock is not None else math.inf


@cache
def devices() -> list[dict[str, Any]]:
    """What each device was tried on, checked against, and what is not read: `core/readers/tried.toml`."""
    text = resources.files("furrowmap.core.readers").joinpath("tried.toml").read_text("utf-8")
    return tomllib.loads(text)["device"]  # type: ignore[no-any-return]


def _tried_on(inspection: Inspection) -> dict[str, str]:
    """What the device of a recording was tried on, for `inspect`."""
    scans = inspection.facts.get("scans")
    model = str((scans if isinstance(scans, dict) else inspection.facts).get("model") or "")
    for device in devices():
        of_model = model and any(model.startswith(name) for name in device.get("models", ()))
        if of_model or (not model and inspection.format in device.get("formats", ())):
            return {"tried_on": f"{device['tried']}; checked against {device['checked']}"}
    return {}


@dataclass(frozen=True)
class TimeMatch:
    """The overlap in time of a LiDAR recording and one with positions; negative: the gap between them.

    `offset_s` is a likely offset, scanner clock minus the other, with which they would overlap.
    """

    scans: Path
    positions: Path
    shared_s: float
    offset_s: float | None
    text: Text


def time_matches(recordings: Sequence[Examined]) -> Iterator[TimeMatch]:
    """The overlap of each LiDAR recording with each recording of positions; files without a clock are left out."""
    for scans in recordings:
        for positions in recordings:
            if scans.scan_clock is not None and positions.position_clock is not None:
                yield _match(scans.path, scans.scan_clock, positions.path, positions.position_clock)


def _match(scans: Path, scanner: ClockReading, positions: Path, other: ClockReading) -> TimeMatch:
    shared_s = overlap_s(scanner, other)
    span_s = scanner.last_s - scanner.first_s
    names = (
        Text("{scans} and {positions}", scans=scans.name, positions=positions.name)
        if scans != positions
        else Text("Scans and positions of {scans}", scans=scans.name)
    )
    offset_s = None
    if shared_s >= 0:
        share = shared_s / span_s if span_s > 0 else None
        text = Text(
            "{names} overlap by {shared_s:.1f} s{share:, {share:.0%} of the scans|}.",
            names=names,
            shared_s=shared_s,
            share=share,
        )
    else:
        likely = likely_offset(scanner, other)
        if likely is None:
            remedy = Text("No common clock offset (hours, leap seconds, days) explains this.")
        else:
            offset_s, cause = likely
            remedy = Text(
                "They would overlap if the scanner clock were {off} {ahead:ahead|behind} ({cause}): "
                "lidar_minus_gnss_s = {offset_s:.1f}.",
                off=_length(abs(offset_s)),
                ahead=offset_s > 0,
                cause=cause,
                offset_s=offset_s,
            )
        text = Text(
            "{names} do not overlap: scans from {scans}, positions from {positions}, {apart} apart. {remedy}",
            names=names,
            scans=_span(scanner),
            positions=_span(other),
            apart=_length(-shared_s),
            remedy=remedy,
        )
    return TimeMatch(scans, positions, shared_s, offset_s, text)


def _span(reading: ClockReading) -> Text:
    return Text("{first} to {last}", first=iso_utc(reading.first_s), last=iso_utc(reading.last_s))


def _length(length_s: float) -> Text:
    """A duration in a readable unit."""
    if length_s < 2 * HOUR_S:
        return figure_text(f"{length_s:.1f} s")
    if length_s > _LONGEST_S:
        return figure_text(f"{length_s:.0e} s")
    return figure_text(f"{length_s / HOUR_S:.2f} h" if length_s < 2 * DAY_S else f"{length_s / DAY_S:,.1f} days")
