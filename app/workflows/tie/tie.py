"""Dates of one field tied to each other, and the change between them."""

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import version
from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from pyproj import CRS
from shapely.geometry.base import BaseGeometry

from furrowmap.core.accuracy.point_check import surface_at_points
from furrowmap.core.coregistration.pair_tie import PLACE_TERMS, PairTie, tie_pair, tie_points
from furrowmap.core.coregistration.tie_network import MOVE_SIZE, Network, adjust_network, interpolate_left_error
from furrowmap.core.coregistration.upright import Upright, find_uprights, join_uprights, tie_uprights
from furrowmap.core.coverage.field_surfaces import BESIDE_M
from furrowmap.core.readers.chosen_survey import SurveyOptions, may_hold_points
from furrowmap.core.readers.las.cloud import CloudFile, open_cloud
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice, RefusedError, UsageError
from furrowmap.core.runtime.json_text import json_text, plain
from furrowmap.core.runtime.languages.texts import Words
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.surfaces.moved_surface import move_places
from furrowmap.core.values.crs import name_of
from furrowmap.core.values.scan import PointClass
from furrowmap.exporters.farm.surface_file import OpenSurface, height_surface, heights_of, open_surface, same_map
from furrowmap.exporters.files.file_records import rooted_records
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.result_folder import CLOUD, TIE, TIE_PAGE, TIE_REPORT, open_result, refuse_occupied
from furrowmap.exporters.files.staging import staged_folder
from furrowmap.exporters.rasters.tied_surfaces import (
    ChangeFigures,
    DatedSurface,
    Mover,
    dated_surface,
    ground_pairs,
    resample_surface,
    tie_layers,
    union_shapes,
    write_change,
    write_moved,
)
from furrowmap.exporters.reports.html_pages import write_html
from furrowmap.exporters.reports.season_pages import tie_page
from furrowmap.exporters.vectors.geopackage import write_layer
from furrowmap.settings import TieSettings
from furrowmap.workflows.clouds.surface import no_warning

MAX_DATES_APART: Final = 4
"""Dates between which ties are looked for: each with so many of those after it."""
CONTRADICTION_TENSION: Final = 3.0
"""Tension of a tie from which on it contradicts the others."""
MAX_SHADOW_SHARE: Final = 0.2
"""Share of the worked ground that may lie in shadows of relief on the first date without a warning."""
UNSEEN_SHARE: Final = 0.7
"""Share of the receivers' standard deviation from which on a place counts as not seen."""
CELL_SIGMA_M: Final = 0.01
"""Of a surface at a point: the roughness of the ground below the surveyor's rod."""
_SURE: Final = 1e-4
_MOVE_FIELDS: Final = ("east_m", "north_m", "height_m", "tilt_east_deg", "tilt_north_deg", "turn_deg")
_MOVE_UNITS: Final = np.array([1.0, 1.0, 1.0, *3 * (math.degrees(1.0),)])
UPRIGHT_TILE_M: Final = 30.0
UPRIGHT_MARGIN_M: Final = 1.0
MAX_UPRIGHT_TILES: Final = 64
UPRIGHT_SPACING_M: Final = 0.03
"""Point spacing that is sufficient."""
_NOT_STANDING: Final = (PointClass.NOISE, PointClass.VEHICLE, PointClass.IMPLEMENT)


@dataclass(frozen=True)
class _Work:
    """The dates that are tied, and what ties them."""

    dates: list[DatedSurface]
    surfaces: list[tuple[OpenSurface, OpenSurface]]
    """As left, and before the work."""
    middle_m: FloatArray
    crs: CRS
    reference: "Reference | None" = None
    upright: list[Upright] = field(default_factory=list)
    """What stands, by date."""
    ties: dict[tuple[int, int], PairTie] = field(default_factory=dict)

    @property
    def first(self) -> int:
        """Number of the first date in the network: the reference comes before."""
        return 0 if self.reference is None else 1


