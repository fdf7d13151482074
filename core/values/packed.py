"""Values and their arrays as bytes, exactly, and back by their types: nothing in the bytes decides what is made."""

from __future__ import annotations

import re
from typing import Any, Final, TypeVar

import msgspec
import numpy as np

_ARRAY: Final = 1
"""Code of an array in MessagePack: its type, shape and content."""
_KINDS: Final = "fiubU"
"""Kinds of arrays, by NumPy's letters."""
T = TypeVar("T")


def pack(value: object) -> bytes:
    """A dataclass, or a collection, of numbers, texts and arrays as bytes."""
    return msgspec.msgpack.encode(value, enc_hook=_encoded)


def unpack(data: bytes, kind: type[T]) -> T:
    """The value of a type.

    Raises:
        ValueError, TypeError: if the bytes hold something else.
    """
    return msgspec.msgpack.decode(data, type=kind, dec_hook=_typed, ext_hook=_decoded)


def _encoded(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if not isinstance(value, np.ndarray) or value.dtype.kind not in _KINDS:
        raise TypeError(f"{type(value).__name__} cannot be packed")
    return msgspec.msgpack.Ext(_ARRAY, msgspec.msgpack.encode((value.dtype.str, value.shape, value.tobytes())))


def _decoded(code: int, data: memoryview) -> Any:
    if code != _ARRAY:
        raise ValueError(f"unknown code {code}")
    kind, shape, content = msgspec.msgpack.decode(data, type=tuple[str, tuple[int, ...], bytes])
    if re.fullmatch(rf"[<>|=][{_KINDS}]\d{{1,4}}", kind) is None:
        raise ValueError(f"unknown type of array {kind!r}")
    return np.frombuffer(content, np.dtype(kind)).reshape(shape).copy()


def _typed(kind: Any, value: Any) -> Any:
    if not isinstance(value, np.ndarray):
        raise TypeError(f"{type(value).__name__} instead of {kind}")  # which msgspec makes a ValidationError
    return value
