"""Files of Ouster's SDK, against the captures that they are made of."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from furrowmap.core.readers.reader import ReadOptions, Recognised
from furrowmap.core.runtime.errors import InputError
from tests.core.readers.osf_files import osf_of
from tests.core.readers.test_ouster import changed, recorded, scans_of


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three turns with two returns, of which five packets are lost."""
    path = recorded(tmp_path_factory.mktemp("osf"), 3.0, return_mode="dual")
    data = path.read_bytes()
    size = (len(data) - 24) // 192
    path.write_bytes(data[: 24 + 70 * size] + data[24 + 75 * size :])
    return path


@pytest.mark.parametrize("encoding", ["zpng", "png"])
def test_scans__are_those_of_the_capture(encoding: str, capture: Path, tmp_path: Path) -> None:
    path = tmp_path / "drive.osf"
    path.write_bytes(osf_of([capture], encoding=encoding))
    reader, scans = scans_of(path)
    packets, expected = scans_of(capture)
    assert (reader.clock, len(scans)) == (packets.clock, len(expected))
    for scan, other in zip(scans, expected, strict=True):
        assert scan.whole == other.whole
        for column in ("t_s", "xyz_m", "intensity", "laser", "column", "return_number", "returns"):
            np.testing.assert_array_equal(getattr(scan, column), getattr(other, column))
    texts = [notice.text for notice in reader.notices]  # type: ignore[attr-defined]
    assert texts == [notice.text for notice in packets.notices]  # type: ignore[attr-defined]
    assert texts[0].startswith("5 packets are missing")
    assert Recognised.by_content(path).inspect().facts["profile"] == "RNG19_RFL8_SIG16_NIR16_DUAL"


def test_two_sensors__are_told_apart(capture: Path, tmp_path: Path) -> None:
    other = recorded(tmp_path, 2.0, changed("sensor_info", prod_sn="122000000099"), return_mode="dual")
    path = tmp_path / "drive.osf"
    path.write_bytes(osf_of([capture, other]))
    with pytest.raises(InputError, match="122000000032; OS-1-32-U0, serial number 122000000099") as caught:
        scans_of(path)
    assert caught.value.code == "two-sensors"
    scans = scans_of(path, ReadOptions(model="122000000099"))[1]
    assert sum(map(len, scans)) == 128 * 16 * 48
    with pytest.raises(InputError) as caught:
        scans_of(path, ReadOptions(model="OS0"))
    assert caught.value.code == "ouster-other-sensor"


def test_damaged_files__say_what_is_lost(capture: Path, tmp_path: Path) -> None:
    data = osf_of([capture])
    path = tmp_path / "drive.osf"
    middle = bytearray(data)
    middle[len(data) // 2] ^= 1
    path.write_bytes(middle)
    reader, scans = scans_of(path)
    assert next(notice.code for notice in reader.notices) == "osf-damaged"  # type: ignore[attr-defined]
    assert len(scans) == len(scans_of(capture)[1]) - 1
    for broken, words in (
        (data[:-1000], "not finished by the recorder, or is cut"),
        (data[:20] + b"\xff" + data[21:], "its header is damaged"),
        (data[:-10] + b"\xff" + data[-9:], "its metadata are damaged"),
        (gzip.compress(data), "its header is damaged"),
        (osf_of([]), "it has no scans"),
    ):
        path.write_bytes(broken)
        with pytest.raises(InputError, match=words) as caught:
            Recognised.by_content(path).inspect()
        assert caught.value.code == "osf-unreadable"
