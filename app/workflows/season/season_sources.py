"""The sessions of a season: results of runs below some folders, with the surfaces that ties of dates have moved."""

import datetime as dt
import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from pyproj import CRS

from furrowmap.core.geodesy.crs_change import crs_change
from furrowmap.core.geodesy.measurable_crs import expect_map
from furrowmap.core.readers.ogr_layers import layer_info
from furrowmap.core.runtime.errors import InputError, Notice, RefusedError
from furrowmap.core.runtime.file_names import inside, read_own, resolved
from furrowmap.core.values.crs import crs_of_file, name_of
from furrowmap.exporters.exchange.stac import session_identifier
from furrowmap.exporters.farm.farm_results import local_date, zone_of
from furrowmap.exporters.farm.surface_file import horizontal, same_map
from furrowmap.exporters.files.result_folder import (
    CHANGE,
    CLOUD,
    DSM,
    FIELD,
    REPORT,
    TIE_REPORT,
    TRAJECTORY,
    ResultFolder,
    open_result,
    reading_result,
)

PASSES: Final = "passes"
Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class SeasonSession:
    """A result of a run, as a season takes it.

    Attributes:
        name: its identifier, also in names of files.
        digest: SHA-256 of `report.json`.
        date: the day at the place where it began.
        crs: of all its coordinates, without heights.
        surfaces: the file of each surface that it has, by product.
        passes: bounds of the worked ground in its CRS; None where none is known.
    """

    name: str
    folder: Path
    report: Mapping[str, Any]
    digest: str
    date: dt.date
    span: tuple[dt.datetime, dt.datetime]
    crs: CRS
    heights: str
    surfaces: Mapping[str, Path]
    passes: Box | None
    cloud: Path | None


def find_sessions(sources: Sequence[Path], out: Path) -> tuple[list[SeasonSession], list[Notice]]:
    """The results of runs in folders and below them, except in `out`, in the order of their times.

    Surfaces that a `furrowmap tie` in them has moved replace those of their results.
    """
    folders: dict[Path, None] = {}
    ties: dict[Path, None] = {}
    for source in sources:
        found = list(_folders(source, resolved(out)))
        results = [folder for folder, names in found if REPORT in names]
        ties |= {folder: None for folder, names in found if TIE_REPORT in names}
        if not found or not (results or TIE_REPORT in found[0][1]):
            raise _nothing(source)
        folders |= dict.fromkeys(results)
    if not folders:
        raise _nothing(sources[0])
    moved = {place: path for tie in ties for place, path in _moved_surfaces(tie)}
    sessions = [_session(open_result(folder), moved.get(folder)) for folder in folders]
    places: dict[str, Path] = {}
    for session in sessions:
        other = places.setdefault(session.name.casefold(), session.folder)
        if other != session.folder:
            raise InputError("session-twice", folders=(other, session.folder), session=session.name)
    sessions.sort(key=lambda session: (session.span[1], session.name))
    heights = sorted({session.heights for session in sessions})
    if len(heights) > 1:
        raise RefusedError("results-heights-mixed", kinds=", ".join(heights))
    notices = []
    if ties:
        used = sum(session.folder in moved for session in sessions)
        notices.append(Notice("season-ties", used=used, sessions=len(sessions)))
    return sessions, notices


def season_crs(sessions: Sequence[SeasonSession], wanted: CRS | None) -> tuple[CRS, list[Notice]]:
    """The CRS of a season, without heights, and notices on the changes to it."""
    crs = horizontal(wanted) if wanted is not None else sessions[-1].crs
    places = [(session.crs, _bounds(session)) for session in sessions]
    notices = dict.fromkeys(expect_map(crs, places) if wanted is not None else [])
    for session in sessions:
        if same_map(session.crs, crs):
            continue
        if wanted is None:
            raise RefusedError(
                "results-crs-mixed",
                folder=sessions[-1].folder,
                crs=name_of(crs),
                other_folder=session.folder,
                other_crs=name_of(session.crs),
            )
        change = crs_change(session.crs, crs, _bounds(session))
        notices |= dict.fromkeys(change.notices)
    return crs, list(notices)


def _bounds(session: SeasonSession) -> tuple[float, float, float, float]:
    """West, south, east, north of a result in its CRS."""
    (west, south, _), (east, north, _) = session.report["figures"]["bounds_m"]
    return west, south, east, north


def _folders(source: Path, out: Path) -> Iterator[tuple[Path, list[str]]]:
    """The folders below one that is named, with their files; hidden ones and those below a result are left out."""
    for place, inner, names in os.walk(resolved(source)):
        inner[:] = sorted(name for name in inner if not name.startswith(".") and Path(place, name) != out)
        if REPORT in names or TIE_REPORT in names:
            inner.clear()
        yield Path(place), names


def _moved_surfaces(tie: Path) -> Iterator[tuple[Path, Path]]:
    """The result that each surface of a tie belongs to, and the surface."""
    with reading_result(tie / TIE_REPORT):
        dates = json.loads(read_own(tie, TIE_REPORT))["dates"]
        for row in dates:
            if row["surface"]:
                yield resolved(Path(row["folder"])), inside(tie, row["surface"], tie / TIE_REPORT)


def _session(result: ResultFolder, moved: Path | None) -> SeasonSession:
    path = result.folder / FIELD
    with reading_result(path):
        crs = horizontal(crs_of_file(layer_info(path, TRAJECTORY)["crs"]))
        figures = result.report["figures"]
        start, end = (dt.datetime.fromisoformat(figures[key]) for key in ("start", "end"))
        low, high = np.array(figures["bounds_m"], np.float64)
        zone = zone_of(result.report, shapely.Point(0.5 * (low + high)), crs)
        passes = None
        if PASSES in result.layer_names:
            found = layer_info(path, PASSES, bounds=True)["total_bounds"]
            if found is not None and np.isfinite(found).all():  # None of a layer without rows
                passes = (float(found[0]), float(found[1]), float(found[2]), float(found[3]))
    surfaces = {Path(name).stem: result.folder / name for name in (DSM, CHANGE) if (result.folder / name).is_file()}
    if moved is not None:
        surfaces[Path(DSM).stem] = moved
    cloud = result.folder / CLOUD
    return SeasonSession(
        name=session_identifier(result.report),
        folder=result.folder,
        report=result.report,
        digest=hashlib.sha256((result.folder / REPORT).read_bytes()).hexdigest(),
        date=local_date(np.datetime64(start.astimezone(dt.UTC).replace(tzinfo=None), "ms"), zone),
        span=(start, end),
        crs=crs,
        heights=str(result.report["session"]["crs"]["heights"]),
        surfaces=surfaces,
        passes=passes,
        cloud=cloud if cloud.is_file() else None,
    )


def _nothing(source: Path) -> InputError:
    return InputError("season-nothing", source=source, exists=source.is_dir())