def tie(
    results: Sequence[str | Path],
    out: str | Path,
    settings: TieSettings = TieSettings(),
    *,
    overwrite: bool = False,
    progress: Progress = silent,
    warn: Callable[[Notice], None] = no_warning,
) -> dict[str, Any]:
    """Tie the results of one field to each other by the ground that no tool touched between them.

    Each date is moved in place, height, tilt and heading such that untouched ground agrees; all ties are adjusted
    together, with the receivers' own standard deviations as loose knowledge before.

    Args:
        results: folders of `furrowmap run`, of one field, in any order.
        out: folder for the products, made if it does not exist; all of them are written or none.
        warn: is called once with each warning, as early as it is known.

    Returns:
        The content of `tie.json`: dates with their moves, ties, changes between dates, warnings, products.

    Raises:
        InputError: if a result cannot be read, or no two dates have untouched ground in common.
        UsageError: if there are fewer than two results, or one without a reference.
        RefusedError: if the surfaces have several CRSs, cell sizes or height systems, or the folder holds such
            products.
    """
    folder = Path(out)
    if len(results) < (2 if settings.reference is None else 1):
        raise UsageError("usage.one-result", results=len(results))
    refuse_occupied(folder, (TIE, TIE_REPORT, TIE_PAGE), "surfaces", overwrite=overwrite)
    dates = sorted((dated_surface(open_result(Path(each))) for each in results), key=lambda date: date.start)
    _expect_alike(dates)
    with staged_folder(folder) as staging, ExitStack() as stack:
        work = _open_work(dates, settings, stack)
        _find_ties(work, progress)
        if not work.ties:
            raise InputError("tie-nothing-common", dates=len(dates))
        prior = np.array([*([work.reference.sigma] if work.reference else []), *[date.sigma for date in dates]])
        net = adjust_network(work.ties, prior)
        notices = _notices(work, net, prior)
        for notice in notices:
            warn(notice)
        return _write(staging, work, net, settings, notices, progress, warn)


def _expect_alike(dates: Sequence[DatedSurface]) -> None:
    """Raises RefusedError if the surfaces cannot be compared cell by cell."""
    first = dates[0]
    for date in dates:
        for surface in (date.after, date.before):
            same = same_map(surface.crs, first.after.crs) and heights_of(surface.crs) == heights_of(first.after.crs)
            if not same or surface.grid is None or surface.cell_m != first.after.cell_m:
                raise RefusedError("tie-crs", surface=surface.path, after=first.after.path)


def _open_work(dates: list[DatedSurface], settings: TieSettings, stack: ExitStack) -> _Work:
    surfaces = []
    for date in dates:
        after = stack.enter_context(open_surface(date.after))
        surfaces.append((after, after if date.before is date.after else stack.enter_context(open_surface(date.before))))
    bounds = np.array([date.after.bounds_m for date in dates])
    west, south = bounds[:, :2].min(axis=0).tolist()
    east, north = bounds[:, 2:].max(axis=0).tolist()
    middle_m = np.array([0.5 * (west + east), 0.5 * (south + north)])
    if settings.reference is None:
        return _Work(dates, surfaces, middle_m, dates[0].after.crs)
    around = (west, south, east, north)
    sigma_m = settings.reference_sigma_m
    reference = open_reference(Path(settings.reference), dates, around, sigma_m, stack)
    return _Work(dates, surfaces, middle_m, dates[0].after.crs, reference)


