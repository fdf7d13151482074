"""Values of furrowmap as JSON that every reader takes: no NaN, no infinity, no lone surrogates."""

import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np

from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.languages.texts import Text

Kept = TypeVar("Kept")


def json_text(value: object) -> str:
    """`value` as indented JSON, keys in their order, with a final line break."""
    return json.dumps(plain(value), ensure_ascii=False, allow_nan=False, indent=2) + "\n"


def kept_json(value: object) -> bytes:
    """A value that furrowmap itself reads again (:func:`from_kept_json`), with names of files that are no Unicode."""
    return json.dumps(msgspec.to_builtins(value)).encode("ascii")


def from_kept_json(content: bytes, kind: type[Kept]) -> Kept:
    """The value of a type in what :func:`kept_json` gave; msgspec.DecodeError or ValidationError if it is damaged."""
    try:
        found = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise msgspec.DecodeError(str(error)) from None
    return msgspec.convert(found, kind)


def plain(value: object) -> Any:
    """`value` in JSON's types: non-finite numbers become null, texts their English, unknown types their text.

    Invalid bytes in file names become escapes.
    """
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, Enum):
        return plain(value.value)
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, int):
        return value
    if isinstance(value, Mapping):
        return {plain(str(key)): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    if isinstance(value, Notice):
        return {"code": value.code, "values": plain(dict(value.values)), **value.texts}
    if is_dataclass(value) and not isinstance(value, Text):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    text = value.as_posix() if isinstance(value, Path) else str(value)
    return text.encode("utf-8", "backslashreplace").decode("utf-8")
