"""Values come back from their bytes exactly, or not at all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.packed import packed, unpacked

KINDS = st.sampled_from([np.float64, np.float32, np.int8, np.int64, np.bool_, np.dtype("<U4")])


@dataclass(frozen=True)
class Value:
    array: NDArray[np.float64]
    number: float
    notices: tuple[Notice, ...]
    figures: dict[str, Any]
    other: Notice | None = None


@given(
    array=arrays.arrays(KINDS, arrays.array_shapes(min_dims=1, max_dims=2, min_side=0, max_side=5)),
    number=st.floats(),
    text=st.text(),
)
def test_packed__comes_back_exactly(array: NDArray[Any], number: float, text: str) -> None:
    text = text.encode(errors="ignore").decode()
    value = Value(array, number, (Notice("a", text=text),), {"x": [number, text, None], "y": array[:1]})
    back = unpacked(b"".join(packed(value)), Value)
    assert back.array.dtype == array.dtype
    assert back.array.tobytes() == array.tobytes()
    assert back.array.shape == array.shape
    assert np.array([back.number, back.figures["x"][0]]).tobytes() == np.array([number, number]).tobytes()
    assert (back.notices, back.other) == (value.notices, None)


@given(data=st.binary(max_size=60), at=st.integers(0, 400), byte=st.integers(0, 255))
def test_promise_23__damaged_bytes_are_refused_or_a_value_of_that_type(data: bytes, at: int, byte: int) -> None:
    good = b"".join(packed(Value(np.arange(3.0), 1.0, (Notice("a", text="b"),), {"x": 1})))
    for bad in (data, good[: at % len(good)], good[: at % len(good)] + bytes([byte]) + good[at % len(good) + 1 :]):
        try:
            back = unpacked(bad, Value)
        except (ValueError, TypeError, MemoryError):
            continue
        assert isinstance(back, Value)
        assert isinstance(back.array, np.ndarray)


def test_array_of_objects__is_refused() -> None:
    with pytest.raises(TypeError, match="cannot be packed"):
        list(packed(Value(np.array([object()]), 1.0, (), {})))


@pytest.mark.parametrize("value", [1.5, [1.0, 2.0], "text", None, {"a": 1}])
def test_what_is_no_array__is_told_by_its_type(value: Any) -> None:
    kind = type(value).__name__
    with pytest.raises(ValueError, match=f"{kind} instead of .*ndarray"):
        unpacked(b"".join(packed({"array": value, "number": 1.0, "notices": (), "figures": {}})), Value)
