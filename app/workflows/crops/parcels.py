"""Crops by parcel: heights and volumes from clouds and parcels."""

import datetime as dt
import math
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from pyproj import CRS

from furrowmap.core.crops.bare_soil import SOIL_CELL_M
from furrowmap.core.crops.dose_columns import dose_name, dose_unit, left_out_doses, parcel_doses
from furrowmap.core.crops.dose_response import fit_response
from furrowmap.core.crops.measure import MeasuredParcel, measure_parcels
from furrowmap.core.crops.parcel_areas import elsewhere_error, list_names, read_parcels
from furrowmap.core.crops.parcel_placement import (
    FAR_SHIFT_M,
    MAX_PARCEL_SHIFT_M,
    ParcelShift,
    heights_by_place,
    parcel_shift,
    parcels_elsewhere,
)
from furrowmap.core.crops.parcel_points import PUBLISHED_STRIP_M, ParcelPoints
from furrowmap.core.crops.response_values import Response, ResponseQuestion
from furrowmap.core.crops.site_soil import SoilRaster, open_soil_raster, site_soil
from furrowmap.core.crops.treatment_order import REVERSED, REVERSED_IN_BLOCKS, mistaken_order
from furrowmap.core.crops.trial_tables import day_of, read_treatments, with_treatments
from furrowmap.core.geodesy.crs_change import horizontal_part
from furrowmap.core.geodesy.local_time import local_day
from furrowmap.core.geodesy.projection import MapFrame, scale_at
from furrowmap.core.pointclouds.joined_clouds import Clouds, no_points_error, open_clouds
from furrowmap.core.pointclouds.spool_clouds import spool_clouds
from furrowmap.core.pointclouds.surfaces import GroundMethod
from furrowmap.core.readers.las.cloud import Box, Survey, is_cloud
from furrowmap.core.runtime.arrays import Float32Array
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.languages.texts import LANGUAGES, joined
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.surfaces.spool import PointSpool
from furrowmap.core.values.crs import full_name_of, name_of
from furrowmap.core.values.parcel import SOIL_METHODS, Parcel, SoilMethod
from furrowmap.exporters.files.file_records import file_records, joint_record
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.result_folder import (
    CROP_HEIGHT,
    DSM,
    DTM,
    PARCEL_PRODUCTS,
    PARCEL_SHEET,
    PARCEL_TABLE,
    PARCELS,
    PARCELS_REPORT,
    style_of,
)
from furrowmap.exporters.files.staging import recover, refuse_products, staged_folder
from furrowmap.exporters.rasters.crop_height import CropHeights
from furrowmap.exporters.vectors.crop_layers import parcel_layer, write_parcel_sheet, write_parcel_table
from furrowmap.exporters.vectors.geopackage import write_styled_layers
from furrowmap.exporters.vectors.qgis_styles import write_raster_style
from furrowmap.settings import ParcelSettings, SurfaceSettings, soil_file
from furrowmap.workflows.clouds.inputs import input_records, open_inputs, write_account
from furrowmap.workflows.clouds.rasters import CloudRasters, cells_of, extent_of
from furrowmap.workflows.clouds.surface import no_warning

SHIFT_CELL_M: Final = 0.1
MAX_SHIFT_CELLS: Final = 2000
MAX_FAR_CELLS: Final = 600
"""Cells in which the crop is looked for beside the parcels, and how many of them lie along a side at most; far away."""


def parcels(
    clouds: Sequence[str | Path],
    parcels: str | Path,
    out: str | Path,
    settings: ParcelSettings = ParcelSettings(),
    *,
    overwrite: bool = False,
    progress: Progress = silent,
    warn: Callable[[Notice], None] = no_warning,
) -> dict[str, Any]:
    """Measure height and volume of the crop on each parcel.

    Args:
        clouds: LAS, LAZ or COPC files, which are used together.
        parcels: vector file, or CSV of corners, with the gross parcels.
        out: folder for the products, made if it does not exist; all of them are written or none.
        warn: is called once with each warning, as early as it is known.

    Returns:
        The content of `parcels.json`: inputs, CRS, parameters, a row of figures per parcel, warnings, products.

    Raises:
        InputError: if a file cannot be read, the parcels are elsewhere, or no point lies in one.
        RefusedError: if the folder holds such products.
    """
    folder = Path(out)
    file = Path(parcels)
    recover(folder)
    refuse_products(folder, PARCEL_PRODUCTS, overwrite=overwrite)
    opened = open_inputs(clouds, settings)
    net = Path(settings.net) if settings.net else None
    areas, decided = read_parcels(file, opened.crs, settings.net_inset_m, net)
    assign_treatments(areas, settings, dt.date.max)  # an error of the table is raised before the work
    around_m = PUBLISHED_STRIP_M if settings.published else None
    with staged_folder(folder) as staging, ParcelPoints(areas, staging.parent, around_m, decided) as points:
        expect_soil(soil_file(settings.soil), opened.crs, points.box_m)
        notices, span_s = collect_points(opened, file, points, settings.classes, progress)
        soil = soil_file(settings.soil)
        plots = file_records([file], file.parent)
        records = [*input_records(opened, progress), *(file_records([soil], soil.parent) if soil else []), *plots]
        origin = Origin("Crop height", inputs=[(record.name, record.sha256) for record in records], span_s=span_s)
        written = write_parcels(staging, points, settings, opened.crs, origin, progress)
        layer = parcel_layer(written.found)
        write_styled_layers(staging / PARCELS, [layer], opened.crs, origin)
        for notice in (notices := [*opened.notices, *notices, *written.notices]):
            warn(notice)
        content = {"parcels_file": joint_record(file, plots), "crs": name_of(opened.crs), **written.account}
        return write_account(staging, PARCELS_REPORT, opened, records, content, notices)


