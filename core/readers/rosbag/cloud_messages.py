"""PointCloud2 messages to scans, and LaserScan messages, whose sweeps are scans.

The fields of a PointCloud2 depend on the driver; x, y and z are required, the others are recognised by their names in
the drivers of Velodyne, Ouster, Hesai, Robosense and Livox. Definition: ROS package sensor_msgs.
"""

from collections import Counter
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.line_csv import MAX_RANGE_M, mostly_invalid, sweep
from furrowmap.core.readers.rosbag.bag_storage import BagMessage, Damage
from furrowmap.core.readers.rosbag.ros_messages import stamp_s
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.clock import DAY_S
from furrowmap.core.values.scan import MAX_LASERS, Clock, Scan, counts_from_top, has_rings

MAX_SWEEP_S: Final = 10.0
"""No sweep takes longer: its time increment is damaged."""


class LineScans:
    """Decodes the LaserScan messages of one topic into scans, one scan per message.

    Angles are about the z axis of the scanner's frame, counter-clockwise from its x axis (REP-103). Ranges outside the
    limits in the message are no returns, by definition of the message.
    """

    clock: Final = Clock.RECORDER

    def __init__(self, source: str) -> None:
        self._source = source
        self._scans = self._firings = self._points = self._untimed = self._late = self._far = 0
        self._span_deg = self._step_deg = 0.0
        self._last_s = -np.inf

    def push(self, content: Any, message: BagMessage) -> list[Scan]:
        """The scan in a message; none without a return, or not later than the one before.

        Damage if it is impossible.
        """
        ranges = np.asarray(content.ranges, np.float64)
        n = len(ranges)
        first = float(content.angle_min)
        step = float(content.angle_increment)
        each_s = float(content.time_increment)
        if not np.isfinite((first, step, each_s)).all() or abs(step) * n > 4.0 * np.pi or n > np.iinfo(np.uint16).max:
            raise Damage(
                Text(
                    "{ranges} ranges from an angle of {first_rad:g} rad in steps of {step_rad:g} rad are no sweep",
                    ranges=n,
                    first_rad=first,
                    step_rad=step,
                )
            )
        if not 0.0 <= each_s * n <= MAX_SWEEP_S:
            raise Damage(Text("its time increment of {each_s:g} s is not that of a sweep", each_s=each_s))
        at_s = stamp_s(content, message)
        if at_s <= self._last_s:
            self._late += 1
            return []
        self._last_s = at_s
        self._untimed += n > 1 and each_s == 0.0
        self._span_deg = np.degrees(abs(step) * n)
        self._step_deg = np.degrees(abs(step))
        with np.errstate(invalid="ignore"):
            returned = (ranges >= content.range_min) & (ranges <= content.range_max) & (ranges > 0.0)
        self._firings += n
        self._far += int(np.count_nonzero(returned & (ranges > MAX_RANGE_M)))
        column = np.flatnonzero(returned & (ranges <= MAX_RANGE_M))
        self._points += len(column)
        firing = column.astype(np.float64)
        if not len(column):
            return []
        intensity = np.asarray(content.intensities, np.float64)
        self._scans += 1
        return [
            sweep(
                self._scans - 1,
                np.asarray(at_s + each_s * firing, np.float64),
                np.asarray(first + step * firing, np.float64),
                ranges[column],
                intensity[column] if len(intensity) == n else np.zeros(len(column)),
                column,
            )
        ]

    def finish(self) -> list[Scan]:
        """No scans: every message is a complete scan; InputError if most ranges are implausible."""
        if self._far > self._points:
            raise mostly_invalid(self._source, self._far, self._far + self._points)
        return []

    def facts(self) -> dict[str, Any]:
        """What `inspect` reports."""
        return {
            "line_scanner": True,
            "firings": self._firings,
            "angle_span_deg": round(self._span_deg, 1),
            "angle_step_deg": round(self._step_deg, 4),
        }

    def notices(self) -> list[Notice]:
        """What the messages lack, and how many were skipped."""
        source = self._source
        found = []
        if self._far:
            found.append(Notice("points-invalid.far", source=source, far=self._far, farthest_m=MAX_RANGE_M))
        if self._untimed:
            found.append(
                Notice("no-point-times", source=source, untimed=self._untimed, scans=self._scans, are_sweeps=True)
            )
        if self._late:
            found.append(Notice("clouds-late", source=source, late=self._late, are_sweeps=True))
        return found