def _find_ties(work: _Work, progress: Progress) -> None:
    """Every tie that the ground allows."""
    dates = work.dates
    first = work.first
    for k, date in enumerate(dates):
        progress("finding walls and posts", k / len(dates))
        work.upright.append(find_standing(date.folder / CLOUD, date.after.bounds_m))
    pairs = [(i, j) for i in range(len(dates)) for j in range(i + 1, min(i + 1 + MAX_DATES_APART, len(dates)))]
    for number, (i, j) in enumerate(pairs):
        progress("tying dates", number / max(len(pairs), 1))
        touched = union_shapes([date.touched for date in dates[i:j]])
        pieces = list(ground_pairs(work.surfaces[i][1], work.surfaces[j][1], touched))
        sigma = np.hypot(dates[i].sigma, dates[j].sigma)[PLACE_TERMS]
        standing = tie_uprights(
            off_touched_ground(touched, work.upright[i]),
            off_touched_ground(touched, work.upright[j]),
            work.middle_m,
            sigma,
        )
        found = tie_pair(pieces, work.middle_m, sigma, standing)
        if found is not None:
            work.ties[first + i, first + j] = found
    if work.reference is not None:
        touched = union_shapes([date.touched for date in dates])
        for j, (_, before) in enumerate(work.surfaces):
            found = reference_tie(work.reference, before, dates[j], touched, work.middle_m)
            if found is not None:
                work.ties[0, 1 + j] = found
    progress("tying dates", 1.0)


def _notices(work: _Work, net: Network, prior: FloatArray) -> list[Notice]:
    """What the surfaces' heights are, what could not be tied, and what contradicts itself."""
    dates = work.dates
    first = work.first
    told = [] if work.reference is None else [work.reference.notices]
    told += [surface.scale.notices for date in dates for surface in (date.after, date.before)]
    found = list(dict.fromkeys(notice for some in told for notice in some))
    alone = [date.name for k, date in enumerate(dates) if (net.group == net.group[first + k]).sum() == 1]
    if alone:
        found.append(Notice("tie-none", alone=len(alone), dates=len(dates), alone_list=", ".join(alone)))
    if len(set(net.group.tolist())) > 1 + len(alone):
        found.append(Notice("tie-groups"))
    unknown = [date.name for date in dates if not date.work_known]
    if unknown:
        found.append(Notice("tie-work-unknown", unknown=", ".join(unknown)))
    for (one, other), tension in net.tension.items():
        if tension > CONTRADICTION_TENSION:
            names = (_name(work, one), _name(work, other))
            found.append(Notice("tie-contradiction", names=names[0], names_other=names[1], tension=tension))
    for (one, other), tied in work.ties.items():
        if tied.upright is not None and len(tied.upright.moved_m):
            moved = tied.upright.moved_m
            count = len(tied.upright.used_m) + len(tied.upright.moved_m)
            east, north = np.median(moved, axis=0).tolist()
            found.append(
                Notice(
                    "tie-moved",
                    moved=len(moved),
                    count=count,
                    work=_name(work, other),
                    other_work=_name(work, one),
                    easting_m=east,
                    northing_m=north,
                )
            )
    unseen = [
        f"{_name(work, one)} and {_name(work, other)}"
        for one, other in work.ties
        if np.sqrt(np.diag(net.between(one, other)[1])[:2]).max()
        > UNSEEN_SHARE * np.hypot(prior[one], prior[other])[:2].max()
    ]
    if unseen:
        found.append(Notice("tie-place", unseen="; ".join(unseen)))
    return found


def _name(work: _Work, node: int) -> str:
    return "the reference" if node < work.first else work.dates[node - work.first].name


