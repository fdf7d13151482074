"""From a folder of products to the format that somebody else's program takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pyproj import CRS

from furrowmap.core.values.errors import Notice, RefusedError, UsageError
from furrowmap.core.values.progress import Progress, silent
from furrowmap.exporters.exchange.result import Result, open_result
from furrowmap.exporters.exchange.stac import write_collection
from furrowmap.exporters.exchange.task_data import write_task_data
from furrowmap.exporters.exchange.vectors import FORMATS, Layers, VectorFormat, changed_crs
from furrowmap.exporters.files.atomic import atomic_output, refuse_existing
from furrowmap.exporters.files.staging import staged_folder

TASK_DATA: Final = "isoxml"
STAC: Final = "stac"
NAMES: Final = (*FORMATS, TASK_DATA, STAC)


@dataclass(frozen=True)
class Exported:
    """What was written.

    Attributes:
        target: the file, or the folder of several.
        files: that were written, each once.
        notices: what the format could not keep, and what a change of CRS means.
    """

    target: Path
    files: tuple[Path, ...]
    notices: tuple[Notice, ...]


def export(
    folders: Sequence[Path],
    to: str,
    target: Path | None = None,
    *,
    layers: Sequence[str] = (),
    crs: CRS | None = None,
    overwrite: bool = False,
    progress: Progress = silent,
) -> Exported:
    """Write what runs found out in another format.

    Args:
        folders: of the products; one, except for `STAC`.
        to: the format's name, one of `NAMES`.
        target: the file or folder to write; by default beside the first folder, named after it.
        layers: of the vectors, all if none is named.
        crs: of the vectors; the session's if None, and always WGS 84 where the format has no other.
        overwrite: replace what is there.
        progress: is told of the stage.

    Raises:
        UsageError: if the arguments do not go together.
        InputError: if a folder holds no products, or not that layer.
        RefusedError: if `target` is there, or a CRS cannot be reached safely.
        FurrowmapError: if the format needs a package that is not installed.
    """
    if to not in FORMATS and (layers or crs is not None):
        raise _usage(f"{to} takes no layers and no CRS of your choice.", "Leave --layer and --dst-crs out.")
    if to != STAC and len(folders) != 1:
        raise _usage(f"{to} takes one folder of products; {len(folders)} are named.", "Export them one by one.")
    results = [open_result(folder) for folder in folders]
    progress("exporting", 0.0)
    target = target or _default(folders[0], to)
    _refuse_existing(target, overwrite=overwrite)
    if to == STAC:
        with staged_folder(target) as staging:
            write_collection(staging, results, target)
            names = _names(staging)
        return Exported(target, tuple(target / name for name in names), ())
    if to == TASK_DATA:
        notices = write_task_data(folders[0], target)
        files = sorted(target.iterdir()) if target.is_dir() else [target]
        return Exported(target, tuple(files), tuple(notices))
    return _vectors(results[0], FORMATS[to], target, layers, crs)


def _vectors(result: Result, chosen: VectorFormat, target: Path, layers: Sequence[str], crs: CRS | None) -> Exported:
    found: Layers = {name: result.layer(name) for name in (layers or result.layers)}
    found, notices = changed_crs(found, chosen.crs or crs)
    if chosen.single:
        with atomic_output(target) as unfinished:
            notices += chosen.write(unfinished, found, result.origin)
        return Exported(target, (target,), tuple(notices))
    with staged_folder(target) as staging:
        notices += chosen.write(staging, found, result.origin)
        files = _names(staging)
    return Exported(target, tuple(target / name for name in files), tuple(notices))


def _names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def _default(folder: Path, to: str) -> Path:
    """Beside the folder, as the run's own default lies beside the session."""
    here = folder.resolve()
    name = f"{here.name}_{to}"
    chosen = FORMATS.get(to)
    return here.with_name(f"{name}{chosen.suffix}" if chosen is not None and chosen.single else name)


def _refuse_existing(target: Path, *, overwrite: bool) -> None:
    """Keep what is there, unless it was asked to go.

    Raises:
        RefusedError: if there is something, and nobody said `overwrite`; or if it is a folder of products itself.
    """
    there = target.exists() and (not target.is_dir() or any(target.iterdir()))
    if not there:
        return
    if target.is_dir() and (target / "report.json").exists():
        raise RefusedError(
            f"{target} holds the products of a run.",
            "Exported files would lie among them, and be taken for them.",
            "Choose another target with -o.",
            code="output-is-result",
        )
    refuse_existing(target, overwrite=overwrite)


def _usage(what: str, remedy: str) -> UsageError:
    return UsageError(what, "Nothing was done.", remedy, code="usage")
