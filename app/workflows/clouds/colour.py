"""Colouring clouds: any cloud in the colours of the images of a session."""

from collections.abc import Iterator
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS

from furrowmap.core.geodesy.crs_change import optional_with_heights
from furrowmap.core.images.image_frames import Frames, frames_along
from furrowmap.core.pipeline.session_aid import aid_session
from furrowmap.core.pipeline.solution import companions, ground_scale
from furrowmap.core.pointclouds.cleaning import clean_points
from furrowmap.core.pointclouds.cleaning_steps import Cleaning
from furrowmap.core.pointclouds.joined_clouds import Clouds, no_points_error, open_clouds
from furrowmap.core.readers.image_pixels import expect_pillow
from furrowmap.core.runtime.errors import InputError, Notice, RefusedError
from furrowmap.core.runtime.json_text import plain
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.runtime.record_spool import RecordArray
from furrowmap.core.runtime.settings import using
from furrowmap.core.session.opened import OpenSession, open_session
from furrowmap.core.trajectory.located import locate
from furrowmap.core.values.images import CONTRADICTING
from furrowmap.exporters.cloud.copc_file import CopcFormat, las_wkt
from furrowmap.exporters.cloud.writer import CopcWriter
from furrowmap.exporters.files.atomic import make_folder
from furrowmap.exporters.files.provenance import Origin
from furrowmap.workflows.clouds.clean import NO_TIME, batch_of, refuse_target, scale_of
from furrowmap.workflows.clouds.inputs import input_records
from furrowmap.workflows.run.colours import RunColours


def colour(
    cloud: str | Path,
    session: str | Path,
    out: str | Path,
    *,
    crs: CRS | str | None = None,
    overwrite: bool = False,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Write a cloud in the colours of the images of a session, as COPC with point format 7.

    Each point takes the colour of the best image that sees it; points that none sees, of the machine, and noise are 0.
    The poses of the images are those of the session's trajectory from GNSS, IMU and the images themselves, with the
    camera's mounting that these show, or of its `[trajectory]`.

    Args:
        cloud: LAS, LAZ or COPC file; it is taken to the session's CRS, its heights are taken as they are.
        session: session file with `[camera]`.
        out: the file to write, whole or not at all.
        crs: of a cloud without one.

    Returns:
        Counts of the points and images, and warnings.

    Raises:
        InputError: if the session has no camera, no image has a pose, or a file cannot be read.
        RefusedError: if the file exists, or is the cloud, or the images contradict GNSS and IMU.
    """
    source = Path(cloud)
    target = Path(out)
    refuse_target(target, [source], overwrite=overwrite)
    opened = open_session(Path(session))
    clouds = open_clouds([source], optional_with_heights(crs), opened.frame.crs, without_option=True)
    make_folder(target.parent)
    with using(scratch_folder=target.parent):
        frames, notices = _frames(opened, progress)
        figures, unseen = _write(clouds, frames, target, progress)
    warnings = [*notices, *clouds.notices, *unseen]
    return dict(plain({"cloud": source.name, "figures": figures, "warnings": list(dict.fromkeys(warnings))}))


def _frames(opened: OpenSession, progress: Progress) -> tuple[Frames, list[Notice]]:
    """The frames of the session's camera, and notices about its images."""
    camera = opened.session.camera
    if camera is None:
        raise InputError("no-camera.no-table", file=opened.file)
    expect_pillow()
    images, notices = opened.images()
    located = locate(opened.positions(), opened.session, opened.frame, companions(opened))
    scale = ground_scale(opened.frame, located.trajectory)
    aided = aid_session(opened, located, scale, progress)
    notices += [notice for notice in aided.notices if notice not in notices]
    contradicting = next((notice for notice in notices if notice.code == CONTRADICTING), None)
    if contradicting is not None:
        raise RefusedError(f"{CONTRADICTING}.colour", file=opened.file, contradiction=contradicting.text)
    used = aided.aid.camera if aided.aid is not None else opened.camera()
    frames: Frames | None = None
    if len(images):
        frames, unposed = frames_along(images, used, aided.located.trajectory, scale)
        notices += unposed
    if frames is None:
        raise InputError(
            "no-images.none-with-pose",
            file=opened.file,
            images=len(images),
            notices="".join(f" {notice.text}" for notice in notices),
        )
    return frames, notices


def _write(clouds: Clouds, frames: Frames, target: Path, progress: Progress) -> tuple[dict[str, Any], list[Notice]]:
    """Read the cloud twice: for what hides what, and to write it."""
    with ExitStack() as stack:
        colours: RunColours | None = None
        for records in _points(clouds, target.parent, progress):
            if colours is None:
                east, north, up = (np.floor(records["xyz_m"][0] / 1000.0) * 1000.0).tolist()
                origin_m = east, north, up
                colours = stack.enter_context(RunColours(frames, origin_m))
            colours.add_points(records["xyz_m"] - origin_m, records["classification"])
        if colours is None:
            raise no_points_error(clouds, None)
        colours.finish(progress)
        scale_m = scale_of(clouds)
        kind = CopcFormat(las_wkt(clouds.crs), origin_m, scale_m, colour=True, week_time=clouds.week_times)
        no_time = 0.0 if clouds.week_times else NO_TIME
        inputs = [(record.name, record.sha256) for record in input_records(clouds, progress)]
        with CopcWriter(target, kind) as writer:
            for records in _points(clouds, target.parent, progress):
                writer.append(batch_of(records, origin_m, no_time, coloured=True))
            text = Origin("points of a cloud, coloured by images", inputs=inputs).text
            writer.close(progress, partial(colours.paint, scale_m=scale_m), text)
        return colours.figures()


def _points(clouds: Clouds, folder: Path, progress: Progress) -> Iterator[RecordArray]:
    """The points in batches."""
    with closing(clean_points(clouds, Cleaning(), folder, None, progress)) as points:
        yield from (records for records in points if len(records))
