"""Reading and validation of session files; every error names the key."""

from __future__ import annotations

import datetime as dt
import difflib
import itertools
import math
import posixpath
import re
import tomllib
import zoneinfo
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, get_args

import msgspec
from msgspec.inspect import is_struct_type, type_info

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.file_signatures import TEXT_HEAD_BYTES, binary_kind
from furrowmap.core.runtime.languages.texts import Text, Words
from furrowmap.core.runtime.plain_reads import open_plain
from furrowmap.core.session.session_camera import camera_faults
from furrowmap.core.session.value_faults import value_faults
from furrowmap.core.values.inertial import IMU_CLASSES, IMU_MODELS
from furrowmap.core.values.pose_track import MAGNETIC_NORTH
from furrowmap.core.values.session import (
    CHECK,
    CURRENT_EPOCH,
    ELLIPSOIDAL,
    EXAMPLES,
    SESSION_SCHEMA,
    Implement,
    Session,
)

if TYPE_CHECKING:
    from furrowmap.core.values.machine import MachineImplement

MAX_PLACE_M: Final = 15.0
"""Largest plausible distance from the vehicle origin; larger values are millimetres or centimetres."""

FURTHER: Final = {"implement": "further_implements", "lidar": "further_lidars"}
"""Tables of which there may be several, and where a session keeps the others than the first."""
MAX_IMPLEMENTS: Final = 3
"""Implements of one machine: in front, between the axles, behind."""
MAX_LIDARS: Final = 4
"""Scanners of one machine: one on each side."""
MAX_TOML_LENGTH: Final = 4_000_000
_LONG_KEY: Final = re.compile(r"""(?<![\w"'.-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){32}""")
"""A key of more than 32 parts; it cannot go back, so that the time grows with the length alone."""
MAX_TOML_INTEGER: Final = 2**63
"""Integers have 64 bits (TOML 1.0.0, "Integer")."""


def parse_toml(text: str) -> dict[str, Any]:
    """The content of a TOML text; TOMLDecodeError also for integers of more than 64 bits, and what nobody writes.

    That are megabytes, deep nesting, and keys of many parts, for which the time grows with the square of their number.
    """
    if len(text) > MAX_TOML_LENGTH:
        raise tomllib.TOMLDecodeError(f"it has more than {MAX_TOML_LENGTH:,} characters")
    if _LONG_KEY.search(text) is not None:
        raise tomllib.TOMLDecodeError("a key has too many parts")
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except RecursionError:
        raise tomllib.TOMLDecodeError(Text("it is nested too deeply")) from None
    except ValueError:  # Python converts no more than 4,300 digits
        raise tomllib.TOMLDecodeError(Text("a number has too many digits")) from None

    def has_huge(value: object) -> bool:
        if isinstance(value, dict | list):
            return any(map(has_huge, value.values() if isinstance(value, dict) else value))
        return isinstance(value, int) and not -MAX_TOML_INTEGER <= value < MAX_TOML_INTEGER

    try:
        huge = has_huge(data)
    except RecursionError:  # of tables that are nested by the parts of their keys
        raise tomllib.TOMLDecodeError(Text("it is nested too deeply")) from None
    if huge:
        raise tomllib.TOMLDecodeError(Text("an integer has more than 64 bits"))
    return data


def apart(data: dict[str, Any]) -> dict[str, Any]:
    """The content of a file with the implement that moves soil as `implement`, the others as `further_implements`.

    It is the one with `moves_soil`, else the rearmost. The first of several scanners is `lidar`, the others are
    `further_lidars`; its own files and offset are those of the recording. What is not a list of tables stays as it is.
    """

    def x_m(tool: Mapping[str, Any]) -> int | float:
        """How far forward a tool is, as the file has it; accepts any integer."""
        place = tool.get("xy_m")
        found = place[0] if isinstance(place, list) and place else 0.0
        return found if isinstance(found, int | float) else 0.0

    for table, further in FURTHER.items():
        several = data.get(table)
        if isinstance(several, list) and several and all(isinstance(one, dict) for one in several):
            first = 0
            if table == "implement":
                first = min(
                    range(len(several)), key=lambda k: (several[k].get("moves_soil") is not True, x_m(several[k]))
                )
            data = data | {table: several[first], further: several[:first] + several[first + 1 :]}
    lidar = data.get("lidar")
    recording = data.get("recording")
    if isinstance(lidar, dict) and isinstance(recording, dict):
        for key, whole in (("files", "lidar"), ("minus_gnss_s", "lidar_minus_gnss_s")):
            if key in lidar and whole not in recording:
                recording = recording | {whole: lidar[key]}
                lidar = {name: value for name, value in lidar.items() if name != key}
        data = data | {"lidar": lidar, "recording": recording}
    return data


