"""Which surfaces belong to the sessions of a base."""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from furrowmap.core.values.errors import InputError, Notice, UsageError
from furrowmap.core.values.progress import Progress, silent
from furrowmap.exporters.exchange.result import open_result
from furrowmap.exporters.farm.farm_map import DATABASES, DB_SCHEMA, known_sessions
from furrowmap.exporters.farm.mosaic import SUFFIXES
from furrowmap.exporters.files.atomic import refuse_existing

_PRODUCT: Final = re.compile(r"\w[\w-]*")


def find_surfaces(
    sources: Sequence[str], product: str, *, schema: str = DB_SCHEMA, progress: Progress = silent
) -> tuple[list[Path], tuple[Notice, ...]]:
    """The files of a product, those of earlier sessions first, and what is missing.

    Args:
        sources: bases, and folders of results.
        product: the file's name without its suffix.
        schema: of the tables in databases.
        progress: is told of waiting for others.

    Raises:
        UsageError: if `product` is no such name.
        InputError: if a base or folder cannot be read, or none has the product.
    """
    if not _PRODUCT.fullmatch(product):
        raise UsageError(
            f"--product: {product!r} is no name of a product.",
            "Nothing was done.",
            "Give the file's name without its suffix, such as dsm.",
            code="usage",
        )
    folders: dict[Path, dt.datetime] = {}
    for source in sources:
        if source.startswith(DATABASES) or not Path(source).is_dir():
            _, _, sessions = known_sessions(source, schema=schema, progress=progress)
            folders |= {Path(session.folder): session.end for session in sessions}
        else:
            end = open_result(Path(source)).report["figures"]["end"]
            folders[Path(source).resolve()] = dt.datetime.fromisoformat(end)
    paths = [folder / f"{product}.tif" for folder, _ in sorted(folders.items(), key=lambda item: (item[1], item[0]))]
    there = [path for path in paths if path.is_file()]
    missing = [path for path in paths if path not in there]
    if not there:
        raise InputError(
            f"None of the {len(paths)} sessions has a {product}.tif in its folder.",
            "There is nothing to make a mosaic of.",
            "Check --product, and that the folders of the results are still where they were when they were added"
            + (f" (the first is {missing[0].parent})." if missing else "."),
            code="no-surfaces",
        )
    if not missing:
        return there, ()
    text = f"{len(missing)} of {len(paths)} sessions have no {product}.tif, among them {missing[0].parent}."
    return there, (Notice("surfaces-missing", text),)


def refuse_output(output: Path, *, overwrite: bool) -> None:
    """See that a mosaic may be written under that name.

    Raises:
        UsageError: if its suffix tells no format.
        RefusedError: if it is there.
    """
    if output.suffix not in SUFFIXES:
        raise UsageError(
            f"{output}: its suffix tells no format of a mosaic.",
            "Nothing was done.",
            "Name it with .vrt for a virtual raster, or with .tif for a GeoTIFF.",
            code="usage",
        )
    refuse_existing(output, overwrite=overwrite)
