"""The runs of a batch: one for each session, or one for each visit of a field by a recording."""

import hashlib
import json
import math
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cache, lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from furrowmap.core.coverage.field_boundary import boundary_on_map
from furrowmap.core.geodesy.coordinates import transform_poses, transform_track
from furrowmap.core.geodesy.longitudes import unwrapped_deg
from furrowmap.core.geodesy.projection import map_frame
from furrowmap.core.readers.boundary_file import BOUNDARIES_UNREADABLE, FieldOutline, read_fields
from furrowmap.core.readers.reader import GivesPoses, GivesTrack
from furrowmap.core.runtime.settings import ALLOWANCES, allows, language_of_user
from furrowmap.core.runtime.write_errors import as_furrowmap_error
from furrowmap.core.session.opened import Inputs, OpenSession
from furrowmap.core.session.session_file import parse_session, read_session_text
from furrowmap.core.trajectory.from_poses import trajectory_from_poses
from furrowmap.core.values.session import Session
from furrowmap.core.values.time_span import track_within
from furrowmap.exporters.files.atomic import atomic_output, relative_path
from furrowmap.exporters.files.batch_state import Failure, Stamp
from furrowmap.workflows.batch.batch_sources import BatchSource
from furrowmap.workflows.batch.object_stores import fetch_session, scratch
from furrowmap.workflows.session.init import proposed
from furrowmap.workflows.session.known_machines import machine_for

OUTLINES_FOLDER: Final = ".batch-fields"
"""Folder of the outlines that runs take as the boundary of their field."""
MIN_VISIT_S: Final = 30.0
"""A field in which the vehicle is for less is passed by or crossed."""
VISIT_MARGIN_S: Final = 30.0
"""Part of the drive before the first and after the last place in the field that its run has as well: a turn."""
MAX_POSITION_GAP_S: Final = 10.0
"""Longer gaps between positions do not count as time in a field."""


@dataclass(frozen=True)
class FieldVisit:
    """A part of a recording in one field, whose name has a number from the second visit on.

    `outline`: the field's polygons in longitude and latitude, as GeoJSON.
    """

    name: str
    outline: str
    span_s: tuple[float, float]


@dataclass(frozen=True)
class PreparedSource:
    """What a source holds."""

    text: str = ""
    visits: tuple[FieldVisit, ...] = ()
    failure: Failure | None = None


@dataclass(frozen=True)
class Job:
    """A run: files or URLs of its session and of the folder of all results.

    A session that is made from recordings is not written to `file`. In a store `file` is the address of the session
    file.
    """

    name: str
    file: str
    text: str
    results: str
    visit: FieldVisit | None = None
    overwrite: bool = False
    url: str = ""
    stamps: tuple[Stamp, ...] = ()
    results_url: str = ""

    @property
    def folder(self) -> Path:
        """The result folder."""
        return Path(self.results) / self.name


def identity(file: str, visit: FieldVisit | None) -> str:
    """What tells the run of a source, or of its visit of a field, from all others."""
    return json.dumps([file, *([visit.name] if visit is not None else [])])


@cache
def own_version() -> str:
    """The version of furrowmap; looking it up takes 2 ms."""
    return version("furrowmap")


@lru_cache(maxsize=1)
def _parsed(text: str, file: str) -> Session:
    """The session of a job, which several steps need in a row."""
    return parse_session(text, file)


def prepare(source: BatchSource, machine: str, boundaries: str) -> PreparedSource:
    """Propose a session for the recordings of a source, and find the fields that they enter.

    Errors are returned, because one source must not stop the others.
    """
    try:
        with ExitStack() as stack:
            file = source.file
            if source.url:
                file = fetch_session(source.url, source.stamps, Path(stack.enter_context(scratch())))
            text = (
                proposed([file.parent], file.parent, machine_for(machine, None)[0])[0].text
                if source.made
                else read_session_text(file)
            )
            session = parse_session(text, str(file))
            if not boundaries or session.field.boundary is not None:
                return PreparedSource(text)
            return PreparedSource(text, tuple(_visits(file, session, Path(boundaries))))
    except Exception as error:  # noqa: BLE001 whatever is wrong with one source is a row of the table
        return PreparedSource(failure=Failure.from_error(as_furrowmap_error(error)))


def open_job(job: Job) -> OpenSession:
    """The session of a job; the outline of its field is written into the folder of the results."""
    file = Path(job.file)
    session = _parsed(job.text, job.file)
    inputs = Inputs.find(file, session)
    frame = map_frame(session.crs, inputs.parameters, inputs.geoid_grid)
    if job.visit is not None:
        boundary = _outline_file(Path(job.results) / OUTLINES_FOLDER, job.visit.outline)
        session = _restrict_to_visit(session, job.visit, relative_path(boundary, file.parent) or str(boundary))
        inputs = replace(inputs, boundary=boundary)
    return OpenSession(file, session, inputs, frame)


def key_of(job: Job) -> str:
    """A hash of what decides on the products besides the content of the inputs: settings and version."""
    session = msgspec.to_builtins(_parsed(job.text, job.file))
    visit = msgspec.to_builtins(job.visit)
    decisive = [own_version(), session, visit, language_of_user(), sorted(filter(allows, ALLOWANCES))]
    return hashlib.sha256(json.dumps(decisive, default=str, sort_keys=True).encode()).hexdigest()


