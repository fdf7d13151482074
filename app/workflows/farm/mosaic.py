"""The surfaces of a farm's sessions as one raster."""

import datetime as dt
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from furrowmap.core.runtime.errors import InputError, Notice, OptionError, UsageError
from furrowmap.core.runtime.file_names import leads_out, resolved
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.exporters.farm.edit import KnownSession
from furrowmap.exporters.farm.surface_mosaic import SUFFIXES, Mosaic, write_mosaic
from furrowmap.exporters.files.atomic import refuse_existing
from furrowmap.exporters.files.result_folder import open_result
from furrowmap.settings import MosaicSettings
from furrowmap.workflows.farm.farm import DATABASES, DB_SCHEMA, farm_map_sessions
from furrowmap.workflows.farm.folders import foreign_notices, named_folders

_PRODUCT: Final = re.compile(r"\w[\w-]*")


def mosaic(
    sources: Sequence[str | Path],
    out: str | Path,
    settings: MosaicSettings = MosaicSettings(),
    *,
    product: str = "dsm",
    schema: str = DB_SCHEMA,
    overwrite: bool = False,
    progress: Progress = silent,
) -> Mosaic:
    """Merge the surfaces of sessions into one raster, the latest session on top.

    Args:
        sources: farm maps, and folders of results.
        out: `.vrt` for a virtual raster, `.tif` for a cloud-optimised GeoTIFF.
        product: file name of the surfaces without its suffix.
        schema: of the tables in databases.

    Raises:
        UsageError: if `product` is not a file name, or `out` has another suffix.
        InputError: if a farm map or folder cannot be read, or none has the product.
        RefusedError: if the file exists, or the surfaces cannot be merged.
    """
    output = Path(out)
    if output.suffix not in SUFFIXES:
        raise UsageError("usage.suffix", path=output, suffixes=SUFFIXES, example=output.with_suffix(".tif").name)
    refuse_existing(output, overwrite=overwrite)
    paths, missing = find_surfaces(sources, product, schema=schema, progress=progress)
    made = write_mosaic(paths, output, crs=settings.crs, cell_m=settings.cell_m, mean=settings.mean, progress=progress)
    return replace(made, notices=(*missing, *made.notices))


def find_surfaces(
    sources: Sequence[str | Path], product: str, *, schema: str = DB_SCHEMA, progress: Progress = silent
) -> tuple[list[Path], tuple[Notice, ...]]:
    """The files of a product in order of their sessions' times, and a notice on missing ones."""
    if not _PRODUCT.fullmatch(product):
        wanted = Text("the name of a product without its suffix")
        raise OptionError("--product", product, wanted, "dsm")
    folders: dict[Path, dt.datetime] = {}
    foreign: list[KnownSession] = []
    for source in sources:
        if str(source).startswith(DATABASES) or not Path(source).is_dir():
            _, _, sessions = farm_map_sessions(source, schema=schema, progress=progress)
            named = named_folders(None if str(source).startswith(DATABASES) else Path(source), sessions)
            folders |= {folder: session.end for session, folder in named.results}
            foreign += named.foreign
        else:
            end = open_result(Path(source)).report["figures"]["end"]
            folders[resolved(Path(source))] = dt.datetime.fromisoformat(end)
    paths = [folder / f"{product}.tif" for folder, _ in sorted(folders.items(), key=lambda item: (item[1], item[0]))]
    found = [path for path in paths if path.is_file() and not leads_out(path, path.parent)]
    missing = [path for path in paths if path not in found]
    if not found and foreign:
        raise InputError("no-surfaces.foreign", foreign=len(foreign), folder=foreign[0].folder)
    if not found:
        raise InputError(
            "no-surfaces", paths=len(paths), product=product, parent=missing[0].parent if missing else None
        )
    notices = foreign_notices(foreign)
    if missing:
        counts = {"missing": len(missing), "paths": len(paths)}
        notices = (*notices, Notice("surfaces-missing", **counts, product=product, parent=missing[0].parent))
    return found, notices
