"""`furrowmap init`: a `session.toml` proposed from recordings.

Places of sensors and tool are those of the machine's profile, or comments to fill in.
"""

import math
import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray
from pyproj import Transformer

from furrowmap.core.geodesy.crs_choice import CrsChoice, choose_crs, choose_utm
from furrowmap.core.readers.reader import (
    GivesAttitude,
    GivesInertial,
    GivesPoses,
    GivesScans,
    GivesStates,
    GivesTrack,
    ReadOptions,
)
from furrowmap.core.runtime.errors import InputError, Notice, printable
from furrowmap.core.runtime.file_names import resolved
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.session.examination import Examined, time_matches
from furrowmap.core.session.field_file import FieldFile
from furrowmap.core.session.flight_mounting import LOOKS, FlownMounting, flight_of
from furrowmap.core.session.machine_file import stated, toml_value
from furrowmap.core.session.toml_edit import with_value
from furrowmap.core.session.trial_files import NO_TRIAL, ImageTable, TrialFiles
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.machine import NOT_SHOWN_DEG, Machine
from furrowmap.core.values.margins import margin
from furrowmap.core.values.scan import ClockReading
from furrowmap.core.values.session import SESSION_SCHEMA

_ON_WHEELS: Final = "on the ground below the middle of the rear axle"
_MOUNTING: Final = """\
# Mounting of the scanner in the vehicle frame: origin {}; x forward,
# y left, z up; metres and degrees. R = Rz(yaw) Ry(pitch) Rx(roll) rotates sensor coordinates to the vehicle frame.
# Measure it, and remove the hash signs.
# xyz_m = [-0.55, 0.0, 2.35]
# rpy_deg = [0.0, 40.0, 180.0]
"""
_IMU: Final = """\
# Place of the IMU in the vehicle frame, roll, pitch, yaw of its axes there, and its model or class ("consumer",
# "industrial", "tactical"). Measure them, and remove the hash signs.
# xyz_m = [-0.04, -0.01, -0.29]
# rpy_deg = [180.0, 0.0, 0.0]
# class = "industrial"
"""
_ANTENNA: Final = """\
# Lever arm: phase centre of the GNSS antenna in the vehicle frame. Measure it, and remove the hash signs.
# [antenna]
# xyz_m = [1.85, 0.0, 1.62]
"""
_IMPLEMENT: Final = """\
# Working width of the implement, and the middle of its working line in the vehicle frame; needed for worked ground.
# [implement]
# kind = "rotary tiller"
# width_m = 1.70
# xy_m = [-1.45, 0.0]
# working_depth_m = 0.12
"""
_ANTENNA_IS_ORIGIN: Final = """\
# The origin of the vehicle frame may be any point; here it is the phase centre of the GNSS antenna. x points forward,
# y left, z up; metres and degrees.
[antenna]
xyz_m = [0.0, 0.0, 0.0]
"""
_FROM_ANTENNA: Final = """\
# Place of the {}, seen from the antenna: forward, left, up. Measure how far it is below (a negative number), replace
# the zeros where it is not straight below, and remove the hash sign.
# xyz_m = [0.0, 0.0, FILL-IN]
"""
_FLOWN_LIDAR: Final = """\
# Roll, pitch, yaw of its axes in the vehicle frame, R = Rz(yaw) Ry(pitch) Rx(roll), so that the ground below is level:
# for a {} axis that points forward, or else left, backward or right. A run refines them where strips overlap.
"""
_FLOWN_IMU: Final = """\
rpy_deg = {}   # by gravity, with its x axis forward
# class = "industrial"   # or "consumer", "tactical", or its model
"""


def antenna_table(machine: Machine, *, flies: bool) -> str:
    """The table of the antenna."""
    if machine.antenna is None:
        return _ANTENNA_IS_ORIGIN if flies else _ANTENNA
    head = "# Lever arm: phase centre of the GNSS antenna in the vehicle frame.\n[antenna]\n"
    return head + _lines(machine.antenna, "xyz_m")


