"""A session file, read and refused where it cannot be meant, in words that name the key."""

from __future__ import annotations

import datetime as dt
import difflib
import math
import posixpath
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import msgspec

from furrowmap.core.values.errors import InputError
from furrowmap.core.values.session import (
    CHECK,
    CURRENT_EPOCH,
    ELLIPSOIDAL,
    REPLACE,
    SCHEMA,
    Antenna,
    Crs,
    Field,
    Implement,
    Lidar,
    Recording,
    Run,
    Session,
    TrajectorySource,
)

MOST_LIFT_M: Final = 1.2
"""No tool is lifted higher."""
FARTHEST_M: Final = 15.0
"""No sensor, antenna or tool is farther from the vehicle's origin; larger figures are millimetres or centimetres."""

REFERENCE: Final = "The reference page session.toml (docs/reference/session.md) shows each key"

_KINDS: Final = {
    "str": "text in double quotes",
    "int": "a whole number",
    "float": "a number",
    "bool": "true or false",
    "array": "a list in square brackets",
    "object": "a table",
    "null": "nothing",
}
"""What msgspec calls a kind of value, and what it is in a session file."""

_EXAMPLES: Final = {
    "name": '"North field"',
    "recording.lidar": '["recording.pcap"]',
    "recording.gnss": '["gnss.nmea"]',
    "recording.lidar_minus_gnss_s": "0.0",
    "recording.date": '"2026-06-11"',
    "recording.task": '"TSK1"',
    "crs.map": '"EPSG:6677"',
    "crs.heights": '"EGM2008"',
    "crs.coordinates": '"current-epoch"',
    "crs.parameters": '"SemiDyna2026.par"',
    "crs.geoid_grid": '"us_nga_egm08_25.tif"',
    "antenna.xyz_m": "[1.85, 0.0, 1.62]",
    "lidar.model": '"VLP-16"',
    "lidar.xyz_m": "[-0.55, 0.0, 2.35]",
    "lidar.rpy_deg": "[0.0, 40.0, 180.0]",
    "implement.kind": '"rotary tiller"',
    "implement.width_m": "1.70",
    "implement.xy_m": "[-1.45, 0.0]",
    "implement.working_depth_m": "0.12",
    "implement.lift_m": "0.45",
    "implement.region_m": "[-3.5, -0.9, -1.2, 1.2]",
    "implement.learned": '"implement.npz"',
    "implement.states": '["states.csv"]',
    "implement.states_use": '"replace"',
    "implement.states_minus_gnss_s": "0.0",
    "field.boundary": '"boundary.geojson"',
    "trajectory.files": '["trajectory.csv"]',
    "trajectory.time": '"utc"',
    "trajectory.week": "2422",
    "run.standing": "true",
    "run.fixes": '["fixed", "float"]',
    "run.threads": "2",
}
"""A value for every key."""


def load_session(path: Path) -> Session:
    """The session in the file `path`.

    Raises:
        InputError: if the file cannot be read, is no TOML, or holds an unknown key or a value of the wrong kind.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except IsADirectoryError:
        raise InputError(
            f"{path} is a folder, not a session file.",
            "The session could not be read.",
            f"Give the file in it: {path / 'session.toml'}",
            code="session-unreadable",
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            f"{path}: {getattr(error, 'strerror', None) or 'not UTF-8 text'}.",
            "The session could not be read.",
            "Give the path of a session.toml; `furrowmap init RECORDING...` writes one.",
            code="session-unreadable",
        ) from None
    return parse_session(text, str(path))


def parse_session(text: str, name: str = "session.toml") -> Session:
    """The session written in `text`; `name` stands for the file in messages.

    Raises:
        InputError: as :func:`load_session`.
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(
            f"{name}: {error}.",
            "The file is not valid TOML, so none of it was used.",
            "Mend the place named above; strings stand in double quotes, lists in square brackets.",
            code="session-syntax",
        ) from None
    if data.get("furrowmap") != SCHEMA:
        version = f"is {data['furrowmap']!r} where this version reads {SCHEMA}" if "furrowmap" in data else "is missing"
        raise InputError(
            f"{name}: key `furrowmap`, the version of the file's form, {version}.",
            "The meaning of the other keys cannot be taken for granted.",
            f"Write `furrowmap = {SCHEMA}` at the top if the file follows this version's documentation.",
            code="session-schema",
        )
    _check_keys(data, name)
    recording = data.get("recording")
    if isinstance(recording, dict) and isinstance(recording.get("date"), dt.date):
        recording["date"] = str(recording["date"])  # TOML has dates of its own, without quotes
    try:
        session = msgspec.convert(data, Session)
    except msgspec.ValidationError as error:
        raise _misfit(str(error), name) from None
    _check_values(session, name)
    return session


