"""What commands say about the CRS of a cloud: a CRS that they propose works as it is typed, whatever the cloud's is.

The cloud is a plane that rises by 2 cm in a metre to the east and 1 cm to the north, in the CRS of the test.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import laspy
import numpy as np
import pytest
import rasterio
from pyproj import CRS, Transformer

from furrowmap.cli.main import command_line
from furrowmap.core.pointclouds.joined_clouds import open_clouds
from furrowmap.core.readers.las.cloud import open_cloud
from furrowmap.core.runtime.errors import InputError

SLOPE_DEG = float(np.degrees(np.arctan(np.hypot(0.02, 0.01))))
FEET_US = 1200 / 3937
LOCAL = 'LOCAL_CS["mine",LOCAL_DATUM["mine",0],UNIT["{}",{}],AXIS["X",EAST],AXIS["Y",NORTH]]'
IN_METRES, IN_FEET = LOCAL.format("metre", 1.0), LOCAL.format("US survey foot", FEET_US)
PLACES = {
    "DE": (10.15, 51.45, 32632),
    "US": (-74.1057, 41.5779, 32618),
    "JP": (139.7, 35.7, 32654),
    "TX": (-97.5, 26.0, 32614),
    "FJ": (179.9999, -17.0, 32760),
}
"""Longitude and latitude, and the UTM zone in which the plane is one."""
NOT_MEASURABLE = (
    ("EPSG:4326", "DE"),
    ("EPSG:4979", "DE"),
    ("EPSG:4326", "FJ"),
    ("EPSG:4269", "US"),  # NAD83 to the country's map: four grids
    ("EPSG:4267", "US"),  # NAD27
    ("EPSG:4301", "JP"),  # Tokyo: a grid to the country's map
    ("EPSG:2260", "US"),
    ("EPSG:2260+6360", "US"),
    ("EPSG:32015", "US"),  # NAD27 in feet
    ("EPSG:3857", "DE"),
    ("EPSG:3857", "JP"),
    ("EPSG:3395", "US"),
    ("EPSG:6933", "DE"),
    ("EPSG:3978+5703", "US"),
    ("EPSG:32640", "DE"),  # the zone of another continent
)
MEASURABLE = (("EPSG:25832", "DE"), ("EPSG:25832+7837", "DE"), ("EPSG:26918+6360", "US"), ("EPSG:30169", "JP"))


def cloud(
    path: Path,
    crs: str | None,
    at: str = "DE",
    *,
    east_m: float = 0.0,
    coordinates: str | None = None,
    step_m: float = 0.25,
) -> Path:
    """The plane of 20 by 20 m; `coordinates` are those of another CRS than the one that the file states."""
    lon, lat, zone = PLACES[at]
    x, y = (axis.ravel() for axis in np.meshgrid(*(np.arange(0.0, 20.0, step_m),) * 2))
    height_m = 100.0 + 0.02 * (east_m + x) + 0.01 * y
    e0, n0 = Transformer.from_crs(4326, zone, always_xy=True).transform(lon, lat)
    out = np.column_stack([x, y])
    named = CRS(coordinates or crs) if coordinates or (crs and not crs.startswith("LOCAL")) else None
    if named is not None:
        flat = named.sub_crs_list[0] if named.is_compound else named.to_2d()
        # by the datum alone: what a transformation between datums moves is the same for all points
        geographic = Transformer.from_crs(zone, 4326, always_xy=True).transform(e0 + east_m + x, n0 + y)
        own = Transformer.from_crs(flat.geodetic_crs.to_2d(), flat, always_xy=True)
        out = np.column_stack(own.transform(*geographic))
    unit_m = 1.0
    if named is not None and named.is_compound:
        unit_m = named.sub_crs_list[1].axis_info[0].unit_conversion_factor
    elif named is not None and named.is_projected:
        unit_m = named.axis_info[0].unit_conversion_factor
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales = np.full(3, 1e-4)
    header.offsets = np.array([*np.floor(out[0]), 0.0])
    if named is not None and named.is_geographic:
        header.scales[:2] = 1e-9
    if np.ptp(out[:, 0]) > 180.0:  # across the antimeridian
        header.scales[:2] = 1e-7
        header.offsets[:2] = 0.0
    if crs is not None:
        header.add_crs(CRS(crs)) if not crs.startswith("LOCAL") else header.vlrs.append(
            laspy.VLR("LASF_Projection", 2112, "", crs.encode() + b"\0")
        )
        header.global_encoding.wkt = True
    las = laspy.LasData(header)
    las.x, las.y, las.z = out[:, 0], out[:, 1], height_m / unit_m
    las.gps_time = np.full(len(out), 1e8)
    las.classification = np.full(len(out), 2, np.uint8)
    las.write(path)
    return path


def proposal(text: str) -> list[str]:
    """The option that a remedy proposes, as it stands."""
    found = re.search(r"such as (--[a-z-]+ [A-Z]+:[0-9+]+)", text)
    assert found is not None, text
    return found[1].split()


@pytest.mark.parametrize(("crs", "at"), NOT_MEASURABLE)
def test_surface__of_a_cloud_in_which_nothing_can_be_measured(
    crs: str, at: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = cloud(tmp_path / "cloud.las", crs, at)
    words = ["surface", str(path), "-o", str(tmp_path / "out"), "--cell", "1"]
    assert command_line(words) == 3
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 3
    assert command_line([*words, *proposal(lines[2])]) == 0
    with rasterio.open(tmp_path / "out" / "slope.tif") as raster:
        slope_deg = float(np.ma.median(raster.read(1, masked=True)))
    assert slope_deg == pytest.approx(SLOPE_DEG, rel=2e-3)
    with rasterio.open(tmp_path / "out" / "dsm.tif") as raster:
        heights = raster.read(1, masked=True)
    assert 99.9 < heights.min() < heights.max() < 100.7


@pytest.mark.parametrize(("crs", "at"), MEASURABLE)
def test_clouds__in_metres_are_read_as_they_are_with_true_heights(crs: str, at: str, tmp_path: Path) -> None:
    clouds = open_clouds([cloud(tmp_path / "cloud.las", crs, at)])
    wanted = CRS(crs)
    assert clouds.crs.is_compound == wanted.is_compound
    if wanted.is_compound:  # heights in metres, on the datum of the file
        vertical = clouds.crs.sub_crs_list[1]
        assert vertical.axis_info[0].unit_conversion_factor == 1.0
        assert vertical.to_epsg(min_confidence=20) == {7837: 7837, 6360: 5703}[wanted.sub_crs_list[1].to_epsg()]
    xyz = np.concatenate([batch.xyz_m for batch in clouds.batches()])
    assert 99.9 < xyz[:, 2].min() < xyz[:, 2].max() < 100.7


def test_map_of_a_continent__has_a_notice_of_its_scale(tmp_path: Path) -> None:
    clouds = open_clouds([cloud(tmp_path / "cloud.las", "EPSG:5070+5703", "TX")])
    (said,) = [notice.text for notice in clouds.notices if notice.code == "map-scale"]
    assert "0.9910 to 1.0091" in said


COMMANDS = {
    "cloud": ["-o", "made.copc.laz"],
    "features": ["-o", "made"],
    "canopy": ["-o", "made", "--cell", "5"],
    "parcels": ["parcels.geojson", "-o", "made"],
}
"""Arguments besides the cloud of commands that take one."""


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:3857", "EPSG:2260"])
def test_commands__propose_the_same_crs_and_take_it(
    command: str, crs: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    at = "US" if crs == "EPSG:2260" else "DE"
    cloud(tmp_path / "cloud.las", crs, at)
    lon, lat, _ = PLACES[at]
    ring = [[lon + 1e-5, lat + 1e-5], [lon + 2e-4, lat + 1e-5], [lon + 2e-4, lat + 1.5e-4], [lon + 1e-5, lat + 1.5e-4]]
    geometry = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
    parcels = {"type": "Feature", "properties": {"id": "1"}, "geometry": geometry}
    (tmp_path / "parcels.geojson").write_text(json.dumps(parcels))
    monkeypatch.chdir(tmp_path)
    words = [command, "cloud.las", *COMMANDS[command]]
    assert command_line(words) == 3
    said = proposal(capsys.readouterr().err)
    assert said == ["--dst-crs", f"EPSG:{26918 if at == 'US' else 32632}"]
    assert command_line([*words, *said]) == 0, capsys.readouterr().err


def test_growth__proposes_a_crs_for_all_flights(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flights = [cloud(tmp_path / f"{name}.las", crs) for name, crs in (("a", "EPSG:25832"), ("b", "EPSG:25833"))]
    table = tmp_path / "parcels.csv"
    table.write_text("id,lon_deg,lat_deg\n1,10.1501,51.4501\n1,10.1502,51.4501\n1,10.1502,51.4502\n")
    days = ["--day", "2026-05-01", "--day", "2026-06-01"]
    words = ["growth", *map(str, flights), str(table), "-o", str(tmp_path / "made"), *days]
    assert command_line(words) == 3
    said = proposal(capsys.readouterr().err)
    assert command_line([*words, *said]) != 2
    assert "crs-" not in capsys.readouterr().err


@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:3857", "EPSG:2260", "EPSG:25832", "EPSG:2260+6360"])
@pytest.mark.parametrize("points_in", ["degrees", "the cloud's", "another"])
def test_check__compares_in_metres_whatever_the_crs(
    crs: str, points_in: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    at = "US" if "2260" in crs else "DE"
    path = cloud(tmp_path / "cloud.las", crs, at, step_m=0.1)
    lon, lat, zone = PLACES[at]
    e0, n0 = Transformer.from_crs(4326, zone, always_xy=True).transform(lon, lat)
    off = np.array([(4.0, 5.0), (12.0, 6.0), (9.0, 15.0), (15.0, 14.0), (5.0, 12.0)])
    heights_m = 100.0 + off @ (0.02, 0.01)
    degrees = np.column_stack(
        Transformer.from_crs(zone, 4326, always_xy=True).transform(off[:, 0] + e0, off[:, 1] + n0)
    )
    flat = CRS(crs).sub_crs_list[0] if CRS(crs).is_compound else CRS(crs)
    stated = []
    rows, head = degrees, "lon_deg,lat_deg"
    if points_in == "the cloud's" and not flat.is_geographic:
        own = Transformer.from_crs(flat.geodetic_crs, flat, always_xy=True)
        rows, head = np.column_stack(own.transform(*degrees.T)), "easting,northing"
    elif points_in == "another":
        other = 26918 if at == "US" else 25832
        own = Transformer.from_crs(CRS(other).geodetic_crs, other, always_xy=True)
        rows, head, stated = np.column_stack(own.transform(*degrees.T)), "e_m,n_m", ["--crs", f"EPSG:{other}"]
    table = tmp_path / "points.csv"
    np.savetxt(table, np.column_stack([rows, heights_m]), "%.9f", ",", header=f"{head},h_m", comments="")
    assert command_line(["check", str(path), str(table), "--json", *stated]) == 0
    answer = json.loads(capsys.readouterr().out)
    errors = [point["error_h_m"] for point in answer["points"]]
    assert max(map(abs, errors)) < 0.003


@pytest.mark.parametrize("target", ["EPSG:3857", "EPSG:4326", "EPSG:2260", "EPSG:6933", "EPSG:31467", "EPSG:32660"])
def test_dst_crs__that_nothing_can_be_measured_in_is_refused_with_one_that_works(
    target: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = cloud(tmp_path / "cloud.las", "EPSG:25832")
    words = ["cloud", str(path), "-o", str(tmp_path / "out.copc.laz")]
    status = command_line([*words, "--dst-crs", target])
    if status == 0:  # where the grid is installed
        return
    assert command_line([*words, *proposal(capsys.readouterr().err)]) == 0


def test_grids__that_are_not_there_end_in_a_proposal_that_needs_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = cloud(tmp_path / "cloud.las", "EPSG:2260", "US")
    words = ["cloud", str(path), "-o", str(tmp_path / "out.copc.laz")]
    if command_line([*words, "--dst-crs", "EPSG:6347"]) == 0:
        pytest.skip("the grids are installed")
    assert command_line([*words, *proposal(capsys.readouterr().err)]) == 0


@pytest.mark.parametrize(
    ("local", "fitting", "other"),
    [
        (IN_METRES, "EPSG:25832", "EPSG:2260"),
        (IN_FEET, "EPSG:2260", "EPSG:25832"),
    ],
)
def test_local_crs__is_stated_by_the_user_or_refused(local: str, fitting: str, other: str, tmp_path: Path) -> None:
    at = "DE" if fitting == "EPSG:25832" else "US"
    path = cloud(tmp_path / "cloud.las", local, at, coordinates=fitting)
    for dst in (None, CRS("EPSG:25832")):
        with pytest.raises(InputError) as refused:
            open_clouds([path], None, dst)
        assert refused.value.code == "crs-local"
        assert "georeference the cloud first" in refused.value.remedy
    with pytest.raises(InputError) as refused:
        open_clouds([path], CRS(other))
    assert refused.value.key == "crs-local.foreign-unit"
    target = CRS("EPSG:25832") if at == "DE" else CRS("EPSG:26918")
    clouds = open_clouds([path], CRS(fitting), target)
    assert "crs-of-local" in {notice.code for notice in clouds.notices}
    xyz = np.concatenate([batch.xyz_m for batch in clouds.batches()])
    truth = Transformer.from_crs(4326, target, always_xy=True).transform(*PLACES[at][:2])
    assert np.hypot(*(xyz[0, :2] - truth)) < 3.0


def test_coordinates_from_the_centre_of_the_earth__are_refused(tmp_path: Path) -> None:
    path = cloud(tmp_path / "cloud.las", "EPSG:25832")
    las = laspy.read(path)
    las.header.vlrs.clear()
    las.header.vlrs.append(laspy.VLR("LASF_Projection", 2112, "", CRS(4978).to_wkt("WKT1_GDAL").encode() + b"\0"))
    las.write(path)
    with pytest.raises(InputError) as refused:
        open_clouds([path])
    assert refused.value.code == "crs-geocentric"


def test_tiles__of_different_statements(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    known = cloud(tmp_path / "known.las", "EPSG:25832+7837")
    silent = cloud(tmp_path / "silent.las", None, east_m=20.0, coordinates="EPSG:25832")
    flat = cloud(tmp_path / "flat.las", "EPSG:25832", east_m=20.0)
    for other in (silent, flat):
        words = ["cloud", str(known), str(other), "-o", str(tmp_path / f"{other.stem}.copc.laz")]
        assert command_line([*words, "--crs", "EPSG:25832"]) == 3
        said = re.search(r"state it with --crs (EPSG:[0-9+]+)", capsys.readouterr().err)
        assert said is not None
        assert command_line([*words, "--crs", said[1]]) == 0
        made = open_cloud(tmp_path / f"{other.stem}.copc.laz").crs
        assert made is not None
        assert made.sub_crs_list[1].to_epsg(min_confidence=20) == 7837
    neighbour = cloud(tmp_path / "neighbour.las", "EPSG:25833+7837", east_m=20.0)
    words = ["cloud", str(known), str(neighbour), "-o", str(tmp_path / "both.copc.laz")]
    assert command_line(words) == 3
    assert command_line([*words, *proposal(capsys.readouterr().err)]) == 0
    xyz = laspy.read(tmp_path / "both.copc.laz").xyz
    plane = np.linalg.lstsq(np.column_stack([xyz[:, :2] - xyz[0, :2], np.ones(len(xyz))]), xyz[:, 2], rcond=None)
    assert float(np.sqrt(plane[1][0] / len(xyz))) < 0.002


def test_heights__of_the_crs_of_the_output(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = cloud(tmp_path / "cloud.las", "EPSG:25832+7837")
    words = ["cloud", str(path), "-o", str(tmp_path / "out.copc.laz")]
    assert command_line([*words, "--dst-crs", "EPSG:25833+5783"]) == 3
    said = re.search(r"alone: --dst-crs (EPSG:[0-9]+)", capsys.readouterr().err)
    assert said is not None
    assert command_line([*words, "--dst-crs", said[1]]) == 0
    assert command_line([*words, "--dst-crs", "EPSG:25833+7837", "--overwrite"]) == 0


def test_crs_option__that_a_file_contradicts_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = cloud(tmp_path / "cloud.las", "EPSG:25832")
    words = ["cloud", str(path), "-o", str(tmp_path / "out.copc.laz"), "--json", "--crs", "EPSG:25833"]
    assert command_line(words) == 0
    answer = json.loads(capsys.readouterr().out)
    assert "crs-not-used" in {warning["code"] for warning in answer["warnings"]}


def test_foreign_clouds__end_well_with_what_is_proposed(
    shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = shared_data / "foreign" / "18-crs-remedies"
    words = ["surface", str(folder / "ftus.laz"), "-o", str(tmp_path / "feet"), "--cell", "0.5"]
    assert command_line(words) == 3
    said = proposal(capsys.readouterr().err)
    assert said == ["--dst-crs", "EPSG:26918"]
    assert command_line([*words, *said]) == 0
    with rasterio.open(tmp_path / "feet" / "dsm.tif") as raster:
        heights = raster.read(1, masked=True)
    assert 91.43 < heights.min() < heights.max() < 91.84
    tiles = [folder / "dhhn2016.laz", folder / "nocrs.laz"]
    clouds = open_clouds(tiles, CRS("EPSG:25832+7837"))
    assert clouds.crs.sub_crs_list[1].to_epsg(min_confidence=20) == 7837
    with pytest.raises(InputError) as refused:
        open_clouds([folder / "local_metre.laz"], None, CRS("EPSG:25832"))
    assert refused.value.code == "crs-local"
    assert open_clouds([folder / "local_metre.laz"], CRS("EPSG:25832")).points > 0
