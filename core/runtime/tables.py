"""Tables of constants in TOML files beside the modules that use them."""

import tomllib
from functools import cache
from importlib.resources import files
from typing import Any


@cache
def own_table(package: str, name: str) -> dict[str, Any]:
    """The file `name`.toml of a package in furrowmap.core, such as "readers"."""
    return tomllib.loads(files(f"furrowmap.core.{package}").joinpath(f"{name}.toml").read_text("utf-8"))
