"""Values and their arrays as bytes, exactly, and back by their types: nothing in the bytes decides what is made."""

from __future__ import annotations

import io
from typing import Any, Final, TypeVar

import msgspec
import numpy as np

_ARRAY: Final = 1
"""Code of an array in MessagePack: the content of an .npy file."""
T = TypeVar("T")


def pack(value: object) -> bytes:
    """A dataclass, or a collection, of numbers, texts and arrays as bytes."""
    return msgspec.msgpack.encode(value, enc_hook=_encoded)


def unpack(data: bytes, kind: type[T]) -> T:
    """The value of a type.

    Raises:
        ValueError: if the bytes hold something else.
    """
    return msgspec.msgpack.decode(data, type=kind, dec_hook=_typed, ext_hook=_decoded)


def _encoded(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if not isinstance(value, np.ndarray):
        raise NotImplementedError(type(value))
    stream = io.BytesIO()
    np.save(stream, value, allow_pickle=False)
    return msgspec.msgpack.Ext(_ARRAY, stream.getvalue())


def _decoded(code: int, data: memoryview) -> Any:
    if code != _ARRAY:
        raise ValueError(f"unknown code {code}")
    return np.load(io.BytesIO(data), allow_pickle=False)


def _typed(kind: Any, value: Any) -> Any:
    if not isinstance(value, np.ndarray):
        raise ValueError(f"{type(value).__name__} instead of {kind}")
    return value
