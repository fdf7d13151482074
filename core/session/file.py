"""Reading and validation of session files; every error names the key."""

from __future__ import annotations

import datetime as dt
import difflib
import math
import posixpath
import re
import tomllib
import zoneinfo
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, Literal, get_args, get_origin

import msgspec
from msgspec.inspect import is_struct_type

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.foreign_content import LOOKED_AT, binary_kind
from furrowmap.core.runtime.toml_text import parse_toml
from furrowmap.core.session.camera import camera_faults
from furrowmap.core.session.implements import FURTHER, TABLE, apart, implement_faults
from furrowmap.core.values.attitude import MAGNETIC
from furrowmap.core.values.inertial import IMU_CLASSES, IMU_MODELS
from furrowmap.core.values.session import (
    CHECK,
    CURRENT_EPOCH,
    ELLIPSOIDAL,
    EXAMPLES,
    SCHEMA,
    Imu,
    Session,
)

FARTHEST_M: Final = 15.0
"""Largest plausible distance from the vehicle origin; larger values are millimetres or centimetres."""

REFERENCE: Final = "The reference page docs/reference/session.md describes each key"

_KINDS: Final = {
    "str": "text in double quotes",
    "int": "a whole number",
    "float": "a number",
    "bool": "true or false",
    "array": "a list in square brackets",
    "object": "a table",
    "null": "nothing",
    "date": "a date alone",
    "datetime": "a date and time with its offset from UTC",
}
"""Type names of msgspec and of this module's messages."""


def load_session(path: Path) -> Session:
    """Load the session file `path`.

    Raises:
        InputError: if the file cannot be read, is not TOML, or has an unknown key or an invalid value.
    """
    try:
        with path.open("rb") as file:
            head = file.read(LOOKED_AT)
            kind = binary_kind(head)
            text = "" if kind else (head + file.read()).decode("utf-8")
    except IsADirectoryError:
        raise InputError("session-unreadable.load-session", path=path, path_scaled=path / "session.toml") from None
    except (OSError, UnicodeDecodeError) as error:
        raise _unreadable(path, getattr(error, "strerror", None) or "not UTF-8 text") from None
    if kind is not None:
        raise _unreadable(path, f"it is {kind}, not text")
    return parse_session(text, str(path))


def _unreadable(path: Path, why: str) -> InputError:
    return InputError("session-unreadable", path=path, why=why)