def lidar_lines(machine: Machine, flight: FlownMounting | None, *, flies: bool) -> str:
    """The place of the scanner in its table."""
    if machine.lidar is None:
        if flight is None:
            return _MOUNTING.format("in the antenna" if flies else _ON_WHEELS)
        angles = [f"rpy_deg = {toml_value(flight.lidar_rpy_deg(look))}   # {look}" for look in LOOKS]
        words = _FROM_ANTENNA.format("scanner") + _FLOWN_LIDAR.format(flight.looking_axis)
        return words + "\n# ".join(angles) + "\n"
    text = "# Mounting of the scanner in the vehicle frame.\n" + _lines(machine.lidar, "xyz_m", "rpy_deg")
    if machine.calibrated is None:
        return text
    known = machine.calibrated.rpy_sigma_deg
    sigma = ", ".join("not shown" if value >= NOT_SHOWN_DEG else margin(value) for value in known)
    return f"{text}# Angles calibrated with the recording of {machine.calibrated.date}: {sigma} degrees (95 %).\n"


def implement_table(machine: Machine, more: str = "") -> str:
    """The table of the implement, or those of several; `more` are further lines for the one that moves soil."""
    if machine.implement is None:
        return _IMPLEMENT
    head = "# Working width of the implement, and the middle of its working line in the vehicle frame.\n"
    header = "[[implement]]\n" if machine.further_implements else "[implement]\n"
    keys = ("name", "kind", "width_m", "xy_m", "working_depth_m", "lift_m", "learned", "moves_soil")
    tables = [header + _lines(tool, *keys) for tool in machine.implements]
    return head + "\n".join([tables[0] + more, *tables[1:]])


def camera_comment(machine: Machine) -> Sequence[str]:
    """The place of the camera, as a comment: the machine does not tell whether it took images."""
    if machine.camera is None:
        return []
    lines = _lines(machine.camera, "xyz_m", "rpy_deg").splitlines()
    return ["\n".join(["# [camera]", '# files = ["images/*.jpg"]', *(f"# {line}" for line in lines), ""])]


def head_words(machine: Machine) -> str:
    """A comment that names the machine."""
    return f"# Places of sensors and tool: machine {printable(machine.name)}.\n" if machine.name else ""


def places_missing(
    machine: Machine,
    flight: FlownMounting | None,
    *,
    scans: bool,
    states: bool,
    poses: bool,
    inertial: bool,
    flies: bool,
) -> Sequence[Notice]:
    """Places that neither the recordings nor the machine's profile show.

    A vehicle that flies has no implement, and its antenna is the origin.
    """
    mounted = machine.lidar is not None and None not in (machine.lidar.xyz_m, machine.lidar.rpy_deg)
    place = ".place-assumed" if flight is not None else ""
    found = []
    if (scans or not states) and not mounted:
        found.append(Notice(f"no-mounting{place}"))
    if not poses and machine.antenna is None and not flies:
        found.append(Notice("no-antenna.to-fill-in"))
    if machine.implement is None and not flies:
        found.append(Notice("no-implement.place-assumed" if states else "no-implement.to-fill-in"))
    return [*found, Notice(f"no-imu-mounting{place}")] if inertial and machine.imu is None else found


def _lines(part: Any, *names: str) -> str:
    """The values of a part that are known, a line each; the IMU's kind is called class."""
    known = {
        "class" if name == "kind" and not hasattr(part, "width_m") else name: getattr(part, name) for name in names
    }
    return "".join(f"{key} = {toml_value(value)}\n" for key, value in known.items() if stated(value))


FILL_IN: Final = "FILL-IN"
"""Placeholder for a required value that the recordings do not show."""

_OF_SCANNERS: Final = ("angles-of-model", "rosette")
"""Codes of what a scanner's recording lacks that matters before a run."""
_SAME_PLACE_M: Final = 1000.0
"""Two positions closer than this are in the same CRS; in another CRS they would differ by kilometres."""

