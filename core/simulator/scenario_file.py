"""Reading and writing of scenario files (TOML)."""

from __future__ import annotations

import difflib
import json
import re
import tomllib
import typing
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any, Final

import msgspec

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.simulator.scenario import Scenario
from furrowmap.core.simulator.table import waits

PACKAGED: Final = ("demo", "road", "flight")
"""Scenarios that come with furrowmap: three passes of a tractor; a tractor on a road; a flight."""


def load_scenario(path: Path) -> Scenario:
    """Load a scenario file; InputError if it cannot be read, is not TOML, or has an unknown key or an invalid value."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise InputError("scenario-unreadable", path=path, why=why) from None
    return scenario_from(text, str(path))


def demo_scenario(name: str = "demo") -> Scenario:
    """One of :data:`PACKAGED`; ``make demo`` runs the first."""
    text = resources.files("furrowmap.core.simulator").joinpath(f"{name}.toml").read_text(encoding="utf-8")
    return scenario_from(text, f"{name}.toml")


def scenario_from(text: str, name: str) -> Scenario:
    """The scenario in the TOML `text`; `name` is the file name in messages, errors are as of :func:`load_scenario`."""
    try:
        return msgspec.convert(tomllib.loads(text), Scenario)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError("scenario-toml", name=name, error=error) from error
    except (msgspec.ValidationError, ValueError) as error:
        raise _value_error(error, name) from error


def as_toml(scenario: Scenario) -> str:
    """`scenario` as TOML with every key that has a value, such that loading it gives the same scenario."""
    whole = _as_builtins(scenario)
    lines = [f"{key} = {_value(value)}" for key, value in whole.items() if not isinstance(value, dict)]
    for table, keys in _tables(whole, ""):
        lines += ["", f"[{table}]", *(f"{key} = {_value(value)}" for key, value in keys.items())]
    return "\n".join(lines) + "\n"


def _tables(whole: Mapping[str, Any], above: str) -> list[tuple[str, dict[str, Any]]]:
    found: list[tuple[str, dict[str, Any]]] = []
    for name, value in whole.items():
        if isinstance(value, dict):
            keys = {k: v for k, v in value.items() if not isinstance(v, dict)}
            if keys:
                found.append((above + name, keys))
            found += _tables(value, f"{above}{name}.")
    return found


def _value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_value(v)}" for key, v in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_value(v) for v in value) + "]"
    return repr(value)


def _as_builtins(scenario: Scenario) -> dict[str, Any]:
    def plain(value: Any) -> Any:
        if isinstance(value, msgspec.Struct):
            fields = {name: getattr(value, name) for name in value.__struct_fields__}
            return {name: plain(field) for name, field in fields.items() if field is not None and not waits(field)}
        return [plain(v) for v in value] if isinstance(value, tuple) else value

    whole: dict[str, Any] = plain(scenario)
    return whole


def _value_error(error: Exception, name: str) -> InputError:
    """Convert an error of msgspec; suggests the nearest key for an unknown one."""
    text = str(error)
    place = re.search(r" - at `\$\.?(.*?)`", text)
    table = place.group(1) if place else ""
    unknown = re.search(r"unknown field `(.*?)`", text)
    if not unknown:
        what = re.sub(r" - at `.*`", "", text)
        return InputError("scenario-value", name=name, table=table or None, what=what[:1].lower() + what[1:])
    key = unknown.group(1)
    kind: Any = Scenario
    for part in filter(None, table.split(".")):
        hint = typing.get_type_hints(kind)[part]
        kind = next((k for k in typing.get_args(hint) if k is not type(None)), hint)
    known = list(kind.__struct_fields__)
    near = difflib.get_close_matches(key, known, 1, 0.5)
    return InputError(
        "scenario-unknown-key",
        name=name,
        table=table + "." if table else "",
        key=key,
        near_first=near[0] if near else None,
        known=", ".join(sorted(known)) if not (near) else None,
    )
