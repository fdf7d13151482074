"""A first `session.toml` from what the recordings themselves say."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from pyproj import Transformer

from furrowmap.core.geodesy.crs_choice import CrsChoice, choose_crs
from furrowmap.core.readers.reader import ClockReading, GivesPoses, GivesTrack, ReadOptions
from furrowmap.core.session.examination import Examined, time_matches
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.errors import InputError, Notice, printable
from furrowmap.core.values.session import SCHEMA

UNKNOWN: Final = "FILL-IN"
"""What stands where a session cannot do without a word that could not be found out."""

_SAME_PLACE_M: Final = 1000.0
"""Distance below which two positions are the same place in the same CRS; in another one it is kilometres off."""

_MOUNTING: Final = """\
# Vehicle frame: origin on the ground below the middle of the rear axle; x forward, y left, z up, in metres.
# Where the sensor is, and how it is turned: R = Rz(yaw) Ry(pitch) Rx(roll) takes its coordinates to the vehicle's.
# xyz_m = [-0.55, 0.0, 2.35]
# rpy_deg = [0.0, 40.0, 180.0]
"""
_ANTENNA: Final = """\
# Phase centre of the GNSS antenna in the vehicle frame. Remove the two hash signs when it has been measured.
# [antenna]
# xyz_m = [1.85, 0.0, 1.62]
"""
_IMPLEMENT: Final = """\
# The tool: width, and the middle of its line in the vehicle frame. The ground worked is computed from them.
# [implement]
# kind = "rotary tiller"
# width_m = 1.70
# xy_m = [-1.45, 0.0]
# working_depth_m = 0.12
"""
_FIELD: Final = """\
# The parcel's boundary, if there is a file of it.
# [field]
# boundary = "boundary.geojson"
"""


@dataclass(frozen=True)
class Proposal:
    """A session file for its user to go over.

    Attributes:
        text: of the file; `load_session` reads it as it stands.
        found: what could be found out.
        missing: what a run needs or gains from and the recordings do not tell.
    """

    text: str
    found: tuple[Notice, ...]
    missing: tuple[Notice, ...]


def common_folder(paths: Sequence[Path]) -> Path:
    """The nearest folder that holds all the files: where a session that names them has to stand.

    Raises:
        InputError: if there is none but the root of a file system.
    """
    folders = {path.resolve().parent for path in paths}
    try:
        common = Path(os.path.commonpath(folders))
    except ValueError:  # on different drives
        common = Path(paths[0].anchor)
    if len(folders) > 1 and common == Path(common.anchor):
        raise InputError(
            f"{paths[0]} and {paths[-1]} lie in folders that have nothing in common.",
            "A session may only name files beside or below itself, and no such place holds them all.",
            "Copy the recordings into one folder first.",
            code="no-common-folder",
        )
    return common


def propose_session(recordings: Sequence[Examined], folder: Path) -> Proposal:
    """What a session in `folder` can say about the recordings.

    Args:
        recordings: in any order.
        folder: where the file will stand.

    Raises:
        InputError: if a recording lies outside `folder`, or has a name that no TOML file can hold; or if none of them
            is of a kind that a session is made of.
    """
    ordered = sorted(recordings, key=lambda r: r.first_s)
    lidar = [r for r in ordered if r.gives_scans]
    gnss = [r for r in ordered if r.gives_track]
    poses = [r for r in ordered if r.gives_poses]
    states = [r for r in ordered if r.gives_states]
    used = [*lidar, *gnss, *poses, *states]
    if not used:
        raise _nothing_recorded(ordered[0])
    matches = list(time_matches(ordered))
    near_s = next((r.scan_clock.first_s for r in lidar if r.scan_clock is not None), None)
    beginnings = [_beginning(r, near_s) for r in gnss + poses]
    crs = next((b.crs for b in beginnings if b.crs is not None), None)
    undated = any(r.position_clock is None for r in gnss)
    date = next((b.date for b in beginnings if b.date), None) if undated else None
    text = "\n".join(
        [
            _head(folder),
            _recording(lidar, gnss, poses, states, folder),
            _times([match.text for match in matches], date, undated=undated),
            _crs(crs),
            _trajectory(poses, folder) if poses else _ANTENNA,
            *([_lidar(lidar)] if lidar or not states else []),
            _implement(states, folder) if states else _IMPLEMENT,
            _FIELD,
        ]
    )
    found = [
        *(Notice("recording", f"{r.path.name}: {r.inspection.title}") for r in ordered),
        *(Notice("time-overlap", match.text) for match in matches if match.shared_s > 0),
        *_crs_found(crs),
    ]
    missing = [
        *(Notice("time-overlap", match.text) for match in matches if match.shared_s <= 0),
        *(Notice("no-place", b.fault) for b in beginnings if b.fault),
        *(
            Notice("recording-unused", f"{r.path.name} ({r.inspection.title}): no part of a session is made of it.")
            for r in ordered
            if r not in used
        ),
        *_missing(crs, scans=bool(lidar), states=bool(states), gnss=bool(gnss), poses=bool(poses)),
    ]
    return Proposal(text, tuple(found), tuple(missing))


def _nothing_recorded(other: Examined) -> InputError:
    finished = other.inspection.format == "las"
    return InputError(
        f"{other.path} is no recording: {other.inspection.title}.",
        "A session is made of a laser scanner's recording with positions or a trajectory, or of a log of the work.",
        f"Make surfaces of a finished cloud with `furrowmap surface {other.path.name} -o DIR`."
        if finished
        else "Name the scanner's recording and the GNSS log.",
        code="no-recording",
    )


@dataclass(frozen=True)
class _Beginning:
    """Where and when a drive begins, as far as one recording tells.

    Attributes:
        crs: that suits the place.
        date: of the first position (UTC).
        fault: why neither could be told, or "".
    """

    crs: CrsChoice | None = None
    date: str | None = None
    fault: str = ""


def _beginning(recording: Examined, near_s: float | None) -> _Beginning:
    """What a recording with positions tells; `near_s` is a time near which it was made, if one is known."""
    # A log without dates has its place on any day.
    reader = type(recording.reader)([recording.path], ReadOptions(near_s=0.0 if near_s is None else near_s))
    try:
        if isinstance(reader, GivesTrack):
            track = reader.track()
            t_s, lon_deg, lat_deg = track.t_s, track.lon_deg, track.lat_deg
        elif isinstance(reader, GivesPoses):
            poses = reader.poses()
            if poses.projected:
                return _projected_beginning(recording, float(poses.position[0, 0]), float(poses.position[0, 1]))
            t_s, lon_deg, lat_deg = poses.t_s, poses.position[:, 0], poses.position[:, 1]
        else:
            return _Beginning()
    except InputError as error:
        return _Beginning(fault=f"{recording.path.name} does not tell where it was made. {error.what}")
    known = np.flatnonzero(np.isfinite(lon_deg) & np.isfinite(lat_deg))
    if not len(known):
        return _Beginning(fault=f"{recording.path.name} does not tell where it was made: no positions.")
    return _Beginning(
        crs=choose_crs(float(lon_deg[known[0]]), float(lat_deg[known[0]])),
        date=iso_utc(float(t_s[0])).partition("T")[0] if near_s is not None else None,
    )


def _projected_beginning(recording: Examined, e_m: float, n_m: float) -> _Beginning:
    """The CRS of eastings and northings that begin with these, if their file tells longitude and latitude as well.

    A CRS in which the place lies elsewhere is not proposed: the trajectory would be taken for one in that CRS.
    """
    place = recording.inspection.facts.get("place")
    if place is None:
        return _Beginning()
    crs = choose_crs(place["lon_deg"], place["lat_deg"])
    if crs is None:
        return _Beginning()
    there_m = Transformer.from_crs("EPSG:4326", crs.code, always_xy=True).transform(place["lon_deg"], place["lat_deg"])
    if math.dist(there_m, (e_m, n_m)) > _SAME_PLACE_M:
        return _Beginning(
            fault=f"{recording.path.name} holds eastings and northings that are not those of {crs.code}, in whose area "
            "its latitudes and longitudes lie: state the CRS that they are in."
        )
    return _Beginning(crs=crs)


def _crs_found(crs: CrsChoice | None) -> list[Notice]:
    if crs is None:
        return []
    chosen = Notice("crs", f"CRS {crs.code} ({crs.name}): {crs.reason}.")
    return [chosen, *(Notice("crs-alternative", f"Or {other}.") for other in crs.alternatives)]


def _missing(crs: CrsChoice | None, *, scans: bool, states: bool, gnss: bool, poses: bool) -> list[Notice]:
    """What the recordings do not tell."""
    texts = {
        "no-lidar": f"A laser scanner's recording: replace {UNKNOWN} in [recording] lidar."
        if not (scans or states)
        else "",
        "no-positions": f"A GNSS log or a trajectory: replace {UNKNOWN} in [recording] gnss."
        if not (gnss or poses)
        else "",
        "no-crs": f"The map's CRS: no recording tells where it was made; replace {UNKNOWN} in [crs] map."
        if crs is None
        else "",
        "no-mounting": "How the scanner is mounted: [lidar] xyz_m and rpy_deg. Until then it counts as upright at the "
        "vehicle's origin."
        if scans or not states
        else "",
        "no-antenna": "Where the GNSS antenna is: [antenna] xyz_m. Until then it counts as at the vehicle's origin."
        if not poses
        else "",
        "no-implement": "The tool: [implement] width_m and xy_m. Without them no ground worked is computed."
        if not states
        else "Where the tool is: [implement] xy_m. Until then it counts as at the positions.",
    }
    return [Notice(code, text) for code, text in texts.items() if text]


def _head(folder: Path) -> str:
    return f"""\