_DATATYPES: Final = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
FIELD_NAMES: Final = {
    "intensity": ("intensity", "i", "reflectivity", "reflectance"),
    "ring": ("ring", "channel", "line", "laser_id"),
    "time": ("time", "t", "timestamp", "time_stamp", "offset_time", "time_offset"),
}
_UNITS_S: Final = (1.0, 1e-3, 1e-6, 1e-9)
_REVOLUTION_S: Final = (0.005, 1.5)
"""Range of the duration of a revolution, of any spinning scanner. Units of time differ by a factor of 1000, so at most
one of them puts the time span of a message in this range."""

_MAX_INVALID_SHARE: Final = 0.5
"""Share of the points, beyond which the messages are not what they seem to be."""
_MAX_FIRINGS: Final = 1e6
"""In one message; more result from damaged times only."""


class _PointTimes(NamedTuple):
    """Unit and origin of a time field."""

    unit_s: float
    origin: str  # "utc", "stamp" (of the message), or "first" (unknown: the first return is placed at the stamp)


MIN_TELLING_RETURNS: Final = 100
"""Clouds of fewer returns do not show how lasers are counted."""


class CloudScans:
    """Decodes the PointCloud2 messages of one topic into scans, one scan per message."""

    clock: Final = Clock.RECORDER

    def __init__(self, source: str) -> None:
        self._source = source
        self._scans = self._slots = self._untimed = self._empty = self._late = 0
        self._points = 0
        self._invalid: Counter[Text] = Counter()
        self._fields: tuple[str, ...] = ()
        self._times: _PointTimes | None = None
        self._ringed = True
        self._rosette = self._from_top = False
        self._lasers = 0
        self._last_s = -np.inf

    def push(self, content: Any, message: BagMessage) -> list[Scan]:
        """The scan in a message; none without a return, or not later than the one before.

        Damage if fields do not match.
        """
        points = _points(content)
        names = points.dtype.names or ()
        self._fields = self._fields or tuple(str(field.name) for field in content.fields)
        self._slots += points.size
        x, y, z = (points[axis].astype(np.float32) for axis in "xyz")
        # Drivers write nan or 0 where there is no return, nan only in messages that are not dense.
        empty = (x == 0) & (y == 0) & (z == 0)
        if not content.is_dense:
            empty |= np.isnan(x) | np.isnan(y) | np.isnan(z)
        finite = np.isfinite(x) & np.isfinite(y) & np.isfinite(z)
        near = (np.abs(x) <= MAX_RANGE_M) & (np.abs(y) <= MAX_RANGE_M) & (np.abs(z) <= MAX_RANGE_M)
        self._points += int(np.count_nonzero(~empty))
        self._invalid[Text("coordinates that are no numbers")] += int(np.count_nonzero(~empty & ~finite))
        self._invalid[Text("coordinates beyond {most_m:,.0f} m", most_m=MAX_RANGE_M)] += int(
            np.count_nonzero(finite & ~near)
        )
        returned: NDArray[np.bool_] = ~empty & finite & near
        if not returned.any():
            self._empty += 1
            return []
        at_s = stamp_s(content, message)
        if at_s <= self._last_s:
            self._late += 1
            return []
        self._last_s = at_s
        ring = points["ring"] if "ring" in names else None
        layout = _columns_of_layout(points.shape, ring)
        xyz = np.column_stack([x[returned], y[returned], z[returned]])
        points = points[returned]
        n = len(points)
        self._ringed = self._ringed and ring is not None
        laser = np.clip(points["ring"], 0, 255).astype(np.uint8) if ring is not None else np.zeros(n, np.uint8)
        t_s = self._point_times(points["time"] if "time" in names else None, n, at_s)
        apart = np.abs(t_s - np.quantile(t_s, 0.5, method="lower")) > _REVOLUTION_S[1]
        if apart.any():
            self._invalid[Text("times apart from the others")] += int(np.count_nonzero(apart))
            returned[returned] = ~apart
            t_s = t_s[~apart]
            laser = laser[~apart]
            points = points[~apart]
            xyz = xyz[~apart]
        if layout is None:
            order = np.argsort(t_s, kind="stable")
            column = _columns_of_times(t_s[order], laser[order])
        else:
            column = layout[returned]
            order = np.argsort(column.astype(np.uint16), kind="stable")
            if (np.diff(t_s[order]) < 0).any():
                order = np.lexsort((column, t_s))
            column = column[order]
        values = points["intensity"][order] if "intensity" in names else np.zeros(len(order))
        counts = np.rint(np.clip(np.nan_to_num(values.astype(np.float64)), 0, 65535)).astype(np.uint16)
        self._scans += 1
        scan = Scan(
            number=self._scans - 1,
            t_s=t_s[order],
            xyz_m=xyz[order],
            intensity=counts.astype(np.uint8) if int(counts.max()) <= 255 else counts,
            laser=laser[order],
            column=np.minimum(column - column.min(), 65535).astype(np.uint16),
            return_number=np.ones(len(order), np.uint8),
            returns=np.ones(len(order), np.uint8),
        )
        return [self._ranked(scan, ring)]

    def _ranked(self, scan: Scan, ring: NDArray[Any] | None) -> Scan:
        """The scan with its lasers counted from the lowest, and their number; rings are those of all its slots."""
        if ring is None or (self._lasers == 0 and len(scan) < MIN_TELLING_RETURNS):
            return scan
        if self._lasers == 0:
            self._rosette = not has_rings(scan)
            self._from_top = counts_from_top(scan)
            self._lasers = min(int(ring.max()) + 1, MAX_LASERS)
        if self._rosette:
            return scan
        if self._from_top:
            scan = replace(scan, laser=self._lasers - 1 - np.minimum(scan.laser, self._lasers - 1))
        return replace(scan, lasers=max(self._lasers, int(scan.laser.max()) + 1))

    def finish(self) -> list[Scan]:
        """No scans: every message is a complete scan; InputError if most points are invalid."""
        if sum(self._invalid.values()) > _MAX_INVALID_SHARE * self._points:
            raise InputError("points-mostly-invalid.with-counts", source=self._source, counts=self._reasons())
        return []

    def _reasons(self) -> Text:
        counts = tuple(
            Text("{count:,} with {fault}", count=count, fault=fault) for fault, count in self._invalid.items() if count
        )
        return Text("of {points:,} points {counts}", points=self._points, counts=counts)

    def facts(self) -> dict[str, Any]:
        """What `inspect` reports."""
        written = "none"
        if self._times is not None:
            unit = {1.0: "s", 1e-3: "ms", 1e-6: "µs", 1e-9: "ns"}[self._times.unit_s]
            origin = {"utc": "since 1970", "stamp": "from the message's stamp", "first": "from an unknown zero"}
            written = f"{unit} {origin[self._times.origin]}"
        return {
            "slots": self._slots,
            "slots_without_return": self._slots - self._points,
            "fields": list(self._fields),
            "time_per_point": written,
        }

    def notices(self) -> list[Notice]:
        """What the messages lack, and how many were skipped."""
        source = self._source
        found = []
        if any(self._invalid.values()):
            found.append(Notice("points-invalid", source=source, reasons=self._reasons()))
        if self._untimed:
            found.append(
                Notice("no-point-times", source=source, untimed=self._untimed, scans=self._scans, are_sweeps=False)
            )
        if self._times is not None and self._times.origin == "first":
            found.append(Notice("point-times-unanchored", source=source))
        if self._scans and not self._ringed:
            found.append(Notice("no-rings", source=source))
        if self._rosette:
            found.append(Notice("rosette", source=source))
        if self._empty:
            found.append(Notice("clouds-empty", source=source, empty=self._empty))
        if self._late:
            found.append(Notice("clouds-late", source=source, late=self._late, are_sweeps=False))
        return found

    def _point_times(self, values: NDArray[Any] | None, n: int, at_s: float) -> FloatArray:
        """UTC of each of n points."""
        own = np.full(n, np.nan) if values is None else values.astype(np.float64)
        usable = bool(np.isfinite(own).all())
        if self._times is None and usable:
            self._times = _detect_times(own, at_s)
        if self._times is None or not usable:
            self._untimed += 1
            return np.full(n, at_s)
        own = own * self._times.unit_s
        if self._times.origin == "utc":
            return own
        return at_s + (own - own.min() if self._times.origin == "first" else own)


