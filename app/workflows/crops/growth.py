"""Growth of the crop on parcels between flights of several days."""

import datetime as dt
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from furrowmap.core.crops.growth_between import GrownParcel, align_flights, measure_growth
from furrowmap.core.crops.parcel_areas import read_parcels
from furrowmap.core.crops.parcel_points import ParcelPoints
from furrowmap.core.crops.trial_tables import day_of
from furrowmap.core.geodesy.local_time import local_day
from furrowmap.core.pointclouds.joined_clouds import Clouds
from furrowmap.core.runtime.errors import InputError, Notice, UsageError
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.values.crs import name_of
from furrowmap.core.values.parcel import Parcel
from furrowmap.exporters.files.file_records import file_records, joint_record
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.result_folder import (
    GROWTH,
    GROWTH_PRODUCTS,
    GROWTH_REPORT,
    GROWTH_TABLE,
    GROWTH_WORKBOOK,
)
from furrowmap.exporters.files.staging import recover, refuse_products, staged_folder
from furrowmap.exporters.files.workbooks import write_workbook
from furrowmap.exporters.vectors.crop_layers import growth_layer, write_parcel_table
from furrowmap.exporters.vectors.geopackage import write_styled_layers
from furrowmap.settings import GrowthSettings
from furrowmap.workflows.clouds.inputs import input_records, open_inputs, write_account
from furrowmap.workflows.clouds.surface import no_warning
from furrowmap.workflows.crops.parcels import collect_points


def growth(
    clouds: Sequence[str | Path],
    parcels: str | Path,
    out: str | Path,
    settings: GrowthSettings = GrowthSettings(),
    *,
    overwrite: bool = False,
    progress: Progress = silent,
    warn: Callable[[Notice], None] = no_warning,
) -> dict[str, Any]:
    """Measure what the crop on each parcel grew between flights, which bare soil aligns in height.

    Args:
        clouds: LAS, LAZ or COPC files of two days or more.
        parcels: vector file, or CSV of corners, with the gross parcels.
        out: folder for the products, made if it does not exist; all of them are written or none.
        warn: is called once with each warning, as early as it is known.

    Returns:
        The content of `growth.json`: inputs, CRS, days, the alignment of each, a row per parcel, warnings, products.

    Raises:
        InputError: if a file cannot be read, the parcels are elsewhere, no point of a day lies in one, or two days have
            too little bare soil in common.
        UsageError: if there are fewer than two days, or not one for each cloud.
        RefusedError: if the folder holds such products.
    """
    folder = Path(out)
    file = Path(parcels)
    recover(folder)
    refuse_products(folder, GROWTH_PRODUCTS, overwrite=overwrite)
    opened = open_inputs(clouds, settings)
    net = Path(settings.net) if settings.net else None
    areas, decided = read_parcels(file, opened.crs, settings.net_inset_m, net)
    opened = replace(opened, notices=(*opened.notices, *decided))
    by_day = _clouds_by_day(opened, areas, settings.days)
    notices = list(opened.notices)
    with staged_folder(folder) as staging, ExitStack() as stack:
        flights = [stack.enter_context(ParcelPoints(areas, staging.parent)) for _ in by_day]
        for points, part in zip(flights, by_day.values(), strict=True):
            notices += collect_points(part, file, points, settings.classes, progress)[0]
        days = list(by_day)
        cells, changes = align_flights(days, flights)
        grown = measure_growth(days, flights, cells, changes, progress)
        plots = file_records([file], file.parent)
        records = [*input_records(opened, progress), *plots]
        origin = Origin("Crop growth", inputs=[(record.name, record.sha256) for record in records])
        layer = growth_layer(grown, days)
        write_styled_layers(staging / GROWTH, [layer], opened.crs, origin)
        write_parcel_table(staging / GROWTH_TABLE, layer)
        write_workbook(staging / GROWTH_WORKBOOK, {"growth": layer.rows()})
        for notice in (notices := [*notices, *_unmeasured_notices(grown)]):
            warn(notice)
        alignments = [None, *(change.plain() for change in changes)]
        content = {
            "parcels_file": joint_record(file, plots),
            "crs": name_of(opened.crs),
            "parameters": {"net_inset_m": list(settings.net_inset_m)},
            "flights": [
                {"day": str(day), "clouds": [each.path.name for each in part.files], "alignment": alignment}
                for (day, part), alignment in zip(by_day.items(), alignments, strict=True)
            ],
            "parcels": layer.rows(),
        }
        return write_account(staging, GROWTH_REPORT, opened, records, content, notices)


def _clouds_by_day(clouds: Clouds, parcels: Sequence[Parcel], stated: Sequence[str] | None) -> dict[dt.date, Clouds]:
    """The clouds of each day, days increasing."""
    if stated is not None and len(stated) != len(clouds.files):
        raise UsageError("usage.by-day", stated=len(stated), files=len(clouds.files))
    parts = [replace(clouds, files=(file,), notices=()) for file in clouds.files]
    texts = stated if stated is not None else [None] * len(parts)
    days = [day_of(text) or _day_of_points(part, parcels) for text, part in zip(texts, parts, strict=True)]
    if len(set(days)) < 2:
        raise UsageError("usage.one-day", days=days[0])
    return {
        day: replace(clouds, files=tuple(file for file, own in zip(clouds.files, days, strict=True) if own == day))
        for day in sorted(set(days))
    }


def _day_of_points(part: Clouds, parcels: Sequence[Parcel]) -> dt.date:
    """The day of the first points of a cloud that have a time, as clocks show it where the parcels are."""
    place = parcels[0].net.centroid
    for batch in part.batches():
        known = batch.t_s[np.isfinite(batch.t_s)] if batch.t_s is not None else np.zeros(0)
        if len(known) and not part.week_times:
            day = local_day(float(known[0]), part.crs, (place.x, place.y))
            if day is not None:
                return day
        if batch.t_s is None:
            break
    raise InputError("cloud-day", files=part.files[0].path)


def _unmeasured_notices(grown: Sequence[GrownParcel]) -> list[Notice]:
    """A warning about parcels without growth."""
    names = [row.parcel.id for row in grown if row.growth is None]
    if not names:
        return []
    shown = ", ".join(names[:5]) + (" and others" if len(names) > 5 else "")
    return [Notice("growth-unmeasured", names=len(names), parcels=len(grown), shown=shown)]