_NORTH_COMMENT: Final = """\
# For headings from magnetic north, and for logs that do not state their north ("true", "grid"):
# north = "magnetic"
# declination_deg = 4.2   # positive east, of the place and date
"""
_TRAJECTORY_TABLE: Final = """\
# External trajectory, used instead of GNSS and scan matching.
[trajectory]
{}
files = {}
# time = "utc"   # or "gps", if the file does not state it
"""
_NOWHERE: Final = np.empty((0, 2))
_FIELD_COMMENT: Final = """\
# Field boundary, a vector file.
# [field]
# boundary = "boundary.geojson"
"""


@dataclass(frozen=True)
class Proposal:
    """A proposed session file: its text, what was found, and what a run needs and the recordings do not show."""

    text: str
    found: tuple[Notice, ...]
    missing: tuple[Notice, ...]


def common_folder(paths: Sequence[Path]) -> Path:
    """The deepest folder that contains all files. Raises InputError if that is the root of a file system."""
    folders = {resolved(path).parent for path in paths}
    try:
        common = Path(os.path.commonpath(folders))
    except ValueError:  # on different drives
        common = Path(paths[0].anchor)
    if len(folders) > 1 and common == Path(common.anchor):
        raise InputError("no-common-folder", paths=paths[0], paths_last=paths[-1])
    return common


def propose_session(
    recordings: Sequence[Examined], folder: Path, machine: Machine | None = None, beside: TrialFiles = NO_TRIAL
) -> Proposal:
    """Propose a session file for recordings; the places of the machine's sensors and its tool are copied.

    InputError if a recording is outside `folder`, has a name that TOML cannot hold, or if a session can use none of the
    recordings.
    """
    ordered = sorted(recordings, key=lambda r: r.first_s)
    lidar = [r for r in ordered if r.gives(GivesScans)]
    poses = [r for r in ordered if r.gives(GivesPoses)]
    gnss, repeated = _apart([r for r in ordered if r.gives(GivesTrack) and not r.gives(GivesPoses)])
    states = [r for r in ordered if r.gives(GivesStates)]
    inertial = [r for r in ordered if r.gives(GivesInertial)]
    attitude = [r for r in ordered if r.gives(GivesAttitude)]
    others = [*states, *inertial, *attitude]
    used = [*lidar, *gnss, *poses, *others]
    if not used:
        title = ordered[0].inspection.title
        path = ordered[0].path
        finished = path.name if ordered[0].inspection.format == "las" else None
        raise InputError("no-recording.nothing-recorded", other=path, title=title, cloud=finished)
    matches = [match for match in time_matches(ordered) if match.positions not in {r.path for r in repeated}]
    near_s = next((r.scan_clock.first_s for r in lidar if r.scan_clock is not None), None)
    beginnings = [_beginning(r, near_s) for r in gnss + poses]
    crs = next((b.crs for b in beginnings if b.crs is not None), None)
    undated = any(r.position_clock is None for r in gnss)
    date = next((b.date for b in beginnings if b.date), None) if undated else None
    flight = flight_of(lidar, inertial) if machine is None and not states else None
    flies = flight is not None or (not states and (bool(attitude) or (bool(inertial) and not lidar)))
    machine = machine or Machine()
    of_field = _field_file(beside, beginnings, flies=flies)
    sensed = bool(lidar or inertial or attitude)
    text = "\n".join(
        [
            _head(folder, machine),
            _recording(lidar, gnss, poses, others, folder),
            _times([str(match.text) for match in matches], date, undated=undated),
            _crs(crs),
            _TRAJECTORY_TABLE.format(_comments(poses), _names(poses, folder))
            if poses
            else antenna_table(machine, flies=flies),
            *([_lidar(lidar, folder, machine, flight, flies=flies)] if lidar or not others else []),
            *([_imu(inertial, folder, machine, flight)] if inertial else []),
            *([_attitude(attitude, folder, needed=not inertial)] if attitude else []),
            *([_implement(states, folder, machine)] if states else [] if flies else [implement_table(machine)]),
            *([_camera(beside.images, folder)] if beside.images is not None else camera_comment(machine)),
            *([_parcels(beside, folder, measured=flies)] if beside.parcels is not None else []),
            *_field(of_field.boundary, folder, flies=flies),
        ]
    )
    told = dict.fromkeys(notice for r in ordered for notice in r.inspection.notices)
    found = [
        *(Notice("recording", name=r.path.name, title=r.inspection.title) for r in ordered),
        *(notice for notice in told if notice.code not in _OF_SCANNERS),
        *([Notice("flight", height_m=flight.height_m)] if flight is not None else []),
        *(Notice("time-overlap", text=match.text) for match in matches if match.shared_s > 0),
        *([Notice("crs", code=crs.code, crs=crs.name, reason=crs.reason)] if crs is not None else []),
        *(Notice("crs-alternative", other=other) for other in (crs.alternatives if crs is not None else ())),
        *(Notice("recording", name=path.name, title=title) for title, path in beside.titled),
        *of_field.used,
        *beside.notices,
    ]
    lacking = {"no-lidar": not (sensed or states), "no-positions": not (gnss or poses), "no-crs": crs is None}
    unused = [r for r in ordered if r not in used and r not in repeated]
    missing = [
        *(Notice("time-overlap", text=match.text) for match in matches if match.shared_s <= 0),
        *(Notice("no-place", fault=b.fault) for b in beginnings if b.fault),
        *(Notice("recording-unused.no-use-in-sessions", file=r.path.name, title=r.inspection.title) for r in unused),
        *(Notice("recording-unused.same-time", file=r.path.name, other=gnss[0].path.name) for r in repeated),
        *(Notice(f"{code}.to-fill-in", unknown=FILL_IN) for code, absent in lacking.items() if absent),
        *(notice for notice in told if notice.code in _OF_SCANNERS),
        *places_missing(
            machine, flight, scans=sensed, states=bool(states), poses=bool(poses), inertial=bool(inertial), flies=flies
        ),
        *([Notice("camera-uncalibrated")] if beside.images is not None else []),
        *of_field.unused,
    ]
    return Proposal(text, tuple(found), tuple(missing))