def _write(
    staging: Path,
    work: _Work,
    net: Network,
    settings: TieSettings,
    notices: Sequence[Notice],
    progress: Progress,
    warn: Callable[[Notice], None],
) -> dict[str, Any]:
    """Write all products, and warn of changes that are seen badly; the account, with `notices` and these warnings."""
    inputs = [
        (path, date.after.path.parent.parent)
        for date in work.dates
        for path in sorted({date.after.path, date.before.path})
    ]
    records = rooted_records(inputs, progress)
    origin = Origin("Ties of dates", inputs=[(record.name, record.sha256) for record in records])
    tied = [bool((net.group == net.group[work.first + k]).sum() > 1) for k in range(len(work.dates))]
    dates = date_rows(work.dates, net, work.first, tied)
    ties = tie_rows(work.ties, net, work.first)
    movers = [Mover(after, net.moves[work.first + k], work.middle_m) for k, (after, _) in enumerate(work.surfaces)]
    for k, (date, mover) in enumerate(zip(work.dates, movers, strict=True)):
        progress("writing surfaces", k / len(movers))
        if tied[k] and mover.surface.grid is not None:
            own = Origin("Surface moved by its tie", date.name, origin.inputs)
            write_moved(staging / dates[k]["surface"], mover, mover.surface.grid, work.crs, own)
    changes = _write_changes(staging, work, net, movers, origin)
    badly_seen = []
    for row in changes:
        if (row["shadow_share"] or 0.0) > MAX_SHADOW_SHARE:
            names = {"name": work.dates[row["date_a"] - 1].name, "name_other": work.dates[row["date_b"] - 1].name}
            figures = {key: row[key] for key in ("shadow_share", "mean_change_m", "mean_change_sigma_m")}
            badly_seen.append(Notice("tie-shadows", **names, **figures))
            warn(badly_seen[-1])
    outlines = [shapely.box(*date.after.bounds_m) for date in work.dates]
    for layer in tie_layers(outlines, dates, work.ties, ties):
        write_layer(staging / TIE, layer, work.crs, indexed=False, origin=origin)
    content: Mapping[str, Any] = {
        "furrowmap": version("furrowmap"),
        "inputs": records,
        "crs": name_of(work.crs),
        "reference": str(Path(settings.reference).name) if settings.reference is not None else None,
        "reference_sigma_m": settings.reference_sigma_m if settings.reference is not None else None,
        "middle_m": work.middle_m.tolist(),
        "dates": dates,
        "ties": ties,
        "changes": changes,
        "warnings": [*notices, *badly_seen],
        "products": sorted([*(path.name for path in staging.iterdir()), TIE_REPORT, TIE_PAGE]),
    }
    account = dict(plain(content))
    write_html(staging / TIE_PAGE, tie_page(account))
    (staging / TIE_REPORT).write_text(json_text(account), encoding="utf-8")
    return account


def _write_changes(
    staging: Path, work: _Work, net: Network, movers: Sequence[Mover], origin: Origin
) -> list[dict[str, Any]]:
    """Write the change from each date to the next one that it is tied to; the figures."""
    rows = []
    # Worked ground is moved in place with its surface: two centimetres are a percent of a lane.
    worked_by: list[BaseGeometry] = [
        shapely.transform(date.worked, partial(move_places, move=mover.move, middle_m=mover.middle_m))
        for date, mover in zip(work.dates, movers, strict=True)
    ]
    for k in range(len(work.dates)):
        a = work.first + k
        later = [j for j in range(k + 1, len(work.dates)) if net.group[work.first + j] == net.group[a]]
        if not later:
            continue
        j = later[0]
        b = work.first + later[0]
        one = work.dates[k]
        other = work.dates[j]
        name = f"change_{k + 1:02d}_{j + 1:02d}.tif"
        found = write_change(
            staging / name,
            (movers[k], movers[j]),
            work.crs,
            Origin(f"Change from {one.name} to {other.name}", inputs=origin.inputs),
            worked=union_shapes(worked_by[k + 1 : j + 1]),
            before=union_shapes(worked_by[: k + 1]),
            touched=union_shapes([shape.buffer(BESIDE_M) for shape in worked_by[k : j + 1]]),
        )
        if found is None:
            continue
        move, covariance = net.between(a, b)
        left = (0.0, float("nan"))
        if len(found.places_m):
            left = interpolate_left_error(found.places_m, work.middle_m, move, covariance, work.ties.get((a, b)))
        rows.append({"date_a": k + 1, "date_b": j + 1, "raster": name, **moved_figures(found, left)})
    return rows


