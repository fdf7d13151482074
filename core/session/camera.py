"""The camera that a session states, and its images."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

from furrowmap.core.readers.exif import exif_images
from furrowmap.core.readers.image_table import read_image_table
from furrowmap.core.values.camera import DISTORTION, Camera
from furrowmap.core.values.errors import InputError, Notice
from furrowmap.core.values.file_names import leads_out
from furrowmap.core.values.images import Images, joined
from furrowmap.core.values.session import CameraSource

_PINHOLE: Final = ("fx", "fy", "cx", "cy")
_WILD: Final = frozenset("*?[")


def camera_of(source: CameraSource) -> Camera:
    """The camera of the table `[camera]`.

    Raises:
        ValueError: if its size or its intrinsics are missing, or its model is not supported.
    """
    if source.width is None or source.height is None:
        raise ValueError("camera.width and camera.height, the size of the images in pixels, are missing")
    size = (source.width, source.height)
    if source.model is not None:
        try:
            camera = Camera.from_colmap(size, source.model.upper(), source.params)
        except ValueError as error:
            raise ValueError(f"camera.model: {error}") from None
    else:
        missing = [f"camera.{name}" for name in _PINHOLE if getattr(source, name) is None]
        if missing:
            raise ValueError(f"{', '.join(missing)} (pixels) missing; or state camera.model and camera.params")
        numbers: dict[str, float] = {name: getattr(source, name) for name in (*_PINHOLE, *DISTORTION)}
        camera = Camera(*size, **numbers)  # type: ignore[arg-type]
    return replace(camera, xyz_m=source.xyz_m, rpy_deg=source.rpy_deg, shutter_delay_s=source.shutter_delay_s)


def camera_faults(source: CameraSource | None) -> Iterator[str]:
    """What is wrong with the table `[camera]`."""
    if source is None:
        return
    if source.table is None and not source.files:
        yield "[camera] names no images: set camera.table or camera.files"
    try:
        camera_of(source)
    except ValueError as error:
        yield str(error)


def camera_files(session_file: Path, source: CameraSource) -> tuple[Path, ...]:
    """The files that `[camera] files` names, each once, in the order of their names within each pattern.

    Raises:
        InputError: if one lies outside the session's folder, or a name without wildcards does not exist.
    """
    folder = session_file.resolve().parent
    found: dict[Path, None] = {}
    for named in source.files:
        wild = not _WILD.isdisjoint(named)
        try:
            paths = sorted(folder.glob(named)) if wild else [folder / named]
            outside = any(leads_out(path, folder) for path in paths)
            there = all(path.exists() for path in paths)
        except (OSError, ValueError, NotImplementedError) as error:
            raise _missing(session_file, named, f"is not a valid file name ({error})") from None
        if outside:
            raise InputError(
                f"{session_file}: {named!r} is outside the session's folder.",
                "A session file may only name files in its own folder or below, so that a foreign one cannot read "
                "others.",
                "Put the session file in a folder above the images, or copy the images beside it.",
                code="session-path-outside",
            )
        if not there:
            raise _missing(session_file, named, "does not exist")
        found |= dict.fromkeys(path.resolve() for path in paths if path.is_file() or not wild)
    return tuple(found)


def images_of(session_file: Path, source: CameraSource, notices: list[Notice]) -> Images:
    """The images of a session in the order of time, by the clock of the positions.

    Args:
        session_file: path of the session file.
        source: its table `[camera]`.
        notices: what is wrong with single images is added.

    Raises:
        InputError: if a file that the session names cannot be read.
    """
    folder, parts = session_file.resolve().parent, []
    if source.table is not None:
        parts.append(read_image_table(folder / source.table, folder, notices))
    if source.files:
        parts.append(exif_images(camera_files(session_file, source), notices))
    return joined(parts).earlier_by(source.minus_gnss_s)


def _missing(session_file: Path, named: str, what: str) -> InputError:
    return InputError(
        f"{session_file}: {named!r} {what}.",
        "The session could not be opened.",
        "Correct the file name in the session file; paths are relative to that file.",
        code="session-file-missing",
    )
