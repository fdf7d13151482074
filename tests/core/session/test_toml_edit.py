"""A value set in a file's text, against what a TOML parser reads before and after."""

from __future__ import annotations

import tomllib

import pytest

from furrowmap.core.runtime.errors import RefusedError
from furrowmap.core.session.toml_edit import with_value

REST = '\n[implement]\nwidth_m = 2.0 # as built\n[[more]]\nfiles = [\n  "a",\n  "b",\n]\n'


@pytest.mark.parametrize("ends", ["\n", "\r\n"])
@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("lidar.rpy_deg = [1, 2,\n 3] # here\n", "lidar.rpy_deg = [0.50, 1] # here\n"),
        ("lidar.xyz_m = [1, 2]\nname = 'a'\n", "lidar.xyz_m = [1, 2]\nlidar.rpy_deg = [0.50, 1]\nname = 'a'\n"),
        ("lidar = { rpy_deg = [1, 2], model = 'x' }\n", "lidar = { rpy_deg = [0.50, 1], model = 'x' }\n"),
        ("lidar = {model='x',rpy_deg=[1, 2]}\n", "lidar = {model='x',rpy_deg=[0.50, 1]}\n"),
        ("lidar = { model = 'x' } # which\n", "lidar = { model = 'x', rpy_deg = [0.50, 1] } # which\n"),
        ("lidar = {}\n", "lidar = { rpy_deg = [0.50, 1] }\n"),
        ("[lidar]\nrpy_deg = [1, 2]  # was\n", "[lidar]\nrpy_deg = [0.50, 1]  # was\n"),
        ("[lidar] # VLP\nmodel = 'x'\n", "[lidar] # VLP\nrpy_deg = [0.50, 1]\nmodel = 'x'\n"),
    ],
)
def test_a_value_is_set_however_its_table_is_written(text: str, expected: str, ends: str) -> None:
    before = (text + REST).replace("\n", ends)
    after = with_value(before, "lidar", "rpy_deg", "[0.50, 1]")
    assert after == (expected + REST).replace("\n", ends)
    wanted = tomllib.loads(before)
    wanted["lidar"]["rpy_deg"] = [0.5, 1]
    assert tomllib.loads(after) == wanted


@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_a_table_that_is_not_there_is_added(ends: str) -> None:
    before = f"name = 'a'{REST}".replace("\n", ends)
    after = with_value(before, "lidar", "rpy_deg", "[1.0]")
    assert tomllib.loads(after) == tomllib.loads(before) | {"lidar": {"rpy_deg": [1.0]}}
    assert after.startswith(before.rstrip())
    assert after.count("\n") == after.count(ends)


@pytest.mark.parametrize("text", ['"lidar" = { model = "x" }\n', "[lidar.more]\na = 1\n[ 'lidar' ]\nrpy_deg = [1]\n"])
def test_what_is_not_understood_is_not_changed(text: str) -> None:
    with pytest.raises(RefusedError, match="lidar"):
        with_value(text, "lidar", "rpy_deg", "[1.0]")
