"""Tables in TOML: constants in files beside the modules that use them, and the text of tables that are written."""

import json
import tomllib
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any


@cache
def own_table(package: str, name: str) -> dict[str, Any]:
    """The file `name`.toml of a package in furrowmap.core, such as "readers"."""
    return tomllib.loads(files(f"furrowmap.core.{package}").joinpath(f"{name}.toml").read_text("utf-8"))


def toml_value(value: Any) -> str:
    """A text, a number, or a list or dict of these in TOML; all but dicts are read as JSON as well."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key} = {toml_value(item)}' for key, item in value.items())}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml_value, value))}]"
    return repr(value)


def toml_keys(keys: Mapping[str, Any]) -> str:
    """The lines of the keys of a table."""
    return "".join(f"{key} = {toml_value(value)}\n" for key, value in keys.items())