def _tables() -> dict[str, type[msgspec.Struct]]:
    """Each table's name in the file and the struct behind it."""
    return {
        "recording": Recording,
        "crs": Crs,
        "antenna": Antenna,
        "lidar": Lidar,
        "implement": Implement,
        "field": Field,
        "trajectory": TrajectorySource,
        "run": Run,
    }


def _check_keys(data: dict[str, Any], name: str) -> None:
    """Refuse unknown keys, naming the nearest known one: msgspec would only say that they are unknown."""
    levels: list[tuple[str, dict[str, Any], tuple[str, ...]]] = [("", data, Session.__struct_fields__)]
    levels += [
        (f"{table}.", data[table], struct.__struct_fields__)
        for table, struct in _tables().items()
        if isinstance(data.get(table), dict)
    ]
    for prefix, table, known in levels:
        for key in table:
            if key not in known:
                near = difflib.get_close_matches(key, known, 1, 0.5)
                raise InputError(
                    f"{name}: unknown key `{prefix}{key}`.",
                    "A misspelt key would silently leave a default in place, so the session is refused.",
                    f"Did you mean `{prefix}{near[0]}`?" if near else f"Known here: {', '.join(known)}.",
                    code="session-unknown-key",
                )


def _misfit(message: str, name: str) -> InputError:
    """The error of a key that is missing or of the wrong kind, in plain words, from what msgspec says of it."""
    said, _, path = message.partition(" - at `$.")
    path = path.rstrip("`")
    missing = re.fullmatch(r"Object missing required field `(.+)`", said)
    if missing is not None:
        path = f"{path}.{missing[1]}" if path else missing[1]
    key = re.sub(r"\[.*", "", path)
    if missing is not None:
        what = f"table [{key}] is missing" if key in _tables() else f"key `{key}` is missing"
    else:
        what = f"table [{key}]" if key in _tables() else f"key `{path}`"
        what += f" {_kind_fault(said)}"
    table, _, last = key.rpartition(".")
    line = f"{last} = {_EXAMPLES[key]}" if key in _EXAMPLES else f"[{key}]" if key in _tables() else ""
    example = f"Write for example `{line}`{f' under [{table}]' if table else ''}. " if line else ""
    return InputError(
        f"{name}: {what}.",
        "The session is not complete or not of the right kind there, so nothing was done.",
        f"{example}{REFERENCE}; `furrowmap init` writes a commented file.",
        code="session-value",
    )


def _kind_fault(said: str) -> str:
    """What is wrong with a value, from the words of msgspec; its own where they are of no known form."""
    kinds = re.fullmatch(r"Expected `(.+?)(?: \| null)?`, got `(.+)`", said)
    if kinds is not None:
        wanted, got = (_KINDS.get(kind, kind) for kind in kinds.groups())
        return f"must be {wanted}, not {got}"
    counts = re.fullmatch(r"Expected `array` of length (\d+), got (\d+)", said)
    if counts is not None:
        return f"must be a list of {counts[1]} numbers, and has {counts[2]}"
    return f"is of the wrong kind ({said})"


def _check_values(session: Session, name: str) -> None:
    """Refuse what no session can mean."""
    fault = next(_faults(session), None)
    if fault is not None:
        raise InputError(
            f"{name}: {fault}.",
            "Nothing sensible can be computed with that.",
            f"Correct the session file. {REFERENCE}.",
            code="session-value",
        )


