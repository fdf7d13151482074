"""Calibrations of antennas: offsets by name, their combinations, and what is no such file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.readers.antex import AntennaModel, antenna_model
from furrowmap.core.runtime.errors import InputError


def antex(*antennas: tuple[str, dict[str, tuple[float, float, float]]]) -> str:
    """A file as the IGS writes it: offsets in millimetres by frequency, and one row of phase variations."""
    lines = [("     1.4            M", "ANTEX VERSION / SYST"), ("", "END OF HEADER")]
    for name, offsets in antennas:
        lines += [("", "START OF ANTENNA"), (name, "TYPE / SERIAL NO"), (f"{len(offsets):6}", "# OF FREQUENCIES")]
        for frequency, (north, east, up) in offsets.items():
            lines += [
                (f"   {frequency}", "START OF FREQUENCY"),
                (f"{north:10.2f}{east:10.2f}{up:10.2f}", "NORTH / EAST / UP"),
                ("   NOAZI    0.00   -0.20   -0.81", ""),
                (f"   {frequency}", "END OF FREQUENCY"),
            ]
        lines.append(("", "END OF ANTENNA"))
    return "".join(f"{text:60}{label:20}\n" for text, label in lines)


ZEPHYR = (
    "TRM57971.00     NONE",
    {"G01": (1.36, -0.52, 66.73), "G02": (0.13, -0.46, 57.69), "R01": (1.36, -0.52, 66.73)},
)
UNDER_SNOW = ("TRM57971.00     TZGD", {"G01": (1.5, -0.3, 67.5), "G02": (0.0, -0.4, 58.0)})
SATELLITE = ("BLOCK IIA           G01", {"G01": (279.0, 0.0, 990.0), "G02": (279.0, 0.0, 990.0)})


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "igs20.atx"
    path.write_text(antex(SATELLITE, UNDER_SNOW, ZEPHYR), encoding="ascii")
    return path


@pytest.mark.parametrize("name", ["TRM57971.00 NONE", "trm57971.00", "TRM57971.00     NONE"])
def test_antenna__is_found_by_type_and_radome(file: Path, name: str) -> None:
    model = antenna_model(file, name)
    assert model.name == "TRM57971.00 NONE"
    assert sorted(model.offset_m) == ["G01", "G02", "R01"]
    np.testing.assert_allclose(model.offset_m["G01"], [0.00136, -0.00052, 0.06673])
    assert antenna_model(file, "TRM57971.00 TZGD").offset_m["G01"][2] == pytest.approx(0.0675)


@given(first=st.floats(-200.0, 200.0), second=st.floats(-200.0, 200.0), delay_m=st.floats(0.0, 30.0))
def test_phase_centre__is_where_the_combination_of_ranges_puts_it(first: float, second: float, delay_m: float) -> None:
    """The ionosphere delays by 1/f²: the combination without it sees the phase centre alone."""
    up = 1e-3 * np.array([first, second])
    model = AntennaModel("A", {"G01": np.array([0, 0, up[0]]), "G02": np.array([0, 0, up[1]])})
    assert model.phase_centre_m(ionosphere_free=False)[2] == pytest.approx(up.mean(), abs=1e-12)
    square = np.array([1575.42, 1227.60]) ** 2
    ranges = 20e6 + up + delay_m * square[0] / square
    free = (square[0] * ranges[0] - square[1] * ranges[1]) / (square[0] - square[1])
    assert model.phase_centre_m(ionosphere_free=True)[2] == pytest.approx(free - 20e6, abs=1e-6)


def test_one_frequency__stands_for_both() -> None:
    model = AntennaModel("A", {"G01": np.array([0.0, 0.0, 0.05])})
    assert model.phase_centre_m(ionosphere_free=True)[2] == pytest.approx(0.05)


def test_unknown_antennas__name_those_of_the_same_type(file: Path) -> None:
    with pytest.raises(InputError) as caught:
        antenna_model(file, "TRM57971.00 SCIS")
    assert caught.value.code == "antenna-model-unknown"
    assert "TRM57971.00 TZGD and TRM57971.00 NONE" in str(caught.value)
    with pytest.raises(InputError, match="no antenna 'LEIAR25' among 3"):
        antenna_model(file, "LEIAR25")
    with pytest.raises(InputError, match="no antenna ' '"):
        antenna_model(file, " ")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("$GPGGA\n", "no line ANTEX"),
        ("", "no line ANTEX"),
        (antex(("A", {})), "no offsets of G01"),
        (antex(("A", {"G01": (0.0, 0.0, 1001.0)})), "no millimetres"),
        (antex(("A", {"G01": (0.0, 0.0, np.nan)})), "no millimetres"),
        (antex(("A", {"G01": (0.0, 0.0, 1.0)})).replace("      1.00", "      1.0x"), "no millimetres"),
        (antex(ZEPHYR) + "x" * 10_000, "more than 200 characters"),
    ],
)
def test_other_files__are_three_lines(tmp_path: Path, content: str, words: str) -> None:
    path = tmp_path / "a.atx"
    path.write_text(content, encoding="ascii")
    with pytest.raises(InputError, match=words) as caught:
        antenna_model(path, "A")
    assert caught.value.code == "antex-unreadable"
    assert all(caught.value.lines)


def test_missing_files__are_an_error(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        antenna_model(tmp_path / "none.atx", "A")
    assert caught.value.code == "antex-unreadable"