# A session as `furrowmap init` proposes it. Lines that begin with a hash sign are not read: go over them, measure what
# they ask for, and remove the sign.
furrowmap = {SCHEMA}
name = {_quoted(folder.resolve().name or "session")}
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
        lines.append(f"lidar = {_names(lidar, folder) or _listed([UNKNOWN])}")
    if gnss or not poses:
        positions = [(recording, recording.position_clock) for recording in gnss]
        lines += [*_described(positions), f"gnss = {_names(gnss, folder) or _listed([UNKNOWN])}"]
    tasks = [
        (name, facts) for recording in states for name, facts in recording.inspection.facts.get("tasks", {}).items()
    ]
    if len(tasks) > 1:
        lines += ["# The task that is meant; without it all are read as one drive:"]
        lines += [f"# task = {_quoted(name)}   # {printable(str(facts.get('field')))}" for name, facts in tasks]
    return "\n".join(lines)


def _times(matches: Sequence[str], date: str | None, *, undated: bool) -> str:
    """The keys of `[recording]` about clocks."""
    lines = [f"# {printable(text)}" for text in matches]
    lines += ["# Lidar clock minus GNSS clock in seconds, where they differ by a constant:", "lidar_minus_gnss_s = 0.0"]
    if undated:
        lines += ["# UTC date of the first position: the log itself tells none."]
        lines += [f"date = {_quoted(date)}   # by the scanner's clock" if date else '# date = "2026-06-11"']
    return "\n".join([*lines, ""])