def collect_points(
    clouds: Clouds, parcels: Path, points: ParcelPoints, classes: frozenset[int] | None, progress: Progress
) -> tuple[list[Notice], tuple[float, float] | None]:
    """Collect the points of the parcels; notices about the clouds, and the first and last UTC."""
    notices: list[Notice] = []
    first_s = math.inf
    last_s = -math.inf
    total = max(clouds.points, 1)

    def seen(survey: Survey) -> None:
        notices.extend(survey.notices())

    for batch in clouds.batches(
        points.box_m, classes, seen, lambda done: progress("reading clouds", min(done / total, 1.0))
    ):
        points.add(batch.xyz_m)
        if batch.t_s is not None and len(batch.t_s):
            known = batch.t_s[batch.t_s == batch.t_s]
            if len(known):
                first_s = min(first_s, float(known.min()))
                last_s = max(last_s, float(known.max()))
    if not points.count:
        raise elsewhere_error(parcels, clouds.points, points.box_m)
    return notices, (first_s, last_s) if first_s <= last_s else None


@dataclass(frozen=True)
class WrittenParcels:
    """Parcels that were measured and written, how they respond to a dose, and a shift with which they fit better."""

    found: list[MeasuredParcel]
    response: Response | None
    account: dict[str, Any]
    notices: tuple[Notice, ...]
    shift: ParcelShift | None = None


def write_parcels(
    folder: Path, points: ParcelPoints, settings: ParcelSettings, crs: CRS, origin: Origin, progress: Progress
) -> WrittenParcels:
    """Measure the parcels and write their table and the raster of crop heights."""
    found: list[MeasuredParcel] = []
    place = points.parcels[0].net.centroid
    with soil_source(settings.soil, crs, points.box_m, folder.parent, progress) as source:
        soil = site_soil(points, source)
    with CropHeights(folder.parent) as heights:
        scale = scale_at(crs, place.x, place.y)
        published = settings.published
        rows = measure_parcels(points, soil.soil.under, soil.noise_m, settings.method, compare=published, scale=scale)
        for row, canopy in rows:
            heights.add(canopy)
            found.append(row)
            progress("measuring parcels", len(found) / len(points.parcels))
        if heights.write(folder / CROP_HEIGHT, crs, origin):
            write_raster_style(folder / CROP_HEIGHT, style_of(CROP_HEIGHT))
    day = local_day(origin.span_s[0], crs, (place.x, place.y)) if origin.span_s is not None else None
    treated, notices = assign_treatments([row.parcel for row in found], settings, day)
    found = [replace(row, parcel=parcel) for row, parcel in zip(found, treated, strict=True)]
    notices += _order_notices(found, settings)
    response = _response(found)
    if response is not None and (name := dose_name(treated)) is not None:
        notices += left_out_doses(treated, name)
    layer = parcel_layer(found)
    write_parcel_table(folder / PARCEL_TABLE, layer)
    write_parcel_sheet(folder / PARCEL_SHEET, layer)
    unknown = [row.parcel.id for row in found if math.isnan(row.figures.mean_height_m)]
    notices += [*points.notices, *soil.notices]
    bare = [
        row.parcel.id
        for row in found
        if settings.method == "canopy-top"
        and math.isfinite(row.figures.mean_height_m)
        and math.isnan(row.figures.height_sigma_m)
    ]
    if bare:
        notices.append(Notice("parcels-without-sigma", names=list_names(bare, "parcel"), total=len(found)))
    if unknown:
        shown = ", ".join(unknown[:5]) + (" and others" if len(unknown) > 5 else "")
        notices.append(Notice("parcels-unmeasured", names=len(unknown), total=len(found), shown=shown))
    account = {
        "parameters": {
            "method": settings.method,
            "soil": settings.soil if settings.soil in SOIL_METHODS else Path(settings.soil).name,
            "net_inset_m": list(settings.net_inset_m),
        },
        "soil": soil.plain(),
        "response": response
        and {
            "words": response.words,
            **{f"words_{one}": joined(response.sentences, ".", one) for one in LANGUAGES[1:]},
            "sentences": [str(sentence) for sentence in response.sentences],
            **{f"sentences_{one}": [each.in_language(one) for each in response.sentences] for one in LANGUAGES[1:]},
        },
        "parcels": [{name: values[k] for name, values in layer.columns.items()} for k in range(len(found))],
    }
    return WrittenParcels(found, response, account, tuple(notices))