def _points(content: Any) -> NDArray[Any]:
    """A view (height, width) of a PointCloud2's points, with standard names for the fields that are used."""
    height, width, step, row = (int(n) for n in (content.height, content.width, content.point_step, content.row_step))
    byte_order = ">" if content.is_bigendian else "<"
    there = {str(field.name): field for field in content.fields}
    wanted = {axis: (axis,) for axis in "xyz"} | FIELD_NAMES
    names = []
    formats = []
    offsets = []
    for name, spellings in wanted.items():
        field = next((there[spelling] for spelling in spellings if spelling in there), None)
        if field is None or int(field.datatype) not in _DATATYPES:
            if name in "xyz":
                raise Damage(
                    Text(
                        "the cloud has no field {name!r} (fields: {fields})",
                        name=name,
                        fields=", ".join(there) or "none",
                    )
                )
            continue
        names.append(name)
        formats.append(byte_order + _DATATYPES[int(field.datatype)])
        offsets.append(int(field.offset))
    ends = [offset + np.dtype(form).itemsize for offset, form in zip(offsets, formats, strict=True)]
    if max(ends) > step or row < width * step or len(content.data) < height * row:
        raise Damage(
            Text(
                "{width} × {height} points of {step} bytes do not match {size} bytes of data",
                width=width,
                height=height,
                step=step,
                size=len(content.data),
            )
        )
    dtype = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": step})
    data = np.ascontiguousarray(content.data, np.uint8)
    return np.ndarray((height, width), dtype, data.data, strides=(row, step))


