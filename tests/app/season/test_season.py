"""A season: mosaics as the sessions' rasters, tables with every point and pose, and a catalogue that clients read."""

from __future__ import annotations

import json
import shutil
import urllib.request
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import geopandas as gpd
import laspy
import numpy as np
import pyarrow.dataset as ds
import pyarrow.parquet as pq
import pystac
import pystac_client
import pytest
import rasterio
import shapely
from pyproj import CRS, Transformer
from pystac.extensions.pointcloud import PointcloudExtension
from pystac.extensions.projection import ProjectionExtension
from pystac.extensions.table import TableExtension
from rasterio.merge import merge
from rio_cogeo import cog_validate

import furrowmap
from furrowmap.cli.main import command_line
from furrowmap.core.runtime.errors import InputError, RefusedError, UsageError
from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.rasters.cog import HEIGHT_BAND, STANDARD_ERROR_BAND, Band, with_heights
from furrowmap.workflows.season import season as season_module
from furrowmap.workflows.season.season import SeasonPlan, _lost, plan_tiles
from furrowmap.workflows.season.season_sources import find_sessions
from furrowmap.workflows.season.season_tasks import SessionTables, write_part
from tests.app.files_server import served
from tests.exporters.rasters.written_cogs import write_cog

JAPAN = CRS.from_epsg(6677)
UTM = CRS.from_epsg(6691)
CELL_M = 0.05
WEST, NORTH = 332_790, 1_931_420
"""Of the simulated surface, in cells."""
STARTS = {
    "a": ("2026-06-11T14:59:58.000Z", "2026-06-11T15:00:04.000Z"),
    "b": ("2026-06-20T05:00:00.000Z", "2026-06-20T05:00:06.000Z"),
    "c": ("2026-06-20T07:00:00.000Z", "2026-06-20T07:00:06.000Z"),
}
DATES = {"a": "2026-06-11", "b": "2026-06-20", "c": "2026-06-20"}
TILE = 300
ROWS = 150_000