def recorded_session(name: str, machine: Machine) -> str:
    """The session of a recording that begins; its files and its CRS are filled in by :func:`with_recorded`."""
    head = "# Session file written by `furrowmap record`. Lines that begin with a hash sign are comments.\n"
    return "\n".join(
        [
            f"{head}{head_words(machine)}furrowmap = {SESSION_SCHEMA}\nname = {_quoted(name)}\n",
            _recording([], [], [], [], Path()),
            _times([], None, undated=False),
            _crs(None),
            antenna_table(machine, flies=False),
            _lidar([], Path(), machine, None, flies=False),
            implement_table(machine),
            _FIELD_COMMENT,
        ]
    )


def with_recorded(
    text: str, scanners: Sequence[Sequence[str]], gnss: Sequence[str], crs: CrsChoice | None, machine: Machine
) -> str:
    """The text of a session with the files of a recording, and with a CRS where it has none.

    Args:
        scanners: the files of each scanner, named STEM-NNNN.pcap. The first is that of `[recording]`, further ones get
            tables `[[lidar]]`.
        machine: states the places of further scanners.

    Raises:
        RefusedError: if its tables are written in a way that cannot be changed.
    """
    for key, files in (("lidar", scanners[0] if scanners else []), ("gnss", gnss)):
        if files:
            text = with_value(text, "recording", key, _listed(files))
    for number, files in enumerate(scanners[1:]):
        stem = files[0].rpartition("-")[0]
        line = f"files = {_listed(files)}"
        text, known = re.subn(rf'^files = \["{re.escape(stem)}-[^\n]*', line, text, count=1, flags=re.MULTILINE)
        if not known:
            own = machine.further_lidars[number] if number < len(machine.further_lidars) else None
            first = machine.lidar.name if machine.lidar is not None and machine.lidar.name else "first"
            text = re.sub(r"^\[lidar\]", f"[[lidar]]\nname = {_quoted(first)}", text, count=1, flags=re.MULTILINE)
            name = _quoted(own.name if own is not None and own.name else stem)
            its = msgspec.structs.replace(machine, lidar=own, calibrated=None)
            text = f"{text.rstrip()}\n\n[[lidar]]\nname = {name}\n{line}\n{lidar_lines(its, None, flies=False)}"
    return text.replace(_crs(None), _crs(crs))