def visits_of(
    t_s: NDArray[np.float64], xy_m: NDArray[np.float64], shapes: Sequence[BaseGeometry]
) -> list[tuple[int, float, float]]:
    """Index of the field, first and last time of each visit, in the order of time.

    A field that is entered again after another one has two visits. Where fields overlap, the first counts. The times
    (n,) of the places (n, 2) increase.
    """
    field = np.full(len(t_s), -1)
    for k, shape in enumerate(shapes):
        west, south, east, north = shape.bounds
        near = (field < 0) & (xy_m[:, 0] >= west) & (xy_m[:, 0] <= east)
        near &= (xy_m[:, 1] >= south) & (xy_m[:, 1] <= north)
        if near.any():
            shapely.prepare(shape)
            near[near] = shapely.contains_xy(shape, *xy_m[near].T)
            field[near] = k
    step_s = np.diff(t_s, append=t_s[-1:])
    step_s[step_s > MAX_POSITION_GAP_S] = 0.0
    inside = np.flatnonzero(field >= 0)
    kept: list[tuple[int, float, float]] = []
    for part in np.split(inside, np.flatnonzero(np.diff(field[inside])) + 1):
        if not len(part) or float(step_s[part].sum()) < MIN_VISIT_S:
            continue
        k = int(field[part[0]])
        first = float(t_s[part[0]])
        last = float(t_s[part[-1]])
        if kept and kept[-1][0] == k:
            kept[-1] = (k, kept[-1][1], last)
        else:
            kept.append((k, first, last))
    return kept


def _visits(file: Path, session: Session, boundaries: Path) -> list[FieldVisit]:
    inputs = Inputs.find(file, session)
    opened = OpenSession(file, session, inputs, map_frame(session.crs, inputs.parameters, inputs.geoid_grid))
    fields, _ = read_fields(boundaries, target=opened.frame.crs, error_code=BOUNDARIES_UNREADABLE)
    t_s, xy_m = _places(opened)
    near = [field for field in fields if _near(field, opened, xy_m)]
    found = visits_of(t_s, xy_m, [boundary_on_map(field.outline, opened.frame) for field in near])
    visits: list[FieldVisit] = []
    for n, (k, first, last) in enumerate(found):
        before = found[n - 1][2] if n else -math.inf
        after = found[n + 1][1] if n + 1 < len(found) else math.inf
        span = (max(first - VISIT_MARGIN_S, before), min(last + VISIT_MARGIN_S, after))
        name = near[k].names[0] if near[k].names else f"field {fields.index(near[k]) + 1}"
        again = 1 + sum(earlier == k for earlier, *_ in found[:n])
        name = f"{name} ({again})" if again > 1 else name
        shape = json.loads(shapely.to_geojson(near[k].outline))
        feature = {"type": "Feature", "properties": {"name": name}, "geometry": shape}
        outline = json.dumps({"type": "FeatureCollection", "features": [feature]}, ensure_ascii=False)
        visits.append(FieldVisit(name, outline, (math.floor(span[0]), math.ceil(span[1]))))
    return visits


def _places(opened: OpenSession) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times (n,) and places (n, 2) on the map of the antenna, or of an external trajectory."""
    reader = opened.positions()
    span_s = opened.session.recording.span_s
    if opened.session.trajectory is not None:
        assert isinstance(reader, GivesPoses)
        poses, _ = transform_poses(track_within(reader.poses(), span_s), opened.frame)
        trajectory = trajectory_from_poses(poses, opened.frame)
        return trajectory.t_s, trajectory.xyz_m[:, :2]
    assert isinstance(reader, GivesTrack)
    track, _ = transform_track(track_within(reader.track(), span_s), opened.frame)
    return track.t_s, np.column_stack(opened.frame.project(track.lon_deg, track.lat_deg))


def _near(field: FieldOutline, opened: OpenSession, xy_m: NDArray[np.float64]) -> bool:
    """Whether the drive may have entered a field: fields far away may lie outside of the map."""
    lon, lat = opened.frame.to_lon_lat(*xy_m[:: max(1, len(xy_m) // 1000)].T)
    west, south, east, north = field.outline.bounds
    lon = unwrapped_deg(lon, 0.5 * (west + east))
    beyond = 0.001
    inside = (lon >= west - beyond) & (lon <= east + beyond) & (lat >= south - beyond) & (lat <= north + beyond)
    return bool(inside.any())


def _outline_file(folder: Path, outline: str) -> Path:
    """The file of an outline, named by its content."""
    path = folder / f"{hashlib.sha256(outline.encode()).hexdigest()[:16]}.geojson"
    if not path.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        with atomic_output(path) as unfinished:
            unfinished.write_text(outline, encoding="utf-8")
    return path


def _restrict_to_visit(session: Session, visit: FieldVisit, boundary: str) -> Session:
    recording, first, last = session.recording, *session.recording.span_s
    begin = max(first, visit.span_s[0])
    end = min(last, visit.span_s[1])
    replaced: dict[str, Any] = {
        "name": f"{session.name}, {visit.name}" if session.name else visit.name,
        "recording": msgspec.structs.replace(
            recording, begin=datetime.fromtimestamp(begin, UTC), end=datetime.fromtimestamp(end, UTC)
        ),
        "field": msgspec.structs.replace(session.field, boundary=boundary, name=None),
    }
    return msgspec.structs.replace(session, **replaced)