def _crs(crs: CrsChoice | None) -> str:
    if crs is None:
        words, code = ["The map's projected CRS: its place could not be found out."], UNKNOWN
    else:
        words, code = [f"{crs.name}: {crs.reason}.", *(f"Or {other}." for other in crs.alternatives)], crs.code
    comments = "\n".join(f"# {printable(line)}" for line in words)
    return f"""\
[crs]
{comments}
map = {_quoted(code)}
heights = "ellipsoidal"
coordinates = "as-recorded"
"""


def _trajectory(poses: Sequence[Examined], folder: Path) -> str:
    comments = "\n".join(_described([(recording, recording.position_clock) for recording in poses]))
    return f"""\
# A trajectory from elsewhere takes the place of GNSS.
[trajectory]
{comments}
files = {_names(poses, folder)}
# time = "utc"   # or "gps", where the file does not say
"""


def _implement(states: Sequence[Examined], folder: Path) -> str:
    """The tool of which recordings say when it worked, as wide as they say."""
    widths = [width for recording in states if (width := recording.inspection.facts.get("width_m"))]
    width = (
        f"{widths[0]}   # the widest that was logged at work" if widths else "1.0   # FILL-IN: nothing says how wide"
    )
    return f"""\
# The tool: width, and the middle of its line in the vehicle frame. The ground worked is computed from them.
[implement]
width_m = {width}
xy_m = [0.0, 0.0]   # FILL-IN: counted from the rear axle; until then the positions are those of the tool
states = {_names(states, folder)}
"""


def _lidar(lidar: Sequence[Examined]) -> str:
    model = next((model for r in lidar if (model := _model(r.inspection.facts))), None)
    stated = f"model = {_quoted(model)}   # as the recording says\n" if model else ""
    return f"[lidar]\n{stated}{_MOUNTING}"


def _model(facts: Mapping[str, Any]) -> str | None:
    """The scanner's model in the facts of a recording, or of what a container holds under "scans"."""
    within = facts.get("scans")
    model = facts.get("model") or (within.get("model") if isinstance(within, Mapping) else None)
    return str(model) if model else None


def _described(recordings: Sequence[tuple[Examined, ClockReading | None]]) -> list[str]:
    """A comment on each recording, with the clock of what is taken from it."""
    lines = []
    for recording, clock in recordings:
        span = f", {iso_utc(clock.first_s)} to {iso_utc(clock.last_s)} ({clock.clock.value})" if clock else ""
        lines.append(f"# {printable(recording.path.name)}: {printable(recording.inspection.title)}{span}")
    return lines


def _names(recordings: Sequence[Examined], folder: Path) -> str:
    """The recordings' paths from `folder` as a TOML list; empty text without any."""
    names = []
    for path in (recording.path.resolve() for recording in recordings):
        if not path.is_relative_to(folder.resolve()):
            raise InputError(
                f"{path} lies outside {folder}, where the session file is to stand.",
                "A session may only name files beside or below itself.",
                "Put the session file at or above the recordings' folder, or copy the recording beside it.",
                code="session-path-outside",
            )
        names.append(path.relative_to(folder.resolve()).as_posix())
    return _listed(names) if names else ""


def _listed(names: Sequence[str]) -> str:
    return f"[{', '.join(_quoted(name) for name in names)}]"


def _quoted(text: str) -> str:
    """`text` as a TOML basic string; JSON's escapes are among TOML's, and DEL is all that JSON leaves bare.

    Raises:
        InputError: if it is a file name with bytes that are no text.
    """
    try:
        text.encode("utf-8")
    except UnicodeEncodeError:
        raise InputError(
            f"{printable(text)}: the name is not valid UTF-8.",
            "A session file is UTF-8 text and cannot name it.",
            "Rename the file.",
            code="name-not-text",
        ) from None
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
