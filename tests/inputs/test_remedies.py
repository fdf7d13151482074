"""Remedies about a CRS that is not there, typed as they are printed: the right result, or the right place to look.

Truth is the same cloud, raster or polygons with their CRS stated.
"""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import geopandas as gpd
import pytest
import rasterio
from click.testing import CliRunner
from pyproj import CRS
from rasterio.rio.main import main_group

from furrowmap.cli.main import command_line
from tests.core.readers import test_raster_heights as rasters
from tests.exporters.farm.result_folders import write_result
from tests.inputs import test_clouds as clouds
from tests.inputs.test_typed_commands import answer, crop, plots, points

Capture = pytest.CaptureFixture[str]


def said(capsys: Capture, *typed: object) -> list[str]:
    """The lines of a refusal."""
    capsys.readouterr()
    assert command_line([*map(str, typed)]) == 3
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 3
    return lines


def warnings(capsys: Capture, *typed: object) -> dict[str, str]:
    capsys.readouterr()
    assert command_line([*map(str, typed), "--json"]) == 0
    return {one["code"]: one["text"] for one in json.loads(capsys.readouterr().out)["warnings"]}


OF_CLOUDS: Mapping[str, Callable[[Path, Path], list[object]]] = {
    "surface": lambda path, out: ["surface", path, "-o", out / "surface", "--cell", 1],
    "cloud": lambda path, out: ["cloud", path, "-o", out / "out.copc.laz"],
    "parcels": lambda path, out: ["parcels", path, plots(out), "-o", out / "parcels"],
    "check": lambda path, out: ["check", path, points(out)],
}


@pytest.mark.parametrize("command", OF_CLOUDS)
def test_cloud_without_crs__is_read_with_the_stated_one_and_a_wrong_one_is_named(
    command: str, tmp_path: Path, capsys: Capture
) -> None:
    plain = clouds.las(tmp_path / "plain.las")
    path = clouds.las(tmp_path / "bare.las", None)
    typed = OF_CLOUDS[command](path, tmp_path)
    assert "--crs" in said(capsys, *typed)[2]
    lines = said(capsys, *typed, "--crs", "EPSG:4326")  # coordinates of a map, in degrees by the option
    assert "no longitude and latitude" in lines[0]
    assert "State with --crs the projected CRS" in lines[2]
    if command == "parcels":
        assert "that of the points with --crs" in said(capsys, *typed, "--crs", "EPSG:6677")[2]
    else:
        notices = warnings(capsys, *typed, "--crs", "EPSG:6677")  # of Japan; the cloud is none of it
        assert "Check --crs" in notices["crs-stated-elsewhere"]
    found = answer(capsys, *typed, "--crs", clouds.MAP, "--overwrite") if command != "check" else None
    found = answer(capsys, *typed, "--crs", clouds.MAP) if found is None else found
    same = OF_CLOUDS[command](plain, tmp_path)
    truth = answer(capsys, *same) if command == "check" else answer(capsys, *same, "--overwrite")
    assert found == pytest.approx(truth, rel=1e-6, abs=1e-6)


def test_cloud__whose_file_states_degrees_for_metres(tmp_path: Path, capsys: Capture) -> None:
    path = clouds.las(tmp_path / "bare.las", None)
    cloud = clouds.laspy.read(path)
    cloud.header.add_crs(CRS("EPSG:4326"))
    cloud.write(path)
    lines = said(capsys, "surface", path, "-o", tmp_path / "out", "--cell", 1)
    assert f"pdal translate {path}" in lines[2]


def bare(path: Path) -> Path:
    """The raster without its CRS."""
    with rasterio.open(path) as raster:
        profile: dict[str, Any] = {key: value for key, value in raster.profile.items() if key != "crs"}
        band = raster.read()
    with rasterio.open(path, "w", **profile) as raster:
        raster.write(band)
    return path


def do_as_printed(line: str) -> None:
    """The command of rasterio that a remedy prints, with the CRS of the raster in place of the example."""
    (command,) = re.findall(r"`rio (.*?)`", line)
    words = [rasters.MAP if word.startswith("EPSG:") else word for word in shlex.split(command)]
    done = CliRunner().invoke(main_group, words)
    assert done.exit_code == 0, done.output