def _apart(gnss: Sequence[Examined]) -> tuple[list[Examined], list[Examined]]:
    """The logs of positions without those that lie within the time of an earlier one, and these."""
    kept = list[Examined]()
    repeated = list[Examined]()
    for log in gnss:
        clock = log.position_clock
        known = [each.position_clock for each in kept]
        within = clock is not None and any(
            other is not None and other.first_s <= clock.first_s and clock.last_s <= other.last_s for other in known
        )
        (repeated if within else kept).append(log)
    return kept, repeated


@dataclass(frozen=True)
class _Beginning:
    """CRS and date of the first position of a recording, or why both are unknown.

    `places_deg` are the longitudes and latitudes (n, 2) of the recording.
    """

    crs: CrsChoice | None = None
    date: str | None = None
    fault: Text | None = None
    places_deg: NDArray[np.float64] = field(default_factory=_NOWHERE.copy)


def _beginning(recording: Examined, near_s: float | None) -> _Beginning:
    """The beginning of a recording with positions; `near_s` is an approximate time of it, if known."""
    # The place of a log without dates is the same on any day.
    reader = type(recording.reader)([recording.path], ReadOptions(near_s=0.0 if near_s is None else near_s))
    try:
        if isinstance(reader, GivesTrack):
            track = reader.track()
            t_s = track.t_s
            lon_deg = track.lon_deg
            lat_deg = track.lat_deg
        elif isinstance(reader, GivesPoses):
            poses = reader.poses()
            if poses.projected:
                return _projected_beginning(recording, float(poses.position[0, 0]), float(poses.position[0, 1]))
            t_s = poses.t_s
            lon_deg = poses.position[:, 0]
            lat_deg = poses.position[:, 1]
        else:
            return _Beginning()
    except InputError as error:
        return _Beginning(
            fault=Text("The location of {name} is unknown. {why}", name=recording.path.name, why=error.words("what"))
        )
    known = np.flatnonzero(np.isfinite(lon_deg) & np.isfinite(lat_deg))
    if not len(known):
        return _Beginning(
            fault=Text("The location of {name} is unknown: it has no positions.", name=recording.path.name)
        )
    return _Beginning(
        crs=choose_crs(float(lon_deg[known[0]]), float(lat_deg[known[0]])),
        date=iso_utc(float(t_s[0])).partition("T")[0] if near_s is not None else None,
        places_deg=np.column_stack([lon_deg[known], lat_deg[known]]),
    )


def _projected_beginning(recording: Examined, e_m: float, n_m: float) -> _Beginning:
    """The CRS of eastings and northings, if longitude and latitude in the same file lead to them."""
    place = recording.inspection.facts.get("place")
    if place is None:
        return _Beginning()
    lon_deg = place["lon_deg"]
    lat_deg = place["lat_deg"]
    choices = [choice for choose in (choose_crs, choose_utm) if (choice := choose(lon_deg, lat_deg)) is not None]
    for crs in choices:
        there_m = Transformer.from_crs("EPSG:4326", crs.code, always_xy=True).transform(lon_deg, lat_deg)
        if math.dist(there_m, (e_m, n_m)) <= _SAME_PLACE_M:
            return _Beginning(crs=crs)
    if not choices:
        return _Beginning()
    return _Beginning(
        fault=Text(
            "{name} has latitudes and longitudes in the area of {code}, but its eastings "
            "and northings are in another CRS: state it in [crs] map.",
            name=recording.path.name,
            code=choices[0].code,
        )
    )


