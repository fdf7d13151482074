"""Values and their arrays as bytes, exactly, and back by their types: nothing in the bytes decides what is made.

The length of the head in eight bytes, the head in MessagePack with the types, shapes and places of the arrays, then
their contents: arrays that lie in scratch files never come into memory as a whole.
"""

import re
from collections.abc import Iterator
from functools import partial
from typing import Annotated, Any, Final, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime import arrays

_ARRAY: Final = 1
"""Code of an array in MessagePack: its type, shape and first byte."""
_ARRAY_KINDS: Final = "fiubU"
"""Kinds of arrays, by NumPy's letters."""
_LENGTH: Final = 8
_Count = Annotated[int, msgspec.Meta(ge=0)]
T = TypeVar("T")


def packed(value: object) -> Iterator[bytes | memoryview]:
    """The bytes, piece by piece, of a dataclass, or a collection, of numbers, texts and arrays."""
    arrays: list[NDArray[Any]] = []
    size = 0

    def encoded(value: Any) -> Any:
        nonlocal size
        if isinstance(value, np.generic):
            return value.item()
        if not isinstance(value, np.ndarray) or value.dtype.kind not in _ARRAY_KINDS:
            raise TypeError(f"{type(value).__name__} cannot be packed")
        arrays.append(value)
        begin = size
        size = size + value.nbytes
        return msgspec.msgpack.Ext(_ARRAY, msgspec.msgpack.encode((value.dtype.str, value.shape, begin)))

    head = msgspec.msgpack.encode(value, enc_hook=encoded)
    yield len(head).to_bytes(_LENGTH, "little")
    yield head
    for array in arrays:
        yield np.ascontiguousarray(array).reshape(-1).view(np.uint8).data


def unpacked(data: bytes | memoryview, kind: type[T]) -> T:
    """The value of a type, large arrays in scratch files. Raises ValueError or TypeError for bytes of anything else."""
    whole = memoryview(data)
    begin = _LENGTH + int.from_bytes(whole[:_LENGTH], "little")
    if begin > len(whole):
        raise ValueError("the head is cut off")

    def typed(kind: Any, value: Any) -> Any:
        if not isinstance(value, np.ndarray):
            raise TypeError(f"{type(value).__name__} instead of {kind}")  # which msgspec makes a ValidationError
        return value

    return msgspec.msgpack.decode(
        whole[_LENGTH:begin], type=kind, dec_hook=typed, ext_hook=partial(_decode_array, whole[begin:])
    )


def _decode_array(contents: memoryview, code: int, data: memoryview) -> Any:
    if code != _ARRAY:
        raise ValueError(f"unknown code {code}")
    kind, shape, begin = msgspec.msgpack.decode(data, type=tuple[str, tuple[_Count, ...], _Count])
    if re.fullmatch(rf"[<>|=][{_ARRAY_KINDS}]\d{{1,4}}", kind) is None:
        raise ValueError(f"unknown type of array {kind!r}")
    try:
        there: NDArray[Any] = np.ndarray(shape, kind, contents, begin)
    except OverflowError as error:
        raise ValueError("an array lies beyond the end") from error
    return arrays.copied(there)
