"""`furrowmap farm` from end to end, called as a user calls it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import rasterio
from pyproj import CRS

from furrowmap.cli.main import command_line
from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.rasters.cog import HEIGHT_BAND
from tests.exporters.farm.result_folders import write_result
from tests.exporters.rasters.written_cogs import write_cog


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Results of two sessions, each with a surface."""
    root = tmp_path_factory.mktemp("results")
    first = write_result(root / "first")
    second = write_result(root / "second", name="\x1b[31mSouth", recording="b" * 64, day=7)
    for i, folder in enumerate((first, second)):
        heights = np.full((4, 4), 250.0 + i, np.float32)
        grid = Grid(0.5, 33_200 + 2 * i, 193_000, (4, 4))
        write_cog(folder / "dsm.tif", grid, CRS.from_epsg(6677), [HEIGHT_BAND], [heights], Origin("dsm"))
    return [first, second]


def call(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    status = command_line([str(word) for word in arguments])
    captured = capsys.readouterr()
    return status, captured.out, captured.err


def test_add__leaves_out_the_tables_of_a_batch(
    folders: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`results/*` names them too. Alone they are refused."""
    tables = [tmp_path / name for name in ("batch.csv", "batch.gpkg", "batch.html")]
    for table in tables:
        table.write_text("name,status\n")
    status, _, said = call(capsys, "farm", "add", *tables, *folders, tmp_path / "farm.gpkg")
    assert status == 0
    assert all(str(table) in said for table in tables)
    assert call(capsys, "farm", "add", tables[0], tmp_path / "other.gpkg")[0] == 3


def test_farm__is_filled_listed_emptied(
    folders: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    farm = tmp_path / "farm.gpkg"
    assert call(capsys, "farm", "add", *folders, farm)[:2] == (
        0,
        f"{farm}: 2 added; now 2 sessions in EPSG:6677.\n",
    )
    status, out, _ = call(capsys, "farm", "add", folders[0], farm, "--json")
    assert status == 0
    assert [len(json.loads(out)[deed]) for deed in ("added", "replaced", "unchanged")] == [0, 0, 1]
    status, out, _ = call(capsys, "farm", "list", farm)
    assert [line.split()[1] for line in out.splitlines()] == ["2026-06-12", "2026-06-19"]
    assert "\x1b" not in out
    sessions = json.loads(call(capsys, "farm", "list", farm, "--json")[1])["sessions"]
    assert sessions[0]["start"].startswith("2026-06-11T15:00:00")
    status, out, _ = call(capsys, "farm", "remove", farm, sessions[1]["session"], "North field")
    assert (status, out) == (0, f"{farm}: 2 removed; now 0 sessions in EPSG:6677.\n")
    assert call(capsys, "farm", "list", farm)[1] == "No sessions.\n"


def test_mosaic__has_the_latest_on_top(folders: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    call(capsys, "farm", "add", *reversed(folders), tmp_path / "farm.gpkg")
    status, out, err = call(capsys, "farm", "mosaic", tmp_path / "farm.gpkg", "-o", tmp_path / "farm.vrt")
    assert (status, err) == (0, "")
    assert out.endswith("2 surfaces, 6 × 4 cells of 0.5 m, EPSG:6677.\n")
    with rasterio.open(tmp_path / "farm.vrt") as raster:
        assert raster.read(1).tolist() == [[250.0, 250.0, 251.0, 251.0, 251.0, 251.0]] * 4
    assert call(capsys, "farm", "mosaic", tmp_path / "farm.gpkg", "-o", tmp_path / "farm.vrt")[0] == 4
    assert call(capsys, "farm", "mosaic", tmp_path / "farm.gpkg", "-o", tmp_path / "farm.vrt", "--overwrite")[0] == 0
    assert call(capsys, "farm", "mosaic", *folders, "-o", tmp_path / "farm.tif", "--mean", "-q")[0] == 0


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (["farm"], 2, "Missing command"),
        (["farm", "ad"], 2, "furrowmap farm add"),
        (["farm", "add", "nowhere", "farm.gpkg"], 3, "nowhere"),
        (["farm", "list", "nowhere.gpkg"], 3, "nowhere.gpkg"),
        (["farm", "add", "x", "farm.gpkg", "--crs", "EPSG:0"], 3, "EPSG:0"),
        (["farm", "add", "x", "farm.gpkg", "--time-zone", "Mars/../Base"], 2, "--time-zone"),
        (["farm", "mosaic", "nowhere", "-o", "farm.png"], 2, "farm.png"),
        (["farm", "list", "postgresql://me:s3cret@127.0.0.1:1/farm"], 3, "127.0.0.1"),
    ],
)
def test_mistake__is_three_lines_and_a_status(
    arguments: list[str],
    status: int,
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    found, out, err = call(capsys, *arguments)
    assert (found, out, len(err.splitlines())) == (status, "", 3)
    assert words in err
    assert "s3cret" not in err
    assert list(tmp_path.iterdir()) == []