def _imu(inertial: Sequence[Examined], folder: Path, machine: Machine, flight: FlownMounting | None) -> str:
    if machine.imu is not None:
        place = _lines(machine.imu, "xyz_m", "rpy_deg", "kind")
    elif flight is not None:
        place = _FROM_ANTENNA.format("IMU") + _FLOWN_IMU.format(toml_value(flight.imu_rpy_deg))
    else:
        place = _IMU
    return f"[imu]\n{_comments(inertial)}\nfiles = {_names(inertial, folder)}\n{_imu_units(inertial)}{place}"


def _imu_units(inertial: Sequence[Examined]) -> str:
    """The units that the measurements show, where these are others than those of their format."""
    facts = [recording.inspection.facts for recording in inertial]
    measured = [each["imu"] if isinstance(each.get("imu"), Mapping) else each for each in facts]
    lines = []
    for key in ("rate_unit", "force_unit"):
        units = {str(each.get(key, "")) for each in measured}
        if len(units) == 1 and "" not in units:
            lines.append(f"{key} = {_quoted(units.pop())}   # by gravity and motion; the format says another\n")
    return "".join(lines)


def _head(folder: Path, machine: Machine) -> str:
    return f"""\
# Session file proposed by `furrowmap init`. Lines that begin with a hash sign are comments. Check the values, measure
# what is missing, and remove the hash sign of the lines that you fill in.
{head_words(machine)}furrowmap = {SESSION_SCHEMA}
name = {_quoted(resolved(folder).name or "session")}
"""


def _recording(
    lidar: Sequence[Examined],
    gnss: Sequence[Examined],
    poses: Sequence[Examined],
    states: Sequence[Examined],
    folder: Path,
) -> str:
    scans = [(recording, recording.scan_clock) for recording in lidar]
    lines = ["[recording]", *_described(scans)]
    if lidar or not states:
        first = _scanners(lidar)[0][0] if lidar else []
        lines.append(f"lidar = {_names(first, folder) or _listed([FILL_IN])}")
    if gnss or not poses:
        positions = [(recording, recording.position_clock) for recording in gnss]
        lines += [*_described(positions), f"gnss = {_names(gnss, folder) or _listed([FILL_IN])}"]
    tasks = [
        (name, facts) for recording in states for name, facts in recording.inspection.facts.get("tasks", {}).items()
    ]
    if len(tasks) > 1:
        lines += ["# Task to use; by default all tasks are read as one drive:"]
        lines += [f"# task = {_quoted(name)}   # {printable(str(facts.get('field')))}" for name, facts in tasks]
    return "\n".join(lines)


def _times(matches: Sequence[str], date: str | None, *, undated: bool) -> str:
    """The keys of `[recording]` about clocks."""
    lines = [f"# {printable(text)}" for text in matches]
    lines += ["# LiDAR clock minus GNSS clock in seconds, if they differ by a constant:", "lidar_minus_gnss_s = 0.0"]
    if undated:
        lines += ["# UTC date of the first position; the log contains no date."]
        lines += [f"date = {_quoted(date)}   # from the clock of the scanner" if date else '# date = "2026-06-11"']
    return "\n".join([*lines, ""])


def _crs(crs: CrsChoice | None) -> str:
    if crs is None:
        words = ["Projected CRS of the map; the location is unknown."]
        code = FILL_IN
    else:
        words = [f"{crs.name}: {crs.reason}.", *(f"Or {other}." for other in crs.alternatives)]
        code = crs.code
    comments = "\n".join(f"# {printable(line)}" for line in words)
    return f"""\
[crs]
{comments}
map = {_quoted(code)}
heights = "ellipsoidal"
coordinates = "as-recorded"
"""


