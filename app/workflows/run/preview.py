"""The products of a preview: the track, and a coarse surface."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import msgspec

from furrowmap.core.coverage.field_boundary import ground_to_map
from furrowmap.core.coverage.field_surfaces import FieldPoints
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.images.image_frames import Frames
from furrowmap.core.pipeline import preview_story as preview_story
from furrowmap.core.pipeline.causes import by_cause, cause_of
from furrowmap.core.pipeline.run_result import RunResult
from furrowmap.core.pointclouds.placed_scans import PlacedScan
from furrowmap.core.runtime.file_names import resolved
from furrowmap.core.runtime.json_text import json_text
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.runtime.settings import using_threads
from furrowmap.core.session.opened import open_session
from furrowmap.core.surfaces.passage import Passages
from furrowmap.core.surfaces.statistic import Statistic
from furrowmap.core.trajectory.vehicle_motion import distance_and_standing
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.trajectory import ScanPoses
from furrowmap.exporters.files.file_records import files_in, name_from
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.result_folder import PREVIEW_DSM, PREVIEW_REPORT, PREVIEW_TRACK
from furrowmap.exporters.files.staging import staged_folder
from furrowmap.exporters.rasters.cog import SURFACE_BANDS, cog_output, surface_arrays, with_heights
from furrowmap.exporters.reports.run_report import run_origin
from furrowmap.exporters.vectors.geopackage import write_field
from furrowmap.exporters.vectors.qgis_styles import write_raster_style

PREVIEW_CELL_M: Final = 0.25
MAX_PREVIEW_KNOTS: Final = 20_000
"""Points of the track: more take a map seconds to draw and show nothing more."""
LOW_RETURNS: Final = Statistic.parse("p10")
"""Percentile of a cell's returns: those of the vehicle, which a preview does not classify, lie above it."""


def preview(
    session: str | Path,
    out: str | Path | None = None,
    *,
    within: str | Path | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Preview a session in seconds: the GNSS track and a coarse surface of few scans.

    Products of a run in the same folder stay, because no names are shared. Where the session does not state the
    mounting of the scanner, no surface is written.

    Args:
        out: the folder, made if it does not exist; by default SESSION_preview beside the session file.
        within: a file with polygons, or task data: the surface holds what lies in them; instead of `[field] within`.

    Returns:
        The content of `preview.json`.

    Raises:
        FurrowmapError: if the session does not make a track, or the folder cannot be written to.
    """
    file = Path(session)
    folder = Path(out) if out is not None else resolved(file).parent / f"{file.stem}_preview"
    opened = open_session(file)
    if within is not None:
        opened = opened.within(Path(within))
    if opened.inputs.within is not None:
        ground_to_map(opened.inputs.within, opened.frame)  # an error of the polygons is raised before the work
    with staged_folder(folder) as staging, using_threads(opened.session.run.threads, by_default=True):
        with FieldPoints(staging, PREVIEW_CELL_M) as land:

            def open_sink(
                frame: MapFrame,  # noqa: ARG001
                origin_m: tuple[float, float, float],
                frames: Frames | None,  # noqa: ARG001
            ) -> Callable[[PlacedScan], None]:
                land.begin(origin_m)
                return land.add

            found = preview_story.preview(opened, open_sink, progress)
            progress("writing the preview", 0.0)
            origin = run_origin(found, ())
            begin_s, end_s = found.located.trajectory.span_s
            distance_m, standing_s = distance_and_standing(found.located.trajectory, begin_s, end_s)
            figures = {
                "start": iso_utc(begin_s),
                "end": iso_utc(end_s),
                "duration_s": round(end_s - begin_s, 3),
                "distance_m": round(distance_m, 1),
                "standing_s": round(standing_s, 1),
                "crs": found.frame.name,
                "scans": found.placement.scans,
                "scans_without_pose": found.placement.scans_without_pose,
                "points": found.placement.points,
            }
            if found.session.lidar.xyz_m is not None:
                figures |= _write_surface(staging, land, found, origin)
        frame = found.frame
        knots = ScanPoses.at_knots(found.located.trajectory)
        some = slice(None, None, max(1, math.ceil(len(knots) / MAX_PREVIEW_KNOTS)))
        track = ScanPoses(**{name: values[some] for name, values in vars(knots).items()})
        write_field(staging / PREVIEW_TRACK, track, frame.wkt, words=frame.words, origin=origin)
        read = [one for path in found.inputs for one in (files_in(path) if path.is_dir() else [path])]
        root = resolved(file).parent
        account = {
            "preview": True,
            "session": msgspec.to_builtins(found.session),
            # as `report.json` lists them, but for the digests, which take longer than all else here
            "inputs": [{"name": name_from(root, one), "bytes": one.stat().st_size} for one in read],
            "figures": figures,
            "positions": found.located.positions,
            "warnings": _warnings(found),
            "timings": found.timings_s,
            "products": sorted({PREVIEW_REPORT, *(path.name for path in staging.iterdir())}),
        }
        (staging / PREVIEW_REPORT).write_text(json_text(account), encoding="utf-8")
    return account


def _warnings(found: RunResult) -> list[dict[str, Any]]:
    """What to do first comes first, each warning behind its cause."""
    return [
        {"code": notice.code, **notice.texts, "follows": cause.code if cause is not None else None}
        for notice in by_cause(found.notices)
        for cause in [cause_of(notice, found.notices)]
    ]


def _write_surface(folder: Path, land: FieldPoints, found: RunResult, origin: Origin) -> dict[str, float]:
    """Write the surface with its style; its figures, empty where no point lies on the land."""
    grid = land.grid
    if grid is None:
        return {}
    crs = with_heights(found.frame.whole_crs, found.session.crs.heights)
    seen = 0
    with cog_output(folder / PREVIEW_DSM, grid, crs, SURFACE_BANDS, origin) as write:
        for tile in land.tiles(Passages([]), LOW_RETURNS):
            write(tile.grid, surface_arrays(tile.after))
            seen += int(tile.after.seen.sum())
    write_raster_style(folder / PREVIEW_DSM, "dsm.qml")
    return {"dsm_cell_m": grid.cell_m, "dsm_area_m2": round(seen * grid.cell_area_m2, 1)}
