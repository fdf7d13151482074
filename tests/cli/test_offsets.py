"""Offsets of antennas on the command line."""

from __future__ import annotations

import pytest

from furrowmap.cli.gnss_commands import _offset
from furrowmap.core.runtime.errors import UsageError


def test_offset__is_forward_left_and_up() -> None:
    assert _offset("0.30,-0.12,0.05") == (0.30, -0.12, 0.05)
    assert _offset("-99.9,0,99.9") == (-99.9, 0.0, 99.9)


@pytest.mark.parametrize("text", ["0.3,0.1", "1,2,3,4", "a,b,c", "100,0,0", "0,-100,0", "nan,0,0", "0,0,inf"])
def test_offset__of_anything_else_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="FORWARD,LEFT,UP"):
        _offset(text)