def together(data: Mapping[str, Any]) -> dict[str, Any]:
    """The reverse of :func:`apart`: what goes into a file."""
    joined = {table: [data[table], *data[further]] for table, further in FURTHER.items() if data.get(further)}
    return {key: value for key, value in data.items() if key not in FURTHER.values()} | joined


def _several_faults(tables: Sequence[Any], table: str, most: int, example: str) -> Iterator[Words]:
    """What is wrong with several tables of a kind, or with their names."""
    if len(tables) < 2:
        return
    if len(tables) > most:
        yield Text(
            "[[{table}]] is given {times} times; at most {most} are allowed",
            table=table,
            times=len(tables),
            most=most,
        )
    names = [one.name.strip() for one in tables]
    if not all(names):
        yield Text(
            "each of several [[{table}]] needs a name, such as name = {example}", table=table, example=f'"{example}"'
        )
    if len(set(names)) < len(names):
        yield Text(
            "two [[{table}]] have the name {name!r}",
            table=table,
            name=next(name for name in names if names.count(name) > 1),
        )


def implement_faults(tools: Sequence[Implement | MachineImplement]) -> Iterator[Words]:
    """What is wrong with several implements, or with their names."""
    yield from _several_faults(tools, "implement", MAX_IMPLEMENTS, "front roller")
    if sum(tool.moves_soil for tool in tools) > 1:
        yield Text("implement.moves_soil is true of more than one [[implement]]")


def load_session(path: Path) -> Session:
    """Load a session file. Raises InputError if it is unreadable, no TOML, or has an unknown key or invalid value."""
    return parse_session(read_session_text(path), str(path))


def read_session_text(path: Path) -> str:
    """The text of a session file. Raises InputError if it cannot be read or is no text, of which little is read."""
    try:
        with open_plain(path) as file:
            head = file.read(TEXT_HEAD_BYTES)
            content = head if binary_kind(head) else head + file.read()
    except IsADirectoryError:
        raise InputError("session-unreadable.is-folder", path=path, path_scaled=path / "session.toml") from None
    except OSError as error:
        raise InputError("session-unreadable", path=path, why=error.strerror or error) from None
    return session_text(content, path)


def session_text(content: bytes, name: object) -> str:
    """The text of a session from the bytes of its file; `name` is that of the file in errors. Raises InputError."""
    kind = binary_kind(content[:TEXT_HEAD_BYTES])
    if kind is not None:
        raise InputError("session-unreadable", path=name, why=Text("it is {kind}, not text", kind=kind))
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        raise InputError("session-unreadable", path=name, why=Text("not UTF-8 text")) from None