@pytest.fixture(scope="module")
def results(result: furrowmap.Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three sessions on two days: copies of a result with other times and surfaces, the last one without a cloud."""
    root = tmp_path_factory.mktemp("batch") / "results"
    rng = np.random.default_rng(30)
    for k, (name, (start, end)) in enumerate(STARTS.items()):
        folder = root / name
        folder.mkdir(parents=True)
        for file in ("field.gpkg",) if name == "c" else ("field.gpkg", "cloud.copc.laz"):
            shutil.copy(result.path / file, folder)
        report = json.loads((result.path / "report.json").read_text(encoding="utf-8"))
        report["session"]["name"] = f"Feld {name}"
        report["figures"] |= {"start": start, "end": end}
        (folder / "report.json").write_text(json.dumps(report), encoding="utf-8")
        grid = Grid(CELL_M, WEST + 150 * k, NORTH - 100 * k, (500, 400))
        for product, band in (("dsm", HEIGHT_BAND), ("change", Band("change"))):
            values = 270.0 + rng.integers(0, 64, grid.shape) / 8.0
            values[rng.random(grid.shape) < 0.3] = np.nan
            bands, arrays = (band, STANDARD_ERROR_BAND), (values, 0.01 * values)
            write_cog(folder / f"{product}.tif", grid, with_heights(JAPAN), bands, arrays, Origin(name))
    (root / "batch.csv").write_text("")
    return root


@pytest.fixture(scope="module")
def made(results: Path) -> Iterator[Path]:
    """The season of them, in tiles of 15 m."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(season_module, "MOSAIC_TILE_CELLS", TILE)
        assert command_line(["season", str(results), "-o", str(results.parent / "season"), *OPTIONS]) == 0
        yield results.parent / "season"


OPTIONS = ["--workers", "1", "--most-rows", str(ROWS)]
SETTINGS = furrowmap.SeasonSettings(workers=1, most_rows=ROWS)


@pytest.mark.parametrize("product", ["dsm", "change"])
@pytest.mark.parametrize("date", ["2026-06-11", "2026-06-20"])
def test_mosaic__has_the_cells_of_the_sessions_the_latest_on_top(
    results: Path, made: Path, product: str, date: str
) -> None:
    names = [name for name, day in DATES.items() if day == date]
    truth, transform = merge([results / name / f"{product}.tif" for name in reversed(names)], method="first")
    tiles = sorted((made / "mosaics" / date).glob(f"{product}_*.tif"))
    assert len(tiles) > 1
    with rasterio.open(made / "mosaics" / date / f"{product}.vrt") as whole:
        found = whole.read()
        east, south = whole.transform.c, whole.transform.f
        # One grid for all dates: the extent of a tile is that of all sessions in it.
        row, column = round((south - transform.f) / CELL_M), round((transform.c - east) / CELL_M)
    part = found[:, row : row + truth.shape[1], column : column + truth.shape[2]]
    np.testing.assert_array_equal(part, truth)
    assert np.isfinite(found).sum() == np.isfinite(truth).sum()
    for tile in tiles:
        assert cog_validate(tile, strict=True)[0]
    with rasterio.open(tiles[0]) as raster:
        assert raster.tags()["INPUT_1"].startswith(f"Feld-{names[0]}-")
        assert raster.descriptions[1] == "standard error"


def test_tiles__of_one_place_are_the_same_on_all_dates_and_join_without_overlap(made: Path) -> None:
    places: dict[str, set[Any]] = {}
    for path in made.glob("mosaics/*/*.tif"):
        with rasterio.open(path) as raster:
            bounds = np.array(raster.bounds) / CELL_M
            np.testing.assert_allclose(bounds, bounds.round(), atol=1e-4)
            places.setdefault(path.stem.partition("_")[2], set()).add(tuple(bounds.round().astype(int).tolist()))
    assert all(len(bounds) == 1 for bounds in places.values())
    boxes = [shapely.box(*bounds.pop()) for bounds in places.values()]
    assert shapely.union_all(boxes).area == sum(box.area for box in boxes)


def test_coverage__counts_the_passes_over_each_centre(results: Path, made: Path) -> None:
    passes = gpd.read_file(results / "b" / "field.gpkg", layer="passes").geometry
    assert len(passes)
    with rasterio.open(made / "mosaics" / "2026-06-20" / "coverage.vrt") as raster:
        found = np.nan_to_num(raster.read(1))
        rows, columns = np.indices(found.shape)
        x, y = raster.transform @ (columns + 0.5, rows + 0.5)
    truth = 2 * sum(shapely.contains_xy(shape, x, y).astype(int) for shape in passes)  # sessions b and c
    assert truth.max() == 2
    # Centres on an edge may count or not.
    edge = shapely.dwithin(shapely.union_all(passes.boundary.to_numpy()), shapely.points(x, y), 1e-6)
    np.testing.assert_array_equal(found[~edge], truth[~edge])


def test_points__are_those_of_the_clouds(results: Path, made: Path) -> None:
    cloud = laspy.read(results / "b" / "cloud.copc.laz")
    counts = ds.dataset(made / "points", partitioning="hive").to_table(columns=["date"]).column("date").value_counts()
    assert {row["values"]: row["counts"] for row in counts.to_pylist()} == dict.fromkeys(DATES.values(), len(cloud))
    files = sorted(made.glob("points/date=2026-06-20/Feld-b-*.parquet"))
    assert [pq.read_metadata(file).num_rows for file in files[:-1]] == [ROWS] * (len(files) - 1)
    own = gpd.read_parquet(files)
    assert own.crs == JAPAN
    assert set(own["session"]) == {"Feld-b-20260620T050000Z"}
    gps_s = own["time"].astype("int64").to_numpy() / 1e6 - 315_964_800.0 + 18.0  # 2026: 18 leap seconds
    names = ("intensity", "classification", "return_number", "point_source_id")
    xyz = shapely.get_coordinates(own.geometry, include_z=True)
    found, truth = [*xyz.T, *(own[name] for name in names)], [*cloud.xyz.T, *(cloud[name] for name in names)]
    np.testing.assert_array_equal(np.sort(digests(found)), np.sort(digests(truth)))
    np.testing.assert_allclose(np.sort(gps_s), np.sort(cloud.gps_time + 1e9), rtol=0.0, atol=2e-6)
    assert own["red"].isna().all()


def digests(columns: list[Any]) -> np.ndarray:
    """A number for each row of coordinates, in millimetres, and whole numbers."""
    total = np.zeros(len(columns[0]), np.uint64)
    for column, steps in zip(columns, (1e3, 1e3, 1e3, 1, 1, 1, 1), strict=True):
        whole = np.rint(np.asarray(column, np.float64) * steps).astype(np.int64).view(np.uint64)
        total = (total + whole) * np.uint64(0x9E3779B97F4A7C15)
        total ^= total >> np.uint64(31)
    return total


def test_files__are_geoparquet_whose_boxes_hold_their_rows(made: Path) -> None:
    file = min(made.glob("points/*/*.parquet"))
    meta = json.loads(pq.read_schema(file).metadata[b"geo"])
    column = meta["columns"]["geometry"]
    assert (meta["version"], column["encoding"], column["geometry_types"]) == ("1.1.0", "WKB", ["Point Z"])
    assert CRS.from_json_dict(column["crs"]) == JAPAN
    whole = gpd.read_parquet(file)
    np.testing.assert_array_equal(column["bbox"], whole.total_bounds)
    boxes = pq.read_table(file, columns=["bbox"]).column("bbox").combine_chunks().flatten()
    west, south, east, north = (np.asarray(side, np.float64) for side in boxes)
    x, y = whole.geometry.x.to_numpy(), whole.geometry.y.to_numpy()
    assert ((west <= x) & (x <= east) & (south <= y) & (y <= north)).all()
    assert max((east - west).max(), (north - south).max()) < 0.02
    middle = shapely.box(*whole.total_bounds).centroid
    box = (middle.x - 3, middle.y - 3, middle.x + 3, middle.y + 3)
    found = gpd.read_parquet(file, bbox=box)
    assert whole.geometry.intersects(shapely.box(*box)).sum() == found.geometry.intersects(shapely.box(*box)).sum()
    assert json.loads(pq.read_schema(file).metadata[b"furrowmap"])["TITLE"].startswith("Feld-a-")


def test_trajectories__have_the_poses_of_the_layers(results: Path, made: Path) -> None:
    truth = gpd.read_file(results / "a" / "field.gpkg", layer="trajectory").sort_values("t_s")
    own = gpd.read_parquet(made / "trajectories" / "date=2026-06-11").sort_values("time")
    assert len(own) == len(truth)
    np.testing.assert_array_equal(
        shapely.get_coordinates(own.geometry, include_z=True), shapely.get_coordinates(truth.geometry, include_z=True)
    )
    np.testing.assert_allclose(own["time"].astype("int64") / 1e6, truth["t_s"], atol=1e-6)
    for name in ("heading_deg", "sigma_h_m", "tool_height_m", "pass", "scan"):
        np.testing.assert_array_equal(own[name].astype(float), truth[name].astype(float), err_msg=name)
    for name in ("motion", "implement", "fix"):
        assert own[name].tolist() == truth[name].tolist()
    assert len(gpd.read_parquet(made / "trajectories")) == 3 * len(truth)


def test_catalogue__is_valid_and_read_by_pystac_client_from_a_server_of_plain_files(
    results: Path, made: Path, tmp_path: Path
) -> None:
    with served(results.parent) as address:
        client = pystac_client.Client.open(f"{address}season/catalog.json")
        collections = {collection.id: collection for collection in client.get_collections()}
        assert set(collections) == {f"season-{name}" for name in ("sessions", "mosaics", "points", "trajectories")}
        items = {name: list(collection.get_items()) for name, collection in collections.items()}
        for what in (client, *collections.values(), *(item for found in items.values() for item in found)):
            pystac.validation.validate_dict(what.to_dict(), extensions=[])
        tile = next(item for item in items["season-mosaics"] if "dsm" in item.assets)
        href = tile.assets["dsm"].get_absolute_href()
        assert href is not None
        (tmp_path / "dsm.tif").write_bytes(urllib.request.urlopen(href).read())
    with rasterio.open(tmp_path / "dsm.tif") as raster:
        assert ProjectionExtension.ext(tile).code == "EPSG:6677"
        assert tuple(tile.properties["proj:shape"]) == raster.shape
        assert tuple(tile.properties["proj:transform"][:6]) == tuple(raster.transform)[:6]
        (height, error) = tile.assets["dsm"].extra_fields["bands"]
        assert height["statistics"]["minimum"] == np.nanmin(raster.read(1))
        assert (error["name"], error["unit"], error["data_type"]) == ("standard error", "m", "float32")
    days = {item.properties["furrowmap:date"] for item in items["season-mosaics"]}
    assert days == set(DATES.values())
    assert len(items["season-sessions"]) == 3
    session = next(item for item in items["season-sessions"] if item.properties["title"] == "Feld a")
    assert (
        PointcloudExtension.ext(session).count
        == json.loads((results / "a/report.json").read_text())["figures"]["points"]
    )
    points = {item.properties["furrowmap:date"]: item for item in items["season-points"]}
    for date, item in points.items():
        assert TableExtension.ext(item).row_count == ds.dataset(made / "points" / f"date={date}").count_rows()
        assert {column.name for column in TableExtension.ext(item).columns or ()} >= {"geometry", "time", "session"}


def test_all_that_a_catalogue_links_to_is_there(made: Path) -> None:
    for path in [made / "catalog.json", *made.glob("stac/*/*.json")]:
        content = json.loads(path.read_text(encoding="utf-8"))
        assets = content.get("assets", {}).values() if path.parent.name != "sessions" else ()
        for link in (*content["links"], *assets):
            assert (path.parent / link["href"]).is_file(), (path, link)
    session = json.loads(next(made.glob("stac/sessions/Feld-a*.json")).read_text())
    assert (made / "stac/sessions" / session["assets"]["cloud"]["href"]).is_file()


def test_season__again_makes_only_what_has_changed(results: Path, made: Path, tmp_path: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in made.rglob("*.*") if path.suffix in {".tif", ".parquet"}}
    again = furrowmap.season([results], made, SETTINGS)
    assert (again.written, again.dates) == (0, ("2026-06-11", "2026-06-20"))
    assert {path: path.stat().st_mtime_ns for path in before} == before
    own, copy = tmp_path / "season", tmp_path / "results"
    shutil.copytree(made, own)
    shutil.copytree(results, copy)  # times of files stay
    shutil.rmtree(copy / "c")
    report = copy / "a" / "report.json"
    report.write_text(report.read_text(encoding="utf-8") + " ", encoding="utf-8")
    notes = own / "trajectories" / "date=2026-06-20" / "notes.txt"
    notes.write_text("mine")
    changed = furrowmap.season([copy], own, replace(SETTINGS, content=("points",)))
    assert (changed.written, changed.unchanged, changed.tiles, changed.poses) == (1, 1, 0, 0)
    left = {path.relative_to(own).as_posix().split("-000")[0] for path in own.rglob("*") if path.is_file()}
    assert left == {
        "catalog.json", "season.json", "trajectories/date=2026-06-20/notes.txt",
        "points/date=2026-06-11/Feld-a-20260611T145958Z", "points/date=2026-06-20/Feld-b-20260620T050000Z",
        "stac/sessions/collection.json", "stac/points/collection.json",
        "stac/sessions/Feld-a-20260611T145958Z.json", "stac/sessions/Feld-b-20260620T050000Z.json",
        "stac/points/points_2026-06-11.json", "stac/points/points_2026-06-20.json",
    }  # fmt: skip
    assert ds.dataset(list(own.glob("points/*/*.parquet"))).count_rows() == changed.points


def tables(source: Path, out: Path, **other: Any) -> SessionTables:
    return replace(SessionTables(out, "x", source, JAPAN, JAPAN, 0.0, 10**6, Origin("test")), **other)


def test_points__in_another_crs_and_of_coarse_levels(results: Path, tmp_path: Path) -> None:
    cloud = results / "a" / "cloud.copc.laz"
    told = write_part(tables(cloud, tmp_path, crs=UTM, spacing_m=2.0))
    assert isinstance(told, dict)
    own, truth = gpd.read_parquet(tmp_path / "x-0001.parquet"), laspy.read(cloud)
    assert own.crs == UTM
    assert 0 < len(own) < 0.2 * len(truth)
    x, y = Transformer.from_crs(UTM, JAPAN, always_xy=True).transform(own.geometry.x, own.geometry.y)
    tree = shapely.STRtree(shapely.points(truth.x, truth.y))
    _, off_m = tree.query_nearest(shapely.points(x, y), return_distance=True)
    assert off_m.max() < 1e-6
    # Where the cloud has points, a sufficient number of them is left.
    _, far_m = shapely.STRtree(shapely.points(x, y)).query_nearest(
        shapely.points(truth.x[::500], truth.y[::500]), return_distance=True, all_matches=False
    )
    assert np.median(far_m) < 2.0


def test_error_of_a_part__is_what_comes_of_it(results: Path, tmp_path: Path) -> None:
    broken = tmp_path / "cloud.copc.laz"
    broken.write_bytes((results / "a" / "cloud.copc.laz").read_bytes()[:5000])
    found = write_part(tables(broken, tmp_path / "points"))
    assert isinstance(found, InputError)
    assert not list((tmp_path / "points").glob("*"))
    assert _lost("points/x").code == "worker-lost"


def test_surfaces_moved_by_a_tie__take_the_place_of_their_results(results: Path, tmp_path: Path) -> None:
    tie = tmp_path / "tie"
    tie.mkdir()
    grid = Grid(CELL_M, WEST, NORTH, (50, 40))
    write_cog(tie / "dsm_01.tif", grid, with_heights(JAPAN), [HEIGHT_BAND], [np.full(grid.shape, 99.0)], Origin("tie"))
    rows = [{"surface": "dsm_01.tif", "folder": str(results / "a")}, {"surface": "", "folder": str(results / "b")}]
    (tie / "tie.json").write_text(json.dumps({"dates": rows}))
    sessions, (notice,) = find_sessions([results, tie], tmp_path)
    assert notice.code == "season-ties"
    assert "1 of 3 sessions" in notice.text
    planned = plan_tiles(SeasonPlan(tmp_path, sessions, JAPAN), 0.1)
    tiles = [one.part for one in planned.values() if (one.kind, str(one.date)) == ("dsm", "2026-06-11")]
    found = np.empty(0)
    for tile in tiles:
        assert isinstance(write_part(tile), dict)
        with rasterio.open(tile.out) as raster:
            assert (raster.res, raster.count) == ((0.1, 0.1), 1)  # the band that all have
            values = raster.read()
        found = np.concatenate([found, values[np.isfinite(values)]])
    assert set(found.tolist()) == {99.0}
    assert len(found) == 25 * 20


def test_surface_without_the_band_of_the_others__is_an_error(results: Path, tmp_path: Path) -> None:
    grid = Grid(CELL_M, WEST, NORTH, (5, 4))
    write_cog(tmp_path / "other.tif", grid, with_heights(JAPAN), [Band("x")], [np.ones(grid.shape)], Origin("x"))
    sessions, _ = find_sessions([results], tmp_path)
    sessions[0] = replace(sessions[0], surfaces={"dsm": tmp_path / "other.tif"})
    with pytest.raises(InputError, match="has no band 'height'"):
        plan_tiles(SeasonPlan(tmp_path, sessions, JAPAN), None)


def test_what_cannot_be_one_season__is_refused(results: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no result"):
        furrowmap.season([tmp_path], tmp_path / "season")
    with pytest.raises(InputError, match="does not exist"):
        furrowmap.season([tmp_path / "nowhere"], tmp_path / "season")
    shutil.copytree(results / "a", tmp_path / "copy" / "a")
    with pytest.raises(InputError, match="same session"):
        furrowmap.season([results, tmp_path / "copy"], tmp_path / "season")
    report = json.loads((results / "a" / "report.json").read_text(encoding="utf-8"))
    report["session"]["name"], report["session"]["crs"]["heights"] = "other", "GSIGEO2024"
    (tmp_path / "copy" / "a" / "report.json").write_text(json.dumps(report), encoding="utf-8")
    with pytest.raises(RefusedError, match="several height systems"):
        furrowmap.season([results, tmp_path / "copy"], tmp_path / "season")
    report["session"]["crs"]["heights"] = json.loads((results / "b/report.json").read_text())["session"]["crs"][
        "heights"
    ]
    (tmp_path / "copy" / "a" / "report.json").write_text(json.dumps(report), encoding="utf-8")
    layer = gpd.read_file(results / "a" / "field.gpkg", layer="trajectory").to_crs(UTM)
    (tmp_path / "copy" / "a" / "field.gpkg").unlink()
    layer.to_file(tmp_path / "copy" / "a" / "field.gpkg", layer="trajectory")
    with pytest.raises(RefusedError, match="a season have one CRS"):
        furrowmap.season([results, tmp_path / "copy"], tmp_path / "season")
    with pytest.raises(UsageError, match="--content 'clouds' is not one of mosaics"):
        furrowmap.season([results], tmp_path / "season", furrowmap.SeasonSettings(content=("clouds",)))
    with pytest.raises(RefusedError, match="result folder of a run"):
        furrowmap.season([results], results / "a")
    (tmp_path / "season").mkdir()
    (tmp_path / "season" / "catalog.json").write_text("{}")
    with pytest.raises(RefusedError, match=r"already contains catalog\.json"):
        furrowmap.season([results], tmp_path / "season")