def _detect_times(values: FloatArray, at_s: float) -> _PointTimes | None:
    """Unit and origin of a cloud's times (n,), from the duration of a revolution and the difference from the stamp."""
    low, middle, high = np.quantile(values, [0.02, 0.5, 0.98]).tolist()  # a damaged time or two do not matter
    span = (high - low) / 0.96
    unit_s = next((unit for unit in _UNITS_S if _REVOLUTION_S[0] <= span * unit < _REVOLUTION_S[1]), None)
    if unit_s is None:
        return None
    if abs(middle * unit_s - at_s) < min(DAY_S, 0.5 * at_s):
        return _PointTimes(unit_s, "utc")
    return _PointTimes(unit_s, "stamp" if abs(middle) * unit_s < 10.0 else "first")


def _columns_of_layout(shape: tuple[int, ...], ring: NDArray[Any] | None) -> NDArray[np.int64] | None:
    """Index of the firing of each point in an organised cloud (height, width); None if the layout does not show it."""
    if min(shape) <= 1:
        return None
    along = int(np.argmax(shape))
    if ring is not None:
        constant = [bool((ring == ring[:1]).all()), bool((ring == ring[:, :1]).all())]
        if not any(constant):
            return None
        along = constant.index(True)
    columns: NDArray[np.int64] = np.indices(shape)[along]
    return columns


def _columns_of_times(t_s: FloatArray, laser: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Index of the firing of each return (n,) in a cloud without empty points; t_s increases.

    A laser fires once per cycle, whose length is the typical time between two returns of one laser. The lasers fire in
    a fixed pattern within the cycle, and a firing begins in the longest pause of the pattern.
    """
    by_laser = np.argsort(laser, kind="stable")
    step = np.diff(t_s[by_laser])[np.diff(laser[by_laser].astype(np.int16)) == 0]
    step = step[step > 0]
    if not len(step):
        return np.zeros(len(t_s), np.int64)
    cycle_s = float(np.quantile(step, 0.2, method="lower"))
    cycle_s = float(step[np.abs(step - cycle_s) < 0.2 * cycle_s].mean())
    turns = np.minimum((t_s - t_s[0]) / cycle_s, _MAX_FIRINGS)
    within = np.sort(turns % 1.0)
    pause = np.diff(within, append=within[0] + 1.0)
    widest = int(np.argmax(pause))
    firing: NDArray[np.int64] = np.floor(turns - within[widest] - 0.5 * pause[widest]).astype(np.int64)
    return firing