def _attitude(logs: Sequence[Examined], folder: Path, *, needed: bool) -> str:
    """Roll and pitch of the first log that has them, the heading of the last one; a comment where it is not needed."""
    level = next((r for r in logs if "roll_deg" in r.inspection.facts), logs[0])
    heading = next((r for r in reversed(logs) if r.inspection.facts["north"] != "no heading"), logs[-1])
    (roll_pitch,), (north,) = (_paths([recording], folder) for recording in (level, heading))
    if not needed:
        return (
            f"# Attitudes of other devices, which a run uses only without [imu].\n{_comments(logs)}\n# [attitude]\n"
            f"# roll_pitch = {_quoted(roll_pitch)}\n# heading = {_quoted(north)}\n"
        )
    return (
        f"[attitude]\n{_comments(logs)}\n"
        "# Log whose roll and pitch, and log whose heading are used; the same, or two.\n"
        f"roll_pitch = {_quoted(roll_pitch)}\nheading = {_quoted(north)}\n{_NORTH_COMMENT}"
    )


def _camera(table: ImageTable, folder: Path) -> str:
    width, height = table.size or (FILL_IN, FILL_IN)
    return f"""\
# Camera. Fill in its calibration in pixels, as in OpenCV, and its place; remove the hash signs. Until then a run leaves
# the images out. The angles are those of a camera that looks down, with the top of its images forward.
[camera]
table = {_quoted(*_inside([table.path], folder))}   # {table.images} images
# width = {width}
# height = {height}
# fx = {FILL_IN}
# fy = {FILL_IN}
# cx = {FILL_IN}
# cy = {FILL_IN}
# k1 = 0.0
# k2 = 0.0
# xyz_m = [0.0, 0.0, {FILL_IN}]
# rpy_deg = [180.0, 0.0, -90.0]
"""


def _parcels(beside: TrialFiles, folder: Path, *, measured: bool) -> str:
    """The parcels, with their treatments; a comment where their crops are not seen from above."""
    assert beside.parcels is not None
    lines = ["[parcels]", f"file = {_quoted(*_inside([beside.parcels.path], folder))}"]
    lines += [
        "# Width of the strips that are left out at each end and each side of a parcel, in metres; default: none.",
        f"# net_inset_m = [{FILL_IN}, {FILL_IN}]",
    ]
    if beside.treatments is not None:
        lines.append(f"treatments = {_quoted(*_inside([beside.treatments], folder))}")
    if not measured:
        lines = [line if line.startswith("#") else f"# {line}" for line in lines]
    count = beside.parcels.parcels
    column = printable(beside.parcels.column)
    return "\n".join([f"# Parcels of a trial: {count} polygons with identifiers in the column {column}.", *lines, ""])


def _field_file(beside: TrialFiles, beginnings: Sequence[_Beginning], *, flies: bool) -> FieldFile:
    """The boundary among the files beside recordings."""
    taken = [path for _, path in beside.titled]
    places_deg = np.concatenate([_NOWHERE, *(b.places_deg for b in beginnings)])
    return FieldFile.among(beside.files, places_deg, taken, flies=flies)


def _field(boundary: Path | None, folder: Path, *, flies: bool) -> list[str]:
    """The boundary that was found, or a comment where one could be entered."""
    if boundary is None:
        return [] if flies else [_FIELD_COMMENT]
    return [f"[field]\nboundary = {_quoted(*_inside([boundary], folder))}\n"]


def _implement(states: Sequence[Examined], folder: Path, machine: Machine) -> str:
    """The implement of recordings with tool states, with their working width."""
    if machine.implement is not None:
        return implement_table(machine, f"states = {_names(states, folder)}\n")
    widths = [width for recording in states if (width := recording.inspection.facts.get("width_m"))]
    width = f"{widths[0]}   # largest width logged while working" if widths else "1.0   # FILL-IN: not in the recording"
    return f"""\
# Working width of the implement, and the middle of its working line in the vehicle frame; needed for worked ground.
[implement]
width_m = {width}
xy_m = [0.0, 0.0]   # FILL-IN: relative to the rear axle; [0, 0] takes the positions as those of the implement
states = {_names(states, folder)}
"""


