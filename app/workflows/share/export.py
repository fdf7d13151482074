"""Export of results to formats of other programs."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pyproj import CRS

from furrowmap.core.geodesy.crs_change import optional_crs
from furrowmap.core.runtime.errors import Notice, RefusedError, UsageError
from furrowmap.core.runtime.file_names import resolved
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.exporters.exchange.stac import write_collection
from furrowmap.exporters.exchange.task_data import write_task_data
from furrowmap.exporters.exchange.textured_mesh import MESH, write_textured_mesh
from furrowmap.exporters.exchange.trajectories import TRAJECTORIES, write_trajectory
from furrowmap.exporters.exchange.vectors import FORMATS, Layers, changed_crs, write_vectors
from furrowmap.exporters.files.atomic import refuse_existing
from furrowmap.exporters.files.result_folder import REPORT, open_result, reading_result
from furrowmap.exporters.files.staging import staged_folder

TASK_DATA: Final = "isoxml"
STAC: Final = "stac"
EXPORT_FORMATS: Final = (*FORMATS, *TRAJECTORIES, MESH, TASK_DATA, STAC)


@dataclass(frozen=True)
class Exported:
    """What was written: the file, or the folder of several, and all files."""

    target: Path
    files: tuple[Path, ...]
    notices: tuple[Notice, ...]


def export(
    results: Sequence[str | Path],
    to: str,
    out: str | Path | None = None,
    *,
    layers: Sequence[str] = (),
    crs: CRS | str | None = None,
    overwrite: bool = False,
    progress: Progress = silent,
) -> Exported:
    """Export the results of runs to another format.

    Args:
        results: folders that runs wrote; one, except for "stac".
        to: "gpkg", "geoparquet", "flatgeobuf", "geojson", "shapefile", "kml", "csv", "isoxml" or "stac"; of
            the trajectory alone "sbet", "tum" or "poses" (CSV); of the surface with its orthophoto "glb".
        out: the file or folder to write; by default beside the first folder, named after it.
        layers: of the vectors; all if none is named.
        crs: of the vectors; None for the session's. Formats with a CRS of their own (WGS 84) always have that.

    Raises:
        UsageError: if the arguments cannot be combined.
        InputError: if a folder contains no result, or not that layer.
        RefusedError: if `out` exists, or PROJ has no reliable change of CRS.
        FurrowmapError: if the format needs a package that is not installed.
    """
    folders = [Path(folder) for folder in results]
    wanted = optional_crs(crs)
    if to not in FORMATS and (layers or crs is not None):
        raise UsageError("usage.both", one=f"--to {to}", other="--layer" if layers else "--dst-crs")
    if to != STAC and len(folders) != 1:
        raise UsageError("usage.export-one-folder", to=to, count=len(folders))
    opened = [open_result(folder) for folder in folders]
    progress("exporting", 0.0)
    target = Path(out) if out is not None else _default(folders[0], to)
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        refuse_result(target)
        refuse_existing(target, overwrite=overwrite)
    with reading_result(folders[0]):
        if to == STAC:
            with staged_folder(target) as staging:
                write_collection(staging, opened, target)
                names = sorted(path.name for path in staging.iterdir())
            return Exported(target, tuple(target / name for name in names), ())
        if to in TRAJECTORIES:
            write_trajectory(target, to, opened[0])
            return Exported(target, (target,), ())
        if to == MESH:
            return Exported(target, (target,), tuple(write_textured_mesh(target, opened[0])))
        if to == TASK_DATA:
            notices = write_task_data(opened[0], target)
            files = sorted(target.iterdir()) if target.is_dir() else [target]
        else:
            chosen = FORMATS[to]
            result = opened[0]
            found: Layers = {name: result.layer(name) for name in (layers or result.layer_names)}
            found, notices = changed_crs(found, chosen.crs or wanted)
            files, lost = write_vectors(chosen, target, found, result.origin, result.zone)
            notices += lost
    return Exported(target, tuple(files), tuple(notices))


def _default(folder: Path, to: str) -> Path:
    """Beside the folder, named after it."""
    here = resolved(folder)
    name = f"{here.name}_{to}"
    if to in TRAJECTORIES or to == MESH:
        return here.with_name(name + TRAJECTORIES.get(to, ".glb"))
    chosen = FORMATS.get(to)
    return here.with_name(f"{name}{chosen.suffix}" if chosen is not None and chosen.write_all is not None else name)


def refuse_result(target: Path) -> None:
    """Refuse to write to a folder that is the result of a run."""
    if (target / REPORT).exists():
        raise RefusedError("output-is-result", target=target)
