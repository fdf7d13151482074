from __future__ import annotations

import json
from pathlib import Path

import pytest
import rasterio

from furrowmap.cli.main import command_line
from tests.core.readers.las.test_hostile import ERRORS, NOTICES

NOT_IN_METRES = (
    "d_claims_4294967295_evlrs.laz",
    "d_evlr_offset_beyond_end.las",
    "d_las14_claims_1e12_points.las",
    "found_389_vlrs.las",
    "found_spurious_box.las",
)


def call(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    status = command_line([str(word) for word in arguments])
    captured = capsys.readouterr()
    return status, captured.out, captured.err


@pytest.fixture(scope="module")
def las(shared_data: Path) -> Path:
    return shared_data / "las"


def test_surface__of_a_cloud_in_feet(las: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cloud = las / "good" / "las12_pf3_autzen_trim.laz"
    status, _, err = call(capsys, "surface", cloud, "-o", tmp_path / "out")
    assert status == 3
    assert len(err.splitlines()) == 3
    assert "--dst-crs EPSG:" in err
    status, out, err = call(
        capsys, "surface", cloud, "-o", tmp_path / "out", "--dst-crs", "EPSG:32610", "--cell", "1", "--json"
    )
    assert status == 0
    answer = json.loads(out)
    assert answer["figures"]["points"] == 110_000
    assert answer["crs"] == "EPSG:32610"
    assert {"crs-change-loose", "heights-in-feet"} <= {warning["code"] for warning in answer["warnings"]}
    assert "Heights are converted to metres from units of 0.3048 m" in err
    with rasterio.open(tmp_path / "out" / "dtm.tif") as file:
        heights = file.read(1, masked=True)
    assert 0.3048 * 406.26 - 0.01 <= heights.min() < heights.max() <= 0.3048 * 520.51 + 0.01
    status, _, err = call(capsys, "surface", cloud, "-o", tmp_path / "out", "--dst-crs", "EPSG:32610")
    assert status == 4
    assert "--overwrite" in err


def test_surface__tells_the_lies_of_a_file_it_can_read(
    las: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, out, err = call(
        capsys,
        *("surface", las / "hostile" / "d_header_box_lies.las", "-o", tmp_path, "--crs", "EPSG:32610", "--cell", "20"),
    )
    assert status == 0
    assert "the bounding box in the header" in err
    assert "dsm.tif" in out


def test_surface__of_every_hostile_file_ends_in_surfaces_or_three_lines_and_leaves_nothing_else(
    las: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    codes = {}
    for cloud in sorted((las / "hostile").iterdir()):
        output = tmp_path / cloud.stem / "out"
        output.parent.mkdir()
        arguments = ("--crs", "EPSG:32610", "--cell", "50", "--ground-method", "none", "--json")
        status, out, err = call(capsys, "surface", cloud, "-o", output, *arguments)
        answer = json.loads(out)
        if status == 0:
            codes[cloud.name] = ""
            assert answer["figures"]["points"] == NOTICES[cloud.name][0], cloud.name
            assert [path.name for path in output.parent.iterdir()] == ["out"], cloud.name
            assert sorted(path.name for path in output.iterdir()) == answer["products"], cloud.name
            with rasterio.open(output / "dsm.tif") as file:
                heights = file.read(1, masked=True)
            assert 0 < heights.count() <= answer["figures"]["points"], cloud.name
        else:
            codes[cloud.name] = answer["error"]["code"]
            assert (status, len(err.splitlines())) == (3, 3), (cloud.name, err)
            assert cloud.name in err.splitlines()[0]
            assert list(output.parent.iterdir()) == [], cloud.name
    # What the reader refuses, those that are in feet or degrees, and two whose CRS is lost, in feet as well.
    refused = {name: code for name, code in codes.items() if code}
    elsewhere = dict.fromkeys(("d_first_vlr_length_65535.las", "d_first_vlr_length_zero.las"), "crs-distorted")
    assert refused == ERRORS | dict.fromkeys(NOT_IN_METRES, "crs-not-metres") | elsewhere
    assert codes.keys() == ERRORS.keys() | NOTICES.keys()


@pytest.mark.parametrize(
    ("arguments", "status", "word"),
    [
        (["--bbox", "1,2,3"], 2, "4 numbers"),
        (["--class", "two"], 2, "numbers"),
        (["--statistic", "mode"], 2, "statistic"),
        (["--crs", "EPSG:0"], 3, "does not know the CRS"),
        (["--cell", "0"], 2, "cell"),
        (["--class", "2.5"], 2, "0 to 255"),
        (["--class", "256"], 2, "0 to 255"),
        (["--bbox", "10,0,0,10"], 2, "W < E"),
    ],
)
def test_surface__wrong_arguments_are_reported(
    las: Path, tmp_path: Path, arguments: list[str], status: int, word: str, capsys: pytest.CaptureFixture[str]
) -> None:
    cloud = las / "good" / "las14_pf8_wkt_rgf93.laz"
    answer, _, err = call(capsys, "surface", cloud, "-o", tmp_path / "out", *arguments)
    assert answer == status
    assert word in err
    assert not (tmp_path / "out").exists()


def test_inspect__tells_a_cloud_and_its_lies(las: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = call(capsys, "inspect", las / "good" / "las14_pf7_wkt_compound_gpstime.las")
    assert status == 0
    lines = {" ".join(line.split()) for line in out.splitlines()}
    assert {"points 687", "gps time adjusted standard GPS time", "version LAS 1.4, point format 7"} <= lines
    assert any(line.startswith("notice") and "seconds of a week" in line for line in lines)
    status, _, err = call(capsys, "inspect", las / "hostile" / "d_laz_cut_in_half.laz")
    assert status == 3
    assert "it was truncated" in err


def test_surface__counts_no_cloud_twice(las: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cloud = las / "good" / "las12_pf3_autzen_trim.laz"
    status, _, err = call(capsys, "surface", cloud, cloud.parent / "." / cloud.name, "-o", tmp_path / "out")
    assert status == 2
    assert "would count twice" in err