def _scanners(lidar: Sequence[Examined]) -> list[tuple[list[Examined], str | None]]:
    """The recordings of each scanner, and which one it is of several in them.

    Recordings one after the other are of one scanner, those at the same time of several.
    """
    groups: list[list[Examined]] = []
    for recording in lidar:
        clock = recording.scan_clock
        ended = (
            group
            for group in groups
            if clock is None or group[-1].scan_clock is None or group[-1].scan_clock.last_s <= clock.first_s
        )
        group = next(ended, None)
        if group is None:
            groups.append([recording])
        else:
            group.append(recording)
    facts = [(group, group[0].inspection.facts) for group in groups]
    times = Counter(recording.path for recording in lidar)  # once for each maker
    inside = [
        (
            group,
            known.get("sensors")
            or _of_bag(known).get("sensors")
            or [known["sender"] if times[group[0].path] > 1 else None],
        )
        for group, known in facts
    ]
    return [(group, source) for group, sources in inside for source in sources]


def _of_bag(facts: Mapping[str, Any]) -> Mapping[str, Any]:
    """The facts of the scans in a bag, among those of the bag; none for another file."""
    scans = facts.get("scans")
    return scans if isinstance(scans, Mapping) else {}


def _lidar(
    lidar: Sequence[Examined], folder: Path, machine: Machine, flight: FlownMounting | None, *, flies: bool
) -> str:
    """The table of the scanner, or those of several, of which the first has the files of the recording."""
    scanners = _scanners(lidar) or [([], None)]
    known = (machine.lidar, *machine.further_lidars)
    tables = []
    for number, (recordings, source) in enumerate(scanners):
        facts = (each for r in recordings for each in (r.inspection.facts, _of_bag(r.inspection.facts)))
        model = next((str(each["model"]) for each in facts if each.get("model")), None)
        own = known[number] if number < len(known) else None
        lines = ["[lidar]"]
        if len(scanners) > 1:
            lines = [
                "[[lidar]]",
                f"name = {_quoted(own.name if own is not None and own.name else f'scanner {number + 1}')}",
            ]
            names = _names(recordings, folder)
            lines += [f"files = {names}"] if names != _names(scanners[0][0], folder) else []
            lines += [f"source = {_quoted(source)}"] if source is not None else []
        lines += [f"model = {_quoted(model)}   # from the recording"] if model and source is None else []
        its = msgspec.structs.replace(machine, lidar=own, calibrated=None if number else machine.calibrated)
        tables.append("\n".join([*lines, lidar_lines(its, flight, flies=flies)]))
    return "\n".join(tables)


def _described(recordings: Sequence[tuple[Examined, ClockReading | None]]) -> list[str]:
    """A comment on each recording, with its time span and clock."""
    lines = []
    for recording, clock in recordings:
        span = f", {iso_utc(clock.first_s)} to {iso_utc(clock.last_s)} ({clock.clock.value})" if clock else ""
        lines.append(f"# {printable(recording.path.name)}: {printable(str(recording.inspection.title))}{span}")
    return lines


def _comments(recordings: Sequence[Examined]) -> str:
    return "\n".join(_described([(recording, recording.position_clock) for recording in recordings]))


def _names(recordings: Sequence[Examined], folder: Path) -> str:
    """The paths of the recordings relative to `folder` as a TOML list; empty text without any."""
    names = _paths(recordings, folder)
    return _listed(names) if names else ""


def _paths(recordings: Sequence[Examined], folder: Path) -> list[str]:
    """The paths of the recordings relative to `folder`."""
    return _inside([recording.path for recording in recordings], folder)


def _inside(paths: Sequence[Path], folder: Path) -> list[str]:
    """Paths relative to `folder`. Raises InputError if one is outside."""
    names = []
    for path in map(resolved, paths):
        if not path.is_relative_to(resolved(folder)):
            raise InputError("session-path-outside.absolute-file", path=path, folder=folder)
        names.append(path.relative_to(resolved(folder)).as_posix())
    return names


def _listed(names: Sequence[str]) -> str:
    return f"[{', '.join(_quoted(name) for name in names)}]"


def _quoted(text: str) -> str:
    """`text` as a TOML basic string. Raises InputError if it cannot be written."""
    try:
        text.encode("utf-8")
    except UnicodeEncodeError:
        raise InputError("name-not-text", text=printable(text)) from None
    return toml_value(text)