def _faults(session: Session) -> Iterator[str]:
    """What of the values cannot be meant."""
    for key, number in _numbers(msgspec.to_builtins(session)):
        if not math.isfinite(number):
            yield f"{key} must be finite, not {number}"
    implement = session.implement
    if not session.recording.lidar and (implement is None or not implement.states):
        yield "recording.lidar names no file, and implement.states no other that says when the tool worked"
    if not session.recording.gnss and session.trajectory is None:
        yield "recording.gnss names no file, and there is no [trajectory] either"
    if session.crs.parameters is not None and session.crs.coordinates != CURRENT_EPOCH:
        yield f'crs.parameters are for crs.coordinates = "{CURRENT_EPOCH}", not {session.crs.coordinates!r}'
    if session.crs.geoid_grid is not None and session.crs.heights == ELLIPSOIDAL:
        yield f'crs.geoid_grid is for heights above a geoid, and crs.heights is "{ELLIPSOIDAL}"'
    yield from _repetitions(session)
    if session.recording.date is not None and not _is_date(session.recording.date):
        yield f'recording.date must be a day such as "2026-06-11", not {session.recording.date!r}'
    yield from _far_places(session)
    if implement is not None and not implement.width_m > 0:
        yield "implement.width_m must be above 0"
    if session.run.threads is not None and session.run.threads < 1:
        yield "run.threads must be at least 1"
    if implement is not None:
        yield from _implement_faults(implement)
    if implement is not None and implement.states_use not in (REPLACE, CHECK):
        yield f'implement.states_use must be "{REPLACE}" or "{CHECK}", not {implement.states_use!r}'
    if implement is not None and implement.states_use == CHECK and not session.recording.lidar:
        yield f'implement.states_use is "{CHECK}", and without recording.lidar there is nothing to check'
    if session.trajectory is not None:
        if not session.trajectory.files:
            yield "trajectory.files names no file"
        if session.trajectory.time not in (None, "utc", "gps"):
            yield 'trajectory.time must be "utc" or "gps"'
        if session.trajectory.week is not None and session.trajectory.week < 0:
            yield "trajectory.week must count from 1980-01-06 on"


def _implement_faults(implement: Implement) -> Iterator[str]:
    """What of the implement's lift and region cannot be meant."""
    if implement.lift_m is not None and not 0.1 <= implement.lift_m <= MOST_LIFT_M:
        yield f"implement.lift_m must be metres between 0.1 and {MOST_LIFT_M:g}, not {implement.lift_m:g}"
    if implement.region_m is not None:
        x0, x1, y0, y1 = implement.region_m
        if not (x0 < x1 and y0 < y1):
            yield "implement.region_m must be [from, to along x, from, to along y], each to above its from"
        if max(abs(value) for value in implement.region_m) > FARTHEST_M:
            yield f"implement.region_m reaches beyond {FARTHEST_M:g} m from the rear axle: metres are expected"


def _far_places(session: Session) -> Iterator[str]:
    """Places in the vehicle frame that no vehicle reaches: they were typed in another unit."""
    places: dict[str, tuple[float, ...]] = {"lidar.xyz_m": session.lidar.xyz_m}
    if session.antenna is not None:
        places["antenna.xyz_m"] = session.antenna.xyz_m
    if session.implement is not None:
        places["implement.xy_m"] = session.implement.xy_m
    for key, place in places.items():
        far_m = max(place, key=abs)
        if abs(far_m) > FARTHEST_M:
            yield f"{key} holds {far_m:g}: metres are expected, and {FARTHEST_M:g} m from the rear axle at most"


def _repetitions(session: Session) -> Iterator[str]:
    """Files that one key names twice: their scans or positions would count twice."""
    trajectory = session.trajectory.files if session.trajectory is not None else ()
    for key, names in (
        ("recording.lidar", session.recording.lidar),
        ("recording.gnss", session.recording.gnss),
        ("implement.states", session.implement.states if session.implement is not None else ()),
        ("trajectory.files", trajectory),
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
