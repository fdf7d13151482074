"""The camera that a session states, and its images."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

from furrowmap.core.readers.exif import exif_images
from furrowmap.core.readers.image_table import read_image_table
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.file_names import MAX_ENTRIES, LeavesFolder, TooManyEntries, leads_out, matching, resolved
from furrowmap.core.runtime.languages.texts import Text, Words, reason
from furrowmap.core.values.camera import DISTORTION, PINHOLE, Camera
from furrowmap.core.values.images import Images, joined
from furrowmap.core.values.session import CameraSource

_WILD: Final = frozenset("*?[")


def camera_of(source: CameraSource) -> Camera:
    """The camera of the table `[camera]`. Raises ValueError if its size, intrinsics or a supported model is missing."""
    if source.width is None or source.height is None:
        raise ValueError(Text("camera.width and camera.height, the size of the images in pixels, are missing"))
    size = (source.width, source.height)
    if source.model is not None:
        try:
            camera = Camera.from_colmap(size, source.model.upper(), source.params)
        except ValueError as error:
            raise ValueError(Text("camera.model: {why}", why=reason(error))) from None
    else:
        missing = [f"camera.{name}" for name in PINHOLE if getattr(source, name) is None]
        if missing:
            raise ValueError(
                Text("{missing} (pixels) missing; or state camera.model and camera.params", missing=", ".join(missing))
            )
        numbers: dict[str, float] = {name: getattr(source, name) for name in (*PINHOLE, *DISTORTION)}
        camera = Camera(*size, **numbers)  # type: ignore[arg-type]
    return mounted(camera, source)


def mounted(camera: Camera, source: CameraSource) -> Camera:
    """A camera as the table `[camera]` says it is mounted and delayed."""
    return replace(camera, xyz_m=source.xyz_m, rpy_deg=source.rpy_deg, shutter_delay_s=source.shutter_delay_s)


def camera_faults(source: CameraSource | None) -> Iterator[Words]:
    """What is wrong with the table `[camera]`."""
    if source is None:
        return
    if source.table is None and not source.files:
        yield Text("[camera] names no images: set camera.table or camera.files")
    if source.topic is not None and not source.files:
        yield Text("camera.topic is of bags: name them in camera.files")
    if source.every_s and source.topic is None:
        yield Text("camera.every_s thins the images of camera.topic, which is missing")
    if source.control_pixels is not None and source.control_points is None:
        yield Text("camera.control_pixels needs camera.control_points, the surveyed places of the same points")
    if not source.has_intrinsics:  # recorded, or still to be filled in
        return
    try:
        camera_of(source)
    except ValueError as error:
        yield reason(error)


def camera_table(session_file: Path, source: CameraSource | None) -> Path | None:
    """The table that `[camera] table` names, if there is one. Raises InputError if it is outside the folder."""
    if source is None or source.table is None:
        return None
    folder = resolved(session_file).parent
    path = folder / source.table
    if "\0" in source.table or leads_out(path, folder):
        raise _outside(session_file, source.table)
    try:
        return resolved(path) if path.is_file() else None
    except OSError:  # the name is too long
        return None


def camera_files(session_file: Path, source: CameraSource) -> tuple[tuple[Path, ...], list[Notice]]:
    """The files of `[camera] files`, by name within each pattern, and notices; InputError outside the folder."""
    folder = resolved(session_file).parent
    found: dict[Path, None] = {}
    notices = []
    for named in source.files:
        try:
            paths = matching(folder, named) if not _WILD.isdisjoint(named) else [folder / named]
            there = [path for path in paths if path.is_file()]
        except LeavesFolder:
            raise _outside(session_file, named) from None
        except TooManyEntries:
            raise InputError(
                "session-path-outside.too-many-files", session_file=session_file, named=named, most=MAX_ENTRIES
            ) from None
        except (OSError, ValueError):
            paths = []
            there = []
        if any(leads_out(path, folder) for path in paths):
            raise _outside(session_file, named)
        if not there:
            notices.append(_missing(named))
        found |= dict.fromkeys(resolved(path) for path in there)
    return tuple(found), notices


def images_of(session_file: Path, source: CameraSource) -> tuple[Images, list[Notice]]:
    """The images of a session that are files, in the order of time, by the clock of the positions.

    InputError if a file lies outside the session's folder, or the table cannot be read.
    """
    folder = resolved(session_file).parent
    parts = []
    notices: list[Notice] = []
    table = camera_table(session_file, source)
    if table is not None:
        listed, found = read_image_table(table, folder)
        parts.append(listed)
        notices += found
    elif source.table is not None:
        notices.append(_missing(source.table))
    if source.files and source.topic is None:
        files, missing = camera_files(session_file, source)
        named, found = exif_images(files)
        parts.append(named)
        notices += [*missing, *found]
    return joined(parts).earlier_by(source.minus_gnss_s), notices


def _missing(named: str) -> Notice:
    return Notice("images-missing.named-file", named=named)


def _outside(session_file: Path, named: str) -> InputError:
    return InputError("session-path-outside.of-a-file", session_file=session_file, named=named)