def parse_session(text: str, name: str = "session.toml") -> Session:
    """Parse the session in `text`; `name` is the file name in messages. Raises InputError as :func:`load_session`."""
    try:
        data = parse_toml(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError("session-syntax", name=name, error=error) from None
    if data.get("furrowmap") != SESSION_SCHEMA:
        raise InputError("session-schema", name=name, data=data.get("furrowmap"), schema=SESSION_SCHEMA)
    # Refuse unknown keys and suggest the nearest known one, which msgspec does not do.
    tables = tuple(key for key in Session.__struct_encode_fields__ if key not in FURTHER.values())
    levels: list[tuple[str, dict[str, Any], tuple[str, ...]]] = [("", data, tables)]
    levels += [
        (f"{table}.", content, struct.__struct_encode_fields__)
        for table, struct in _tables().items()
        for content in (data[table] if table in FURTHER and isinstance(data.get(table), list) else [data.get(table)])
        if isinstance(content, dict)
    ]
    for prefix, table, known in levels:
        for key in table:
            if key not in known:
                near = difflib.get_close_matches(key, known, 1, 0.5)
                raise InputError(
                    "session-unknown-key",
                    name=name,
                    prefix=prefix,
                    key=key,
                    near_first=near[0] if near else None,
                    known=", ".join(known) if not (near) else None,
                )
    data = apart(data)
    recording = data.get("recording")
    if isinstance(recording, dict) and isinstance(recording.get("date"), dt.date):
        recording["date"] = str(recording["date"])  # an unquoted date is a date in TOML
    try:
        session = msgspec.convert(data, Session)
    except msgspec.ValidationError as error:
        raise _conversion_error(data, name, str(error)) from None
    fault = next(_faults(session), None)
    if fault is not None:
        raise InputError("session-value.check-values", name=name, fault=fault)
    return session


def _tables() -> dict[str, type[msgspec.Struct]]:
    """The table names and their structs."""
    fields = (field for field in msgspec.structs.fields(Session) if field.name not in FURTHER.values())
    kinds = ((field.name, (field.type, *get_args(field.type))) for field in fields)
    return {name: kind for name, alternatives in kinds for kind in alternatives if is_struct_type(kind)}


def _conversion_error(data: dict[str, Any], name: str, otherwise: str) -> InputError:
    """The error of the first key that is missing or has a value of a wrong type; `otherwise` is what msgspec says."""
    found = next(value_faults(type_info(Session), data), None)
    path = found.path if found is not None else ""
    for table, further in FURTHER.items():
        path = re.sub(rf"^{further}\[[^]]*\]", table, path)
    key = re.sub(r"\[.*", "", path)
    table, _, last = key.rpartition(".")
    subject = f"table [{key}]" if key in _tables() else f"key `{key if found and not found.fault else path}`"
    what = f"{subject} {found.fault or 'is missing'}" if found is not None else otherwise
    return InputError(
        "session-value",
        name=name,
        what=what,
        line=key in EXAMPLES or key in _tables(),
        last=last,
        examples=EXAMPLES.get(key),
        in_tables=key in _tables(),
        key=key,
        table=table or None,
    )


def _faults(session: Session) -> Iterator[Words]:
    """The faults of the values."""
    for key, number in _numbers(msgspec.to_builtins(session)):
        if not math.isfinite(number):
            yield Text("{key} must be finite, not {value}", key=key, value=number)
    implement = session.implement
    flies = session.imu is not None or session.attitude is not None  # its trajectory is worth having alone
    if not session.recording.lidar and not any(tool.states for tool in session.implements) and not flies:
        yield Text("recording.lidar names no file, and neither does implement.states, imu.files or attitude.roll_pitch")
    if not session.recording.gnss and session.trajectory is None:
        yield Text("recording.gnss names no file, and there is no [trajectory]")
    if session.crs.parameters is not None and session.crs.coordinates != CURRENT_EPOCH:
        yield Text(
            "crs.parameters needs crs.coordinates = {wanted!r}, not {stated!r}",
            wanted=CURRENT_EPOCH,
            stated=session.crs.coordinates,
        )
    antenna = session.antenna
    if antenna is not None and (antenna.model is None) != (antenna.antex is None):
        yield Text(
            "antenna.model and antenna.antex need each other: the name of the antenna, and the file with its model"
        )
    if session.field.time_zone is not None and session.field.time_zone not in zoneinfo.available_timezones():
        yield Text(
            "field.time_zone {zone!r} is no time zone of the IANA database, such as 'Asia/Tokyo'",
            zone=session.field.time_zone,
        )
    if session.crs.geoid_grid is not None and session.crs.heights == ELLIPSOIDAL:
        yield Text("crs.geoid_grid needs heights above a geoid, but crs.heights is {heights!r}", heights=ELLIPSOIDAL)
    yield from _repetitions(session)
    yield from camera_faults(session.camera)
    if session.recording.date is not None:
        try:
            dt.date.fromisoformat(session.recording.date)
        except ValueError:
            yield Text("recording.date must be a date such as '2026-06-11', not {date!r}", date=session.recording.date)
    if session.recording.span_s[0] >= session.recording.span_s[1]:
        yield Text("recording.to must be later than recording.from")
    yield from _far_places(session)
    if session.imu is not None:
        known = (*IMU_CLASSES, *IMU_MODELS)
        if not session.imu.files:
            yield Text("imu.files names no file")
        if session.imu.kind not in known:
            kind = session.imu.kind
            yield Text(
                "imu.class must be one of {known}, not {kind!r}; imu.noise states other figures",
                known=known,
                kind=kind,
            )
        if session.imu.heading == "attitude" and session.attitude is None:
            yield Text("imu.heading is 'attitude', which needs [attitude] with the log of headings")
    if session.lidar.rpy_walk_deg_rts and (session.imu is None or implement is not None):
        yield Text("lidar.rpy_walk_deg_rts needs [imu] and no [implement]: only strips of a flight show such a change")
    attitude = session.attitude
    if attitude is not None and attitude.north == MAGNETIC_NORTH and attitude.declination_deg is None:
        yield Text("attitude.north is 'magnetic', which needs attitude.declination_deg (positive east)")
    yield from implement_faults(session.implements)
    yield from _lidar_faults(session)
    if any(tool.states_use == CHECK for tool in session.implements) and not session.recording.lidar:
        yield Text("implement.states_use is {use!r}, which needs recording.lidar", use=CHECK)
    if session.trajectory is not None and not session.trajectory.files:
        yield Text("trajectory.files names no file")
    for region_m in (tool.region_m for tool in session.implements if tool.region_m is not None):
        x0, x1, y0, y1 = region_m
        if not (x0 < x1 and y0 < y1):
            yield Text("implement.region_m must be [x_min, x_max, y_min, y_max] with each minimum below its maximum")
        if max(abs(value) for value in region_m) > MAX_PLACE_M:
            yield Text(
                "implement.region_m reaches farther than {most_m:g} m from the rear axle (the unit is metres)",
                most_m=MAX_PLACE_M,
            )


def _lidar_faults(session: Session) -> Iterator[Words]:
    """What is wrong with several scanners."""
    lidars = session.lidars
    yield from _several_faults(lidars, "lidar", MAX_LIDARS, "front")
    recording = session.recording
    if lidars[0].files != recording.lidar:
        yield Text("lidar.files of the first scanner and recording.lidar differ; state one of them")
    if lidars[0].minus_gnss_s != recording.lidar_minus_gnss_s:
        yield Text("lidar.minus_gnss_s of the first scanner and recording.lidar_minus_gnss_s differ; state one of them")
    read = [(set(lidar.files), lidar.source) for lidar in lidars]
    for (files, source), (others, other) in itertools.combinations(read, 2):
        if files & others and (source is None or other is None or source == other):
            yield Text(
                "two [[lidar]] read the same file; each needs its own lidar.source there, or its own lidar.files"
            )
    if len(lidars) > 1 and session.mount is not None:
        yield Text("[mount] moves one scanner, but there are several [[lidar]]")


def _far_places(session: Session) -> Iterator[Words]:
    """Implausibly far positions in the vehicle frame, which were given in another unit."""
    tables = ("imu", "mount", "camera", "antenna")
    places: list[tuple[str, tuple[float, ...] | None]] = [("lidar.xyz_m", lidar.xyz_m) for lidar in session.lidars]
    places += [(f"{table}.xyz_m", getattr(getattr(session, table), "xyz_m", None)) for table in tables]
    places += [("implement.xy_m", tool.xy_m) for tool in session.implements]
    for key, place in places:
        if place is None:
            continue
        far_m = max(place, key=abs)
        if abs(far_m) > MAX_PLACE_M:
            yield Text(
                "{key} holds {value:g}, more than {most_m:g} m from the rear axle (the unit is metres)",
                key=key,
                value=far_m,
                most_m=MAX_PLACE_M,
            )


def _repetitions(session: Session) -> Iterator[Words]:
    """Files that a key names twice; their scans or positions would count twice."""
    trajectory = session.trajectory.files if session.trajectory is not None else ()
    for key, names in (
        ("recording.lidar", session.recording.lidar),
        *(("lidar.files", lidar.files) for lidar in session.further_lidars),
        ("recording.gnss", session.recording.gnss),
        *(("implement.states", tool.states) for tool in session.implements),
        ("trajectory.files", trajectory),
        ("imu.files", session.imu.files if session.imu is not None else ()),
    ):
        paths = [posixpath.normpath(name) for name in names]
        for k, path in enumerate(paths):
            if path in paths[:k]:
                yield Text("{key} names {path!r} twice", key=key, path=path)


def _numbers(value: Any, key: str = "") -> Iterator[tuple[str, float]]:
    """All floats in nested dicts and lists, each with the key of the dict that holds it."""
    if isinstance(value, float):
        yield key, value
    elif isinstance(value, dict):
        for name, item in value.items():
            yield from _numbers(item, f"{key}.{name}" if key else name)
    elif isinstance(value, list | tuple):
        for item in value:
            yield from _numbers(item, key)
