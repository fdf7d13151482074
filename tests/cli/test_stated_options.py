"""What the help of the commands states about options, defaults and exit statuses, tried on a small cloud and result."""

from __future__ import annotations

import csv
import inspect as python_inspect
import json
import re
import runpy
from pathlib import Path

import laspy
import numpy as np
import pytest
import rasterio

from furrowmap.cli.main import command_line
from furrowmap.core.accuracy.evaluation import evaluate
from furrowmap.exporters.vectors.geopackage import write_field
from furrowmap.settings import SurfaceSettings
from tests.app.share.test_export import write_report
from tests.core.implement.drives_with_tool import FRAME
from tests.exporters.vectors.worked_field import worked_field

CHECKOUT = Path(__file__).resolve().parents[2]
COMMANDS = (CHECKOUT / "docs" / "reference" / "commands.md").read_text(encoding="utf-8")
FULL_HELP = runpy.run_path(str(CHECKOUT / "scripts" / "command_reference.py"))["full_help"]


def stated(command: str, *sentences: str) -> None:
    """The help of a command has these words, wherever its lines break."""
    flat = " ".join(FULL_HELP(command).split())
    assert [words for words in sentences if words not in flat] == []


@pytest.fixture(scope="module")
def cloud(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A slope of 10 × 10 m with a pit and a point every 10 cm, of which a hundred are noise far below."""
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = [0.001] * 3, [0.0] * 3
    las = laspy.LasData(header)
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(0.05, 10, 0.1), np.arange(0.05, 10, 0.1)))
    pit_m = np.clip(0.5 - 0.5 * np.hypot(x - 7.0, y - 7.0), 0.0, None)
    las.x, las.y, las.z = x, y, 100.0 + 0.1 * x - pit_m
    las.classification = np.where(np.arange(len(x)) % 100 == 0, 7, 2).astype(np.uint8)
    las.z[::100] -= 50.0
    las.gps_time = np.arange(len(x), dtype=float)
    path = tmp_path_factory.mktemp("cloud") / "slope.las"
    las.write(path)
    return path


@pytest.fixture(scope="module")
def survey(cloud: Path) -> Path:
    """Checkpoints 2 cm above the slope."""
    path = cloud.with_name("survey.csv")
    rows = [f"P{k},{e},{e / 2},{100.0 + 0.1 * e + 0.02}" for k, e in enumerate(np.arange(2.0, 8.0, 0.5))]
    path.write_text("\n".join(["name,e_m,n_m,h_m", *rows]) + "\n")
    return path


def call(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    status = command_line([str(word) for word in arguments])
    found = capsys.readouterr()
    return status, found.out, found.err


def test_surface__statistic_cell_and_classes_by_default(
    cloud: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stated(
        "furrowmap surface",
        "Cell size [default: the smallest round size with four points per cell]",
        "[default: median]",
        "Keep points of these classes [default: all but noise and, in furrowmap's own clouds, the machine]",
        "auto uses the ground class of the input if there is one, else smrf. [default: auto]",
        "outliers are left out. [default: none]",
    )
    status, out, _ = call(capsys, "surface", cloud, "-o", tmp_path / "out", "--crs", "EPSG:6677")
    assert status == 0
    assert re.search(r"ground +class$", out, re.MULTILINE)
    account = json.loads((tmp_path / "out" / "surfaces.json").read_text(encoding="utf-8"))
    assert account["figures"]["points"] == 9900
    with rasterio.open(tmp_path / "out" / "dsm.tif") as raster:
        assert raster.transform.a == 0.2
        assert raster.tags()["STATISTIC"] == "median"
        heights = raster.read(1, masked=True).compressed()
    assert heights.min() > 99.0, "points of class 7 are left out"
    assert SurfaceSettings() == SurfaceSettings(
        statistic="median", ground="auto", outliers="none", every=1, fill_m=0.0, cell_m=None, classes=None
    )


def test_surface__writes_what_it_names(cloud: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = {
        "dsm.tif", "dtm.tif", "height_above_ground.tif", "hillshade.tif", "slope.tif", "roughness.tif",
        "low_spots.tif", "low_spots.gpkg", "surfaces.json",
    }  # fmt: skip
    stated("furrowmap surface", *names)
    assert call(capsys, "surface", cloud, "-o", tmp_path, "--crs", "EPSG:6677", "--every", "2", "-q")[0] == 0
    assert {path.name for path in tmp_path.iterdir()} == names
    with rasterio.open(tmp_path / "slope.tif") as raster:
        slope = np.nanmedian(raster.read(1))
    assert slope == pytest.approx(np.degrees(np.arctan(0.1)), abs=0.3)


@pytest.mark.parametrize(
    ("options", "kept"),
    [
        ([], 10_000),
        (["--every", "10"], 1000),
        (["--drop-noise"], 9900),
        (["--without-class", "2"], 100),
        (["--bbox", "0,0,5,10"], 5000),
        (["--voxel", "0.4"], None),
    ],
)
def test_cloud__keeps_what_it_states(
    options: list[str], kept: int | None, cloud: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stated(
        "furrowmap cloud",
        "Leave out outliers and the noise classes 7 and 18 of the input.",
        "Keep every N-th point.",
        "outliers become noise (class 7). [default: none]",
        "none keeps the classes. [default: none]",
        "keep the point nearest to the centre of each voxel. [0.001<=x<=10]",
    )
    out = tmp_path / "out.copc.laz"
    assert call(capsys, "cloud", cloud, "-o", out, "--crs", "EPSG:6677", *options)[0] == 0
    las = laspy.read(out)
    if kept is None:
        cells = np.floor(np.column_stack([las.x, las.y, las.z]) / 0.4)
        assert len(np.unique(cells, axis=0)) == len(las) < 1250
    else:
        assert len(las) == kept
    if not options:
        truth = laspy.read(cloud)
        assert np.bincount(las.classification).tolist() == np.bincount(truth.classification).tolist()


@pytest.mark.parametrize(("voxel", "status"), [("0.001", 0), ("0.0009", 2), ("10", 0), ("10.1", 2)])
def test_cloud__limits_of_voxels(
    voxel: str, status: int, cloud: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ("cloud", cloud, "-o", tmp_path / "a.copc.laz", "--crs", "EPSG:6677", "--voxel", voxel)
    assert call(capsys, *command)[0] == status


@pytest.mark.parametrize(
    ("options", "status"),
    [
        ([], 0),
        (["--require-vertical", "0.021"], 0),
        (["--require-vertical", "0.019"], 4),
        (["--points-sigma", "0.02", "--require-vertical", "0.028"], 4),
        (["--points-sigma", "0.02", "--require-vertical", "0.029"], 0),
        (["--require-horizontal", "1"], 4),
    ],
)
def test_check__status_follows_the_required_accuracy(
    options: list[str], status: int, cloud: Path, survey: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """2 cm of the points, and 2 cm of the survey if stated; without targets there is no horizontal accuracy."""
    stated(
        "furrowmap check",
        "The exit status is 4 if a required RMSE is exceeded or cannot be determined",
        "Maximum vertical RMSE (else exit status 4).",
        "including the error of the survey",
        "horizontal error. [default: none]",
        "Diameter of discs, side of checkerboards. [default: 0.3; x>0.0]",
    )
    assert call(capsys, "check", cloud, survey, "--crs", "EPSG:6677", *options)[0] == status


def test_check__table_is_not_replaced_unasked(
    cloud: Path, survey: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stated("furrowmap check", "Write a CSV table of the errors at each point.", "Replace an existing table.")
    command = ("check", cloud, survey, "--crs", "EPSG:6677", "--table", tmp_path / "a.csv")
    assert [call(capsys, *command, *more)[0] for more in ([], [], ["--overwrite"])] == [0, 4, 0]
    with (tmp_path / "a.csv").open(encoding="utf-8", newline="") as file:
        assert [float(row["error_h_m"]) for row in csv.DictReader(file)] == pytest.approx([-0.02] * 12, abs=0.002)


def test_inspect__status_is_3_if_one_of_several_cannot_be_read(
    cloud: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stated(
        "furrowmap inspect",
        "Unreadable files are reported on standard error, the others are still described. The exit status is then 3.",
    )
    (tmp_path / "empty.pcap").touch()
    status, out, err = call(capsys, "inspect", tmp_path / "empty.pcap", cloud)
    assert (status, "10,000" in out, "empty.pcap" in err) == (3, True, True)


def test_quiet_and_log_file(cloud: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stated(
        "furrowmap",
        "Show only warnings and errors, and no progress bar.",
        "Log every step to standard error; -vv includes libraries.",
        "Append a log with timestamps to this file.",
    )
    log = tmp_path / "log.txt"
    assert call(capsys, "inspect", cloud, "-q")[2] == ""
    assert "slope.las" in call(capsys, "inspect", cloud, "-v")[2]
    for _ in range(2):
        assert call(capsys, "inspect", cloud, "-q", "--log-file", log)[0] == 0
    lines = log.read_text(encoding="utf-8").splitlines()
    assert sum("slope.las" in line for line in lines) == 2
    assert all(re.match(r"\d{4}-\d\d-\d\d[ T]\d\d:\d\d:\d\d", line) for line in lines)


def test_defaults__of_the_evaluation() -> None:
    stated(
        "furrowmap gnss evaluate",
        "[default: 0,0,0]",
        "leave out epochs without a fixed solution in the reference. [default: any]",
        "Maximum interpolation gap of the reference [default: 1.5 times its interval]",
    )
    defaults = {name: one.default for name, one in python_inspect.signature(evaluate).parameters.items()}
    assert defaults["antenna_offset_m"] == (0.0, 0.0, 0.0)
    assert (defaults["fixed_reference_only"], defaults["max_gap_s"]) == (False, None)


@pytest.mark.parametrize(
    ("options", "name"),
    [([], "result_gpkg.gpkg"), (["--to", "csv"], "result_csv"), (["--to", "kml"], "result_kml.kml")],
)
def test_export__target_by_default(
    options: list[str], name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stated("furrowmap export", "Output format. [default: gpkg]", "[default: DIR_FORMAT beside DIR]")
    folder = tmp_path / "result"
    folder.mkdir()
    write_field(folder / "field.gpkg", worked_field()[0], FRAME.crs, worked_field()[1])
    write_report(folder, "North field")
    status, out, _ = call(capsys, "export", folder, *options, "--json")
    assert (status, Path(json.loads(out)["target"]).name) == (0, name)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(["result", name])


def test_statuses__are_those_of_the_page(cloud: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    listed = dict(re.findall(r"^\| (\d+) \| (.+) \|$", COMMANDS, re.MULTILINE))
    assert listed == {
        "0": "success",
        "1": "failure",
        "2": "usage error",
        "3": "invalid or unreadable input",
        "4": "refused, or a required accuracy not met",
        "130": "interrupted; no partial files are left",
    }
    existing = tmp_path / "a.copc.laz"
    existing.touch()
    assert call(capsys, "inspect", cloud)[0] == 0
    assert call(capsys, "inspect")[0] == 2
    assert call(capsys, "inspect", tmp_path)[0] == 3
    assert call(capsys, "cloud", cloud, "-o", existing, "--crs", "EPSG:6677")[0] == 4