@pytest.mark.parametrize("command", ["check", "parcels --soil", "tie --reference", "farm mosaic"])
@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_raster_without_crs__is_read_after_the_command_that_is_printed(
    command: str, tmp_path: Path, capsys: Capture
) -> None:
    folders = [write_result(tmp_path / name, crs=rasters.MAP) for name in ("one", "two")]
    paths = [rasters.write(folder / "dsm.tif") for folder in folders]
    path = bare(paths[1])
    table = tmp_path / "points.csv"
    rows = [f"p{k},{x:.3f},{y:.3f},{rasters.plane_m(x, y):.4f}\n" for k, (x, y) in enumerate(rasters.PLACES.tolist())]
    table.write_text("name,e_m,n_m,h_m\n" + "".join(rows))
    typed: dict[str, list[object]] = {
        "check": ["check", path, table],
        "parcels --soil": ["parcels", crop(tmp_path), plots(tmp_path), "--soil", path, "-o", tmp_path / "out"],
        "tie --reference": ["tie", folders[0], "-o", tmp_path / "out", "--reference", path],
        "farm mosaic": ["farm", "mosaic", *folders, "-o", tmp_path / "mosaic.tif"],
    }
    lines = said(capsys, *typed[command])
    assert lines[0] == f"{path} has no CRS."
    do_as_printed(lines[2])
    with rasterio.open(path) as raster:
        assert CRS(raster.crs.to_wkt()) == CRS(rasters.MAP)
    status = command_line([*map(str, typed[command])])
    assert (status, "no CRS" in capsys.readouterr().err) in ((0, False), (3, False))


@pytest.mark.parametrize("option", ["--crs", "--dst-crs"])
@pytest.mark.parametrize("text", ["EPSG:99999", "EPSG:5703", "EPSG:4978", "metres"])
def test_text_that_is_no_crs__has_an_example_that_is_taken(
    option: str, text: str, tmp_path: Path, capsys: Capture
) -> None:
    """The example is a map in metres: degrees would be refused in the next step."""
    path = clouds.las(tmp_path / "cloud.las", None if option == "--crs" else clouds.MAP)
    lines = said(capsys, "surface", path, "-o", tmp_path / "out", option, text)
    (example,) = re.findall(r"EPSG:\d+", lines[2])
    assert CRS(example).is_projected
    assert {axis.unit_name for axis in CRS(example).axis_info} == {"metre"}


@pytest.mark.parametrize("name", ["polygons.geojson", "polygons.kml"])
def test_polygons_in_metres__are_read_once_their_crs_is_assigned(name: str, tmp_path: Path, capsys: Capture) -> None:
    """What a GIS does of the printed remedy; saving alone would keep the wrong degrees."""
    cloud = clouds.las(tmp_path / "cloud.las")
    own = gpd.read_file(plots(tmp_path))
    path = tmp_path / name
    ring = [[x, y] for x, y in own.geometry[0].exterior.coords]
    if name.endswith("kml"):
        places = " ".join(f"{x},{y},0" for x, y in ring)
        path.write_text(
            '<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><name>A1</name><Polygon><outerBoundaryIs>'
            f"<LinearRing><coordinates>{places}</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>"
            "</Document></kml>"
        )
    else:
        feature = {
            "type": "Feature",
            "properties": {"id": "A1"},
            "geometry": {"type": "Polygon", "coordinates": [ring]},
        }
        path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    typed = ["surface", cloud, "-o", tmp_path / "out", "--cell", 1, "--within"]
    line = said(capsys, *typed, path)[2]
    assert "Assign the CRS" in line
    assert "GeoPackage" in line
    again = tmp_path / "again.gpkg"
    gpd.read_file(path)[["geometry"]].set_crs(clouds.MAP, allow_override=True).to_file(again)
    found = answer(capsys, *typed, again)
    assert found == pytest.approx(answer(capsys, *typed, plots(tmp_path), "--overwrite"), rel=1e-9)