def date_rows(dates: Sequence[DatedSurface], net: Network, first: int, tied: Sequence[bool]) -> list[dict[str, Any]]:
    """Each date with what moves it."""
    rows = []
    for k, date in enumerate(dates):
        own = slice(MOVE_SIZE * (first + k), MOVE_SIZE * (first + k + 1))
        sigma = np.sqrt(np.diag(net.covariance[own, own]))
        rows.append(
            {
                "date": k + 1,
                "name": date.name,
                "start": date.start.isoformat(),
                "start_local": date.start.astimezone(date.zone).isoformat(),
                "time_zone": date.zone.key,
                "folder": str(date.folder),
                "tied": tied[k],
                "group": int(net.group[first + k]),
                "surface": f"dsm_{k + 1:02d}.tif" if tied[k] else "",
                **_values(net.moves[first + k], sigma, known=tied[k]),
            }
        )
    return rows


def tie_rows(ties: Mapping[tuple[int, int], PairTie], net: Network, first: int) -> list[dict[str, Any]]:
    """Each tie: what moves the second date onto the first after the adjustment; date 0 is the reference."""
    rows = []
    for (one, other), tie in ties.items():
        move, covariance = net.between(one, other)
        rows.append(
            {
                "date_a": one + 1 - first,
                "date_b": other + 1 - first,
                **_values(move, np.sqrt(np.maximum(np.diag(covariance), 0.0)), known=True),
                "cells": tie.cells,
                "patches": tie.patches,
                "upright": 0 if tie.upright is None else len(tie.upright.used_m),
                "departures_m": round(tie.departure.relief_m, 5),
                "range_m": round(tie.departure.range_m, 2),
                "scatter_m": round(tie.scatter_m, 5),
                "tension": round(net.tension[one, other], 2),
            }
        )
    return rows


def moved_figures(found: ChangeFigures, left: tuple[float, float]) -> dict[str, Any]:
    """Soil moved between two dates: the mean change of what both saw, for all ground worked."""
    off_m, sigma_m = left
    moved = found.moved
    mean = moved.mean_m - off_m
    sigma = math.hypot(sigma_m, moved.sigma_m)
    still = found.untouched_m
    median = float(np.median(still)) if len(still) else math.nan
    spread = 1.4826 * float(np.median(np.abs(still - median))) if len(still) else math.nan
    figures = {
        "worked_m2": moved.area_m2,
        "compared_m2": moved.compared_m2,
        "shadow_share": moved.shadow_share,
        "mean_change_m": mean,
        "mean_change_sigma_m": sigma,
        "volume_m3": mean * moved.area_m2,
        "volume_sigma_m3": sigma * moved.area_m2,
        "bend_m": off_m,
        "untouched_median_m": median,
        "untouched_spread_m": spread,
    }
    return {name: round(value, 5) if math.isfinite(value) else None for name, value in figures.items()}


def _values(move: FloatArray, sigma: FloatArray, *, known: bool) -> dict[str, float | None]:
    values: dict[str, float | None] = {}
    for name, value, one_sigma in zip(_MOVE_FIELDS, move * _MOVE_UNITS, sigma * _MOVE_UNITS, strict=True):
        values[name] = round(float(value), 5) if known else None
        values[f"{name}_sigma"] = round(float(one_sigma), 5) if known else None
    return values