def held_against_surface(
    written: WrittenParcels, folder: Path, frame: MapFrame, place_sigma_m: tuple[float, float]
) -> WrittenParcels:
    """The figures with larger standard deviations where the crop on the surface in a folder stands beside the parcels.

    Or may do so, by the standard deviations of the surface's place, east and north. The tables in the folder are
    written anew then.
    """
    parcels = [row.parcel for row in written.found]
    sigmas = np.array([row.figures.height_sigma_m for row in written.found])
    if not (folder / DSM).is_file():
        return written
    surface, grid = _surface_beside(folder, parcels)
    sigma_m = float(np.nanmedian(sigmas)) if np.isfinite(sigmas).any() else 0.0
    shift = parcel_shift(surface, grid, parcels, sigma_m)
    if shift is None:
        lon_lat_deg = frame.to_lon_lat(*shapely.get_coordinates(parcels[0].gross.centroid).T)
        convergence_deg = float(frame.convergence_deg(*lon_lat_deg)[0])
        shift = parcels_elsewhere(*_surface_far_around(folder, parcels), parcels, sigma_m, convergence_deg)
    doubted = max(place_sigma_m) > grid.cell_m and np.isfinite(surface).any()
    if shift is None and not doubted:
        return written
    off_m = heights_by_place(surface, grid, parcels, place_sigma_m) if doubted else np.zeros(len(parcels))
    notices = list(written.notices)
    if shift is not None:
        off_m = np.hypot(off_m, shift.height_off_m)
        shown = {"east_m": shift.east_m, "north_m": shift.north_m, "height_off_m": shift.height_off_m}
        if shift.of_positions:
            notices.append(Notice("parcels-beside-crop", **shown))
        else:
            east_west, north_south = shift.mirrored
            notices.append(
                Notice("parcels-beside-crop.elsewhere", **shown, is_east_west=east_west, is_north_south=north_south)
            )
    found = []
    for row, off in zip(written.found, off_m.tolist(), strict=True):
        sigma_m = math.hypot(row.figures.height_sigma_m, off)
        volume_m3 = math.hypot(row.figures.volume_sigma_m3, off * row.figures.area_m2)
        figures = replace(row.figures, height_sigma_m=sigma_m, volume_sigma_m3=volume_m3)
        found.append(replace(row, figures=figures))
    layer = parcel_layer(found)
    write_parcel_table(folder / PARCEL_TABLE, layer)
    write_parcel_sheet(folder / PARCEL_SHEET, layer)
    rows = [{name: values[k] for name, values in layer.columns.items()} for k in range(len(found))]
    account = written.account | {"parcels": rows}
    return replace(written, found=found, account=account, notices=tuple(notices), shift=shift)


def _order_notices(found: Sequence[MeasuredParcel], settings: ParcelSettings) -> list[Notice]:
    """The notice that treatments are likely those of other parcels."""
    parcels = [row.parcel for row in found]
    name = dose_name(parcels)
    if name is None or settings.treatments is None:
        return []
    heights_m = np.array([row.figures.mean_height_m for row in found])
    order = mistaken_order(parcel_doses(parcels, name).tolist(), heights_m, [parcel.block for parcel in parcels])
    if order is None:
        return []
    kind = {"is_reversed": order == REVERSED, "is_in_blocks": order == REVERSED_IN_BLOCKS}
    kind["is_shifted"] = not any(kind.values())
    return [Notice("treatments-order", treatments=Path(settings.treatments).name, **kind)]