def parse_session(text: str, name: str = "session.toml") -> Session:
    """Parse the session in `text`; `name` is the file name in messages.

    Raises:
        InputError: as :func:`load_session`.
    """
    try:
        data = parse_toml(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError("session-syntax", name=name, error=error) from None
    if data.get("furrowmap") != SCHEMA:
        raise InputError("session-schema", name=name, data=data.get("furrowmap"), schema=SCHEMA)
    _check_keys(data, name)
    data = apart(data)
    recording = data.get("recording")
    if isinstance(recording, dict) and isinstance(recording.get("date"), dt.date):
        recording["date"] = str(recording["date"])  # an unquoted date is a date in TOML
    try:
        session = msgspec.convert(data, Session)
    except msgspec.ValidationError as error:
        raise _conversion_error(str(error), name) from None
    _check_values(session, name)
    return session


def _tables() -> dict[str, type[msgspec.Struct]]:
    """The table names and their structs."""
    fields = (field for field in msgspec.structs.fields(Session) if field.name != FURTHER)
    kinds = ((field.name, (field.type, *get_args(field.type))) for field in fields)
    return {name: kind for name, alternatives in kinds for kind in alternatives if is_struct_type(kind)}


def _check_keys(data: dict[str, Any], name: str) -> None:
    """Refuse unknown keys and suggest the nearest known one, which msgspec does not do."""
    tables = tuple(key for key in Session.__struct_encode_fields__ if key != FURTHER)
    levels: list[tuple[str, dict[str, Any], tuple[str, ...]]] = [("", data, tables)]
    levels += [
        (f"{table}.", content, struct.__struct_encode_fields__)
        for table, struct in _tables().items()
        for content in _contents(data.get(table), several=table == TABLE)
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


def _contents(value: Any, *, several: bool) -> list[dict[str, Any]]:
    """The tables that a name stands for; no other value is one."""
    values = value if several and isinstance(value, list) else [value]
    return [content for content in values if isinstance(content, dict)]


def _conversion_error(message: str, name: str) -> InputError:
    """Convert an error of msgspec about a missing key or a wrong type."""
    reason, _, path = message.partition(" - at `$.")
    path = re.sub(rf"^{FURTHER}\[[^]]*\]", TABLE, path.rstrip("`"))
    missing = re.fullmatch(r"Object missing required field `(.+)`", reason)
    if missing is not None:
        path = f"{path}.{missing[1]}" if path else missing[1]
    key = re.sub(r"\[.*", "", path)
    if missing is not None:
        what = f"table [{key}] is missing" if key in _tables() else f"key `{key}` is missing"
    else:
        what = f"table [{key}]" if key in _tables() else f"key `{path}`"
        what += f" {_type_fault(reason, _choices(key))}"
    table, _, last = key.rpartition(".")
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


def _choices(key: str) -> list[str]:
    """The texts that a key allows, where it allows no others."""
    table, _, name = key.rpartition(".")
    fields = msgspec.structs.fields(_tables().get(table, Session))
    kinds = (kind for field in fields if field.name == name for kind in (field.type, *get_args(field.type)))
    return [text for kind in kinds if get_origin(kind) is Literal for text in get_args(kind)]


def _type_fault(message: str, choices: list[str]) -> str:
    """What is wrong with a value, from the message of msgspec and what the key allows."""
    kinds = re.fullmatch(r"Expected `(.+?)(?: \| null)?`, got `(.+)`", message)
    if kinds is not None:
        wanted, got = (_KINDS.get(kind, kind) for kind in kinds.groups())
        return f"must be {wanted}, not {got}"
    counts = re.fullmatch(r"Expected `array` of length (\d+), got (\d+)", message)
    if counts is not None:
        return f"must be a list of {counts[1]} numbers, but has {counts[2]}"
    limit = re.fullmatch(r"Expected `\w+` (.+)", message)
    if limit is not None and "timezone" not in limit[1]:
        return f"must be {limit[1]}"
    choice = re.fullmatch(r"Invalid enum value (.+)", message)
    if choice is not None:
        return f"must be {' or '.join(map(repr, choices))}, not {choice[1]}"
    if "datetime" in message:
        return f"must be {_KINDS['datetime']}"
    return f"is invalid ({message})"


def _check_values(session: Session, name: str) -> None:
    """Refuse values that no session can have."""
    fault = next(_faults(session), None)
    if fault is not None:
        raise InputError("session-value.check-values", name=name, fault=fault)


def _faults(session: Session) -> Iterator[str]:
    """The faults of the values."""
    for key, number in _numbers(msgspec.to_builtins(session)):
        if not math.isfinite(number):
            yield f"{key} must be finite, not {number}"
    implement = session.implement
    if not session.recording.lidar and not any(tool.states for tool in session.implements) and not _flies(session):
        yield "recording.lidar names no file, and neither does implement.states, imu.files or attitude.roll_pitch"
    if not session.recording.gnss and session.trajectory is None:
        yield "recording.gnss names no file, and there is no [trajectory]"
    if session.crs.parameters is not None and session.crs.coordinates != CURRENT_EPOCH:
        yield f'crs.parameters needs crs.coordinates = "{CURRENT_EPOCH}", not {session.crs.coordinates!r}'
    if session.field.time_zone is not None and session.field.time_zone not in zoneinfo.available_timezones():
        yield f'field.time_zone "{session.field.time_zone}" is no time zone of the IANA database, such as "Asia/Tokyo"'
    if session.crs.geoid_grid is not None and session.crs.heights == ELLIPSOIDAL:
        yield f'crs.geoid_grid needs heights above a geoid, but crs.heights is "{ELLIPSOIDAL}"'
    yield from _repetitions(session)
    yield from camera_faults(session.camera)
    if session.recording.date is not None and not _is_date(session.recording.date):
        yield f'recording.date must be a date such as "2026-06-11", not {session.recording.date!r}'
    if session.recording.span_s[0] >= session.recording.span_s[1]:
        yield "recording.to must be later than recording.from"
    yield from _far_places(session)
    if session.imu is not None:
        yield from _imu_faults(session.imu)
        if session.imu.heading == "attitude" and session.attitude is None:
            yield 'imu.heading is "attitude", which needs [attitude] with the log of headings'
    if session.lidar.rpy_walk_deg_rts and (session.imu is None or implement is not None):
        yield "lidar.rpy_walk_deg_rts needs [imu] and no [implement]: only strips of a flight show such a change"
    attitude = session.attitude
    if attitude is not None and attitude.north == MAGNETIC and attitude.declination_deg is None:
        yield 'attitude.north is "magnetic", which needs attitude.declination_deg (positive east)'
    yield from implement_faults(session.implements)
    if any(tool.states_use == CHECK for tool in session.implements) and not session.recording.lidar:
        yield f'implement.states_use is "{CHECK}", which needs recording.lidar'
    if session.trajectory is not None and not session.trajectory.files:
        yield "trajectory.files names no file"
    for region_m in (tool.region_m for tool in session.implements if tool.region_m is not None):
        x0, x1, y0, y1 = region_m
        if not (x0 < x1 and y0 < y1):
            yield "implement.region_m must be [x_min, x_max, y_min, y_max] with each minimum below its maximum"
        if max(abs(value) for value in region_m) > FARTHEST_M:
            yield f"implement.region_m reaches farther than {FARTHEST_M:g} m from the rear axle (the unit is metres)"


def _flies(session: Session) -> bool:
    """Whether a run gives a trajectory that is worth having alone."""
    return session.imu is not None or session.attitude is not None


def _imu_faults(imu: Imu) -> Iterator[str]:
    """The faults of the table of the IMU."""
    if not imu.files:
        yield "imu.files names no file"
    known = (*IMU_CLASSES, *IMU_MODELS)
    if imu.kind not in known:
        yield f"imu.class must be one of {', '.join(known)}, not {imu.kind!r}; imu.noise states other figures"


def _far_places(session: Session) -> Iterator[str]:
    """Implausibly far positions in the vehicle frame, which were given in another unit."""
    places: list[tuple[str, tuple[float, ...]]] = [("lidar.xyz_m", session.lidar.mounting.xyz_m)]
    if session.imu is not None:
        places.append(("imu.xyz_m", session.imu.xyz_m))
    if session.mount is not None and session.mount.xyz_m is not None:
        places.append(("mount.xyz_m", session.mount.xyz_m))
    if session.camera is not None:
        places.append(("camera.xyz_m", session.camera.xyz_m))
    if session.antenna is not None:
        places.append(("antenna.xyz_m", session.antenna.xyz_m))
    places += [("implement.xy_m", tool.xy_m) for tool in session.implements]
    for key, place in places:
        far_m = max(place, key=abs)
        if abs(far_m) > FARTHEST_M:
            yield f"{key} holds {far_m:g}, more than {FARTHEST_M:g} m from the rear axle (the unit is metres)"


def _repetitions(session: Session) -> Iterator[str]:
    """Files that a key names twice; their scans or positions would count twice."""
    trajectory = session.trajectory.files if session.trajectory is not None else ()
    for key, names in (
        ("recording.lidar", session.recording.lidar),
        ("recording.gnss", session.recording.gnss),
        *(("implement.states", tool.states) for tool in session.implements),
        ("trajectory.files", trajectory),
        ("imu.files", session.imu.files if session.imu is not None else ()),
    ):
        paths = [posixpath.normpath(name) for name in names]
        for k, path in enumerate(paths):
            if path in paths[:k]:
                yield f"{key} names {path!r} twice"


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


def _is_date(text: str) -> bool:
    try:
        dt.date.fromisoformat(text)
    except ValueError:
        return False
    return True
