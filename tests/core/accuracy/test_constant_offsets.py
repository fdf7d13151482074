"""Differences that no receiver makes are told apart from its errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.accuracy.evaluation import offset_notices
from furrowmap.core.accuracy.receiver_logs import evaluate_logs
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.rotation import compass_direction


def told(east: float, north: float, up: float, scatter: float) -> list[str]:
    noise = np.random.default_rng(1).normal(0.0, scatter, (400, 3))
    return [notice.code for notice in offset_notices(noise + np.array([east, north, up]), "test", "reference")]


@pytest.mark.parametrize(
    ("shift", "scatter", "codes"),
    [
        ((0.0, 0.0, 0.0), 0.02, []),
        ((0.3, -0.2, 0.0), 0.02, ["constant-offset"]),  # Japan's crustal movement since 2011
        ((0.3, -0.2, 0.0), 0.2, []),  # within the receiver's own scatter
        ((0.02, 0.01, 0.0), 0.001, []),  # two centimetres may be anything
        ((0.0, 0.0, 37.0), 0.02, ["heights-apart"]),
        ((0.0, 0.0, 0.1), 0.02, []),
        ((2015.0, 4363.0, 0.0), 0.02, ["not-the-same-place"]),
        ((0.0, 0.0, 0.0), 0.0, ["same-positions"]),
    ],
)
def test_offsets__are_told_where_they_exceed_the_scatter(
    shift: tuple[float, float, float], scatter: float, codes: list[str]
) -> None:
    assert told(*shift, scatter) == codes


def test_offsets__without_heights_are_those_of_the_place() -> None:
    error = np.column_stack([np.full(9, 0.3), np.zeros(9), np.full(9, np.nan)])
    (notice,) = offset_notices(error, "test", "reference")
    assert "0.300 m to the east" in notice.text


@given(st.floats(-180, 180))
def test_compass_word__is_the_nearest_of_eight(azimuth_deg: float) -> None:
    words = {"north": 0, "north-east": 45, "east": 90, "south-east": 135, "south": 180, "south-west": 225,
             "west": 270, "north-west": 315}  # fmt: skip
    angle = np.radians(azimuth_deg)
    off = (words[compass_direction(float(np.sin(angle)), float(np.cos(angle)))] - azimuth_deg + 180.0) % 360.0 - 180.0
    assert abs(off) <= 22.5 + 1e-9


@pytest.mark.parametrize("place", ["35.3,139.5", "35,339;139,522;65,7", "35.3 139.5 65"])
def test_numbers_that_are_no_place_are_told_to_be_none(shared_data: Path, place: str) -> None:
    with pytest.raises(InputError, match="neither a file nor a place") as refused:
        evaluate_logs(shared_data / "gnss/clas/clas_static.pos", place)
    assert all(refused.value.lines)


def test_logs_without_dates_are_told_of_this_commands_option(shared_data: Path) -> None:
    logs = shared_data / "gnss/nmea"
    with pytest.raises(InputError, match="no date in its sentences") as refused:
        evaluate_logs(logs / "drone_rtk_fixed_10hz.nmea", str(logs / "drone_farm_rtk_fix_float.nmea"))
    assert "--date" in refused.value.lines[2]