def _surface_beside(folder: Path, parcels: Sequence[Parcel]) -> tuple[Float32Array, Grid]:
    """The surface in a folder around parcels, as far as they may be shifted."""
    west, south, east, north = shapely.total_bounds([parcel.gross for parcel in parcels]).tolist()
    reach_m = MAX_PARCEL_SHIFT_M
    cell_m = max(SHIFT_CELL_M, (max(east - west, north - south) + 2.0 * reach_m) / MAX_SHIFT_CELLS)
    return cells_of(folder / DSM, (west - reach_m, south - reach_m, east + reach_m, north + reach_m), cell_m)


def _surface_far_around(folder: Path, parcels: Sequence[Parcel]) -> tuple[Float32Array, Grid]:
    """Parcels, and the surface in a folder as far as others' parcels are looked for, in coarser cells."""
    west, south, east, north = shapely.total_bounds([parcel.gross for parcel in parcels]).tolist()
    seen = shapely.box(*extent_of(folder / DSM)).intersection(
        shapely.box(west - FAR_SHIFT_M, south - FAR_SHIFT_M, east + FAR_SHIFT_M, north + FAR_SHIFT_M)
    )
    box_m = shapely.total_bounds([seen, shapely.box(west, south, east, north)]).tolist()
    cell_m = max(SHIFT_CELL_M, max(box_m[2] - box_m[0], box_m[3] - box_m[1]) / MAX_FAR_CELLS)
    return cells_of(folder / DSM, tuple(box_m), cell_m)


def _response(found: Sequence[MeasuredParcel]) -> Response | None:
    parcels = [row.parcel for row in found]
    name = dose_name(parcels)
    if name is None:
        return None
    heights_m = np.array([row.figures.mean_height_m for row in found])
    blocks = [parcel.block or "" for parcel in parcels]
    return fit_response(parcel_doses(parcels, name), heights_m, blocks, ResponseQuestion(unit=dose_unit(name)))


def assign_treatments(
    parcels: Sequence[Parcel], settings: ParcelSettings, day: dt.date | None
) -> tuple[Sequence[Parcel], list[Notice]]:
    """The parcels with their treatments, and which have none; `day` is that of the points."""
    if settings.treatments is None:
        return parcels, []
    return with_treatments(parcels, read_treatments(Path(settings.treatments), day_of(settings.day) or day))


def expect_soil(path: Path | None, target: CRS, box_m: Box) -> None:
    """Open a soil survey before long work, and close it; the errors are those of :func:`soil_source`."""
    if path is None:
        return
    if is_cloud(path):
        open_clouds([path], target, horizontal_part(target), without_option=True)
        return
    with open_soil_raster(path, target, box_m):
        pass


@contextmanager
def soil_source(
    source: str | Path, target: CRS, box_m: Box, folder: Path, progress: Progress
) -> Iterator[SoilMethod | SoilRaster]:
    """The soil under parcels, as :func:`~furrowmap.core.crops.site_soil.site_soil` takes it.

    The source is "surface", "plane", or a GeoTIFF, a cloud or a result folder of another survey. The points of a cloud
    are gridded: those of its ground class if it has one, else all, by their median.
    """
    path = soil_file(source)
    if path is None:
        yield next(method for method in SOIL_METHODS if method == source)
    elif is_cloud(path):
        with tempfile.TemporaryDirectory(prefix="soil-", dir=folder) as made:
            survey = open_clouds([path], target, horizontal_part(target), without_option=True)
            raster = _grid_cloud(survey, Path(made), box_m, progress)
            with open_soil_raster(raster, target, box_m) as opened:
                yield replace(opened, path=path, notices=_soil_notices(survey))
    else:
        with open_soil_raster(path, target, box_m) as opened:
            yield opened


def _soil_notices(survey: Clouds) -> tuple[Notice, ...]:
    """Those of a cloud of soil, and that one without a CRS is taken to be in that of the parcels' cloud."""
    (file,) = survey.files
    if file.crs is not None:
        return survey.notices
    return (*survey.notices, Notice("crs-of-local.none", path=file.path.name, stated=full_name_of(survey.crs)))


def _grid_cloud(clouds: Clouds, folder: Path, box_m: Box, progress: Progress) -> Path:
    """The surface of a cloud in a box."""
    with PointSpool(SOIL_CELL_M, folder=folder) as points, PointSpool(SOIL_CELL_M, folder=folder) as ground:
        spooled = spool_clouds(clouds, points, ground, box_m, progress=progress)
        if points.grid is None:
            raise no_points_error(clouds, box_m)
        method: GroundMethod = "class" if spooled.classified else "none"
        settings = SurfaceSettings(cell_m=SOIL_CELL_M)
        records = input_records(clouds, progress)
        CloudRasters(folder, clouds, points.grid, settings, box_m, method, records, spooled.span_s).write_surfaces(
            spooled, progress
        )
    return folder / (DTM if method == "class" else DSM)
