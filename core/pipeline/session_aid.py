"""A session's images as an aid of its trajectory."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Final

import numpy as np

from furrowmap.core.geodesy.coordinates import places_on_map
from furrowmap.core.images.control_points import ControlPoints
from furrowmap.core.images.image_aiding import AidedTrajectory, aid_by_images, unused
from furrowmap.core.images.image_features import ImageFeatures, find_features
from furrowmap.core.images.image_positions import held_against_images
from furrowmap.core.readers.reader import GivesTrack
from furrowmap.core.readers.surveyed_points import read_points
from furrowmap.core.readers.text_table import read_table
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text, Words
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.session.opened import OpenSession
from furrowmap.core.trajectory.located import Located
from furrowmap.core.values.images import ImageFile
from furrowmap.core.values.time_span import track_within

EXTRA: Final = ("cv2", "PIL")
_COLUMNS: Final = ("file", "name", "u", "v")


def features_ahead(opened: OpenSession, progress: Progress) -> dict[ImageFile, ImageFeatures]:
    """The features of the images taken while there are positions, before the trajectory is known; none if unwanted.

    Raises:
        InputError: if a table of images cannot be read.
    """
    source = opened.session.camera
    positions = opened.positions()
    if source is None or not (source.aid and source.is_known and all(map(find_spec, EXTRA))):
        return {}
    assert isinstance(positions, GivesTrack)
    track = track_within(positions.track(), opened.session.recording.span_s)
    images, _ = opened.images()  # they are read again, and noticed then
    before = np.searchsorted(track.t_s, images.t_s + opened.camera().shutter_delay_s)
    during = np.flatnonzero((before > 0) & (before < len(track)))
    return find_features(images.chosen(during).paths, progress)


def aid_session(
    opened: OpenSession,
    located: Located,
    scale: float,
    progress: Progress,
    features: Mapping[ImageFile, ImageFeatures] | None = None,
) -> AidedTrajectory:
    """The trajectory of a session aided by the images that it names; as it was where they do not serve.

    Args:
        scale: metres of the map for a metre on the ground.
        features: of the images, where they were found ahead.

    Raises:
        InputError: if a table of images or control points cannot be read.
    """
    source = opened.session.camera
    if source is None or not source.aid:
        return AidedTrajectory(located, None, ())
    if not all(map(find_spec, EXTRA)):
        why = Text('the extra is not installed: pip install ".[photo]" in the checkout of furrowmap')
        return AidedTrajectory(located, None, (unused(why),))
    inputs = opened.inputs
    notices: list[Notice] = []
    control: ControlPoints | None = None
    if inputs.control_points is not None:
        points = read_points(inputs.control_points, opened.frame.whole_crs)
        notices += points.notices
        seen: tuple[_Pixel, ...] = ()
        if inputs.control_pixels is not None:
            seen, of_pixels = read_pixels(inputs.control_pixels, points.name)
            notices += of_pixels
        control = ControlPoints(points.name, points.xyz_m, points.sigma_m, seen)
    images, of_images = opened.images()
    camera = opened.camera()
    stated, _ = places_on_map(images.t_s, images.lon_lat_h, opened.frame)
    located, found = held_against_images(located, images, camera, stated, scale)
    aided = aid_by_images(located, images, camera, scale, control, progress, features)
    return replace(aided, notices=(*notices, *of_images, *found, *aided.notices))


_Pixel = tuple[str, int, float, float]


def read_pixels(path: Path, names: tuple[str, ...]) -> tuple[tuple[_Pixel, ...], tuple[Notice, ...]]:
    """Image's file name, number of the point, column and row of control points in images; what the file leaves open.

    Args:
        path: of a CSV or spreadsheet with columns file, name, u, v.

    Raises:
        InputError: if it is not such a table, or names a point that is not known.
    """
    table = read_table(path, partial(_unreadable, path))
    found = {name: table.find([name]) for name in _COLUMNS}
    lacking = [name for name, column in found.items() if column is None]
    if lacking:
        raise _unreadable(path, Text("it has no columns {lacking}", lacking=", ".join(lacking)))
    numbers = {name: k for k, name in enumerate(names)}
    out = []
    columns = [column for column in found.values() if column is not None]
    places = np.column_stack([table.numbers(column) for column in columns[2:]])
    files, labels = (table.columns[column] for column in columns[:2])
    for file, name, place, line in zip(files, labels, places, table.lines, strict=True):
        if name.strip() not in numbers:
            raise _unreadable(
                path,
                Text("line {line} names {name!r}, which is none of the control points", line=line, name=name.strip()),
            )
        if not np.isfinite(place).all():
            raise _unreadable(path, Text("line {line} has no numbers in u and v", line=line))
        out.append((Path(file.strip()).name, numbers[name.strip()], float(place[0]), float(place[1])))
    return tuple(out), table.notices


def _unreadable(path: Path, why: Words) -> InputError:
    return InputError("control-pixels-unreadable", path=path, why=why)