def find_standing(cloud: Path, bounds_m: tuple[float, float, float, float]) -> Upright:
    """Walls and posts of a result, tile by tile, of some tiles where there are many; none without a cloud."""
    if not cloud.is_file():
        return join_uprights([])
    file = open_cloud(cloud)
    west, south, east, north = bounds_m
    corners = (np.arange(low, high, UPRIGHT_TILE_M).tolist() for low, high in ((west, east), (south, north)))
    tiles = list(product(*corners))
    some = tiles[:: max(1, -(-len(tiles) // MAX_UPRIGHT_TILES))]
    return join_uprights([_uprights_of_tile(file, *corner) for corner in some])


def _uprights_of_tile(file: CloudFile, west: float, south: float) -> Upright:
    reach_m = UPRIGHT_TILE_M + UPRIGHT_MARGIN_M
    box = (west - UPRIGHT_MARGIN_M, south - UPRIGHT_MARGIN_M, west + reach_m, south + reach_m)
    xyz = [np.zeros((0, 3))]
    ground = [np.zeros(0, bool)]
    for batch in file.batches(box, UPRIGHT_SPACING_M):
        kept = ~np.isin(batch.classification, _NOT_STANDING) & ~batch.withheld
        xyz.append(batch.xyz_m[kept])
        ground.append(batch.classification[kept] == PointClass.GROUND)
    found = find_uprights(np.concatenate(xyz), np.concatenate(ground))
    within = (found.xy_m >= (west, south)) & (found.xy_m < (west + UPRIGHT_TILE_M, south + UPRIGHT_TILE_M))
    return found.at(np.flatnonzero(within.all(axis=1)))


def off_touched_ground(touched: BaseGeometry, things: Upright) -> Upright:
    """Those that do not stand on ground that a tool touched."""
    return things.at(np.flatnonzero(~shapely.contains_xy(touched, things.xy_m[:, 0], things.xy_m[:, 1])))


@dataclass(frozen=True)
class Reference:
    """What dates are moved onto: a surface on their cells, or points.

    `sigma`: (6,) standard deviations of its own place, height, tilts and turn; `sigma_m`: of a point that states none;
    `notices`: about the heights of a surface.
    """

    path: Path
    surface: OpenSurface | None
    sigma: FloatArray
    sigma_m: float | None
    notices: tuple[Notice, ...] = ()


def open_reference(
    path: Path,
    dates: Sequence[DatedSurface],
    bounds_m: tuple[float, float, float, float],
    sigma_m: float,
    stack: ExitStack,
) -> Reference:
    """Open points with heights (:mod:`.surveyed_points`) or a GeoTIFF; its heights have the standard deviation."""
    if may_hold_points(path):
        # the points themselves carry the survey's errors
        return Reference(path, None, np.full(6, _SURE), sigma_m or None)
    file = height_surface(path, _no_reference)
    first = dates[0].after
    heights = {heights_of(surface.crs) for surface in (file, first)}
    if not same_map(file.crs, first.crs) or len(heights - {""}) > 1:
        raise RefusedError("tie-crs.of-reference", path=path, first=first.path)
    grid = Grid.of_bounds(first.cell_m, bounds_m)
    surface = stack.enter_context(resample_surface(file, grid))
    sigma = np.full(6, _SURE)
    sigma[2] = max(sigma_m, _SURE)
    return Reference(path, surface, sigma, None, file.scale.notices)


def _no_reference(path: Path, why: Words) -> InputError:
    return InputError("surface-unusable.of-reference", path=path, why=why)


def reference_tie(
    reference: Reference, before: OpenSurface, date: DatedSurface, touched: BaseGeometry, middle_m: FloatArray
) -> PairTie | None:
    """Tie a date to the reference by ground that no tool touched on any date."""
    if reference.surface is not None:
        pieces = list(ground_pairs(reference.surface, before, touched))
        return tie_pair(pieces, middle_m, date.sigma[PLACE_TERMS])
    options = SurveyOptions(sigma_m=reference.sigma_m)
    found = surface_at_points(date.before.path, reference.path, options)
    xyz = np.array([point.surveyed_m for point in found.points])
    above = np.array([point.error_m[2] for point in found.points])
    stated = found.survey.sigma_m[:, 2]
    sigma = np.hypot(np.where(np.isfinite(stated), stated, reference.sigma_m or 0.0), CELL_SIGMA_M)
    used = np.isfinite(above) & ~shapely.contains_xy(touched, xyz[:, 0], xyz[:, 1])
    return tie_points(xyz[used, :2], above[used], sigma[used], middle_m)
