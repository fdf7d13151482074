"""Reading and writing of machines' profiles."""

import datetime as dt
import json
import math
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.languages.texts import Text, Words, reason
from furrowmap.core.runtime.plain_reads import read_plain_text
from furrowmap.core.session.session_file import FURTHER, MAX_PLACE_M, apart, implement_faults, parse_toml, together
from furrowmap.core.values.machine import (
    MACHINE_SCHEMA,
    NOT_SHOWN_DEG,
    Calibrated,
    Machine,
    MachineCamera,
    MachineImplement,
    MachineImu,
)
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.session import ORIGIN, Lidar, Session

_PROFILE_HEAD: Final = """\
# A machine: where its sensors and its tool sit in the vehicle frame (origin on the ground below the middle of the rear
# axle; x forward, y left, z up; metres and degrees). `furrowmap init --machine` copies it into sessions.
"""


@dataclass(frozen=True)
class LearnedMounting:
    """The mounting of a scanner as a recording shows it; `sigma_deg` is inf for an angle that it does not show."""

    mounting: Mounting
    sigma_deg: tuple[float, float, float]
    date: dt.date
    session: str = ""


def load_machine(path: Path) -> Machine:
    """Load a machine's profile. Raises InputError if it is unreadable, or has an unknown key or an invalid value."""
    try:
        return parse_machine(read_plain_text(path), str(path))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            "machine-unreadable", path=path, error=getattr(error, "strerror", None) or Text("not UTF-8 text")
        ) from None


def parse_machine(text: str, name: str = "machine.toml") -> Machine:
    """Parse a profile; `name` is the file name in messages. Raises InputError as :func:`load_machine`."""
    try:
        data = parse_toml(text)
    except tomllib.TOMLDecodeError as error:
        raise _invalid(name, Text("it is not valid TOML: {why}", why=reason(error))) from None
    if data.get("furrowmap_machine") != MACHINE_SCHEMA:
        raise _invalid(
            name,
            Text(
                "it is no profile of a machine, which begins with furrowmap_machine = {schema}", schema=MACHINE_SCHEMA
            ),
        )
    try:
        for table, further in FURTHER.items():
            if further in data:
                raise _invalid(
                    name,
                    Text(
                        "{name} is no table of a profile; write [[{table}]] once for each {table}",
                        name=further,
                        table=table,
                    ),
                )
        machine = msgspec.convert(apart(data), Machine)
    except msgspec.ValidationError as error:
        raise _invalid(name, reason(error)) from None
    fault = _fault(msgspec.to_builtins(machine)) or next(implement_faults(machine.implements), "")
    if fault:
        raise _invalid(name, fault)
    return machine


def machine_text(machine: Machine) -> str:
    """The profile as a file: a table for each part, a value a line."""
    values = together(msgspec.to_builtins(machine))
    lines = [f"furrowmap_machine = {MACHINE_SCHEMA}", f"name = {toml_value(values['name'])}"]
    for table, content in values.items():
        header = f"[[{table}]]" if isinstance(content, list) else f"[{table}]"
        for part in content if isinstance(content, list) else [content]:
            if isinstance(part, dict):
                lines += ["", header]
                lines += [f"{key} = {toml_value(value)}" for key, value in part.items() if stated(value)]
    return _PROFILE_HEAD + "\n".join(lines) + "\n"


def machine_of(session: Session, name: str) -> Machine:
    """The machine that a session describes; what it does not state is left out."""
    imu = session.imu
    camera = session.camera
    kept = MachineImplement.__struct_fields__
    tools = tuple(MachineImplement(**{name: getattr(tool, name) for name in kept}) for tool in session.implements)
    places = (camera.xyz_m, camera.rpy_deg) if camera is not None else (ORIGIN, ORIGIN)
    return Machine(
        name=name,
        antenna=session.antenna,
        lidar=session.lidar if session.lidar != Lidar() else None,
        further_lidars=tuple(
            msgspec.structs.replace(lidar, files=(), minus_gnss_s=None) for lidar in session.further_lidars
        ),
        imu=MachineImu(xyz_m=imu.xyz_m, rpy_deg=imu.rpy_deg, kind=imu.kind) if imu is not None else None,
        camera=MachineCamera(xyz_m=places[0], rpy_deg=places[1]) if places != (ORIGIN, ORIGIN) else None,
        implement=tools[0] if tools else None,
        further_implements=tools[1:],
    )


def learned(machine: Machine, found: LearnedMounting) -> Machine:
    """The machine with the mounting of its scanner as a recording shows it."""
    lidar = machine.lidar or Lidar()
    roll, pitch, yaw = (round(sigma, 4) if math.isfinite(sigma) else NOT_SHOWN_DEG for sigma in found.sigma_deg)
    x, y, z = found.mounting.xyz_m
    a, b, c = found.mounting.rpy_deg
    return msgspec.structs.replace(
        machine,
        lidar=msgspec.structs.replace(
            lidar,
            xyz_m=(round(x, 4), round(y, 4), round(z, 4)) if lidar.xyz_m is not None or any((x, y, z)) else None,
            rpy_deg=(round(a, 3), round(b, 3), round(c, 3)),
        ),
        calibrated=Calibrated(date=found.date, rpy_sigma_deg=(roll, pitch, yaw), session=found.session),
    )


def _fault(value: Any, key: str = "") -> Text | None:
    """What is wrong with the numbers of a profile; None if nothing is."""
    if isinstance(value, dict):
        return next(
            filter(None, (_fault(item, f"{key}.{name}" if key else name) for name, item in value.items())), None
        )
    if isinstance(value, list | tuple):
        return next(filter(None, (_fault(item, key) for item in value)), None)
    if isinstance(value, float) and not math.isfinite(value):
        return Text("{key} must be finite, not {value}", key=key, value=value)
    if isinstance(value, float) and key.endswith(("xyz_m", "xy_m")) and abs(value) > MAX_PLACE_M:
        return Text(
            "{key} holds {value:g}, more than {most_m:g} m from the rear axle (the unit is metres)",
            key=key,
            value=value,
            most_m=MAX_PLACE_M,
        )
    return None


def stated(value: Any) -> bool:
    """Whether a value of a profile is written: neither nothing nor an empty text nor false; zero is."""
    return value is not None and value is not False and value != ""


def toml_value(value: Any) -> str:
    """A text, a number or a list of these in TOML, which JSON reads as well: so does the form of a session."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml_value, value))}]"
    return repr(value)


def _invalid(name: str, why: Words) -> InputError:
    return InputError("machine-value", name=name, why=why)
