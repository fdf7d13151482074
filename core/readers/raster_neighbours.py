"""What lies beside a GeoTIFF and belongs to it: the place of its cells, its mask, its CRS and which value is none.

GDAL opens these files by their names, with any driver: a mask may be a virtual raster of other files, and an overview
an address. Here a GeoTIFF is opened in a folder without neighbours; those that it needs are copied into one, checked.
"""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from html import escape
from pathlib import Path
from typing import Any, Final

from furrowmap.core.readers.isoxml.xml import Element, parse_xml
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.file_names import leads_out
from furrowmap.core.runtime.memory import expect_disk
from furrowmap.core.runtime.write_errors import scratch_directory, writing_scratch

_WORLD_FILES: Final = (".tfw", ".tifw", ".tiffw", ".wld")
_MAX_WORLD_FILE: Final = 4096
_MASK: Final = ".msk"
_OWN_VALUES: Final = ".aux.xml"
_MAX_OWN_VALUES: Final = 1_000_000
_OF_DATASET: Final = ("SRS", "GeoTransform")
_OF_BAND: Final = ("Description", "UnitType", "NoDataValue", "Offset", "Scale")
ALONE: Final[dict[str, Any]] = {"GDAL_DISABLE_READDIR_ON_OPEN": "EMPTY_DIR", "GDAL_PAM_ENABLED": False}
"""Options of GDAL while a file is opened that is not to have neighbours."""
AMONG_COPIES: Final[dict[str, Any]] = {"GDAL_DISABLE_READDIR_ON_OPEN": False, "GDAL_PAM_ENABLED": True}


@contextmanager
def with_checked_neighbours(path: Path) -> Iterator[tuple[Path, dict[str, Any]]]:
    """The path by which GDAL may open a GeoTIFF, and its options meanwhile; a folder of its own where it needs one.

    Raises:
        ValueError: if a neighbour is a link to another folder, too large, or no mask.
    """
    beside = _neighbours(path)
    if not beside:
        yield path, ALONE
        return
    with scratch_directory() as folder:
        with writing_scratch():
            own = _beside_copies(path, beside, folder)
        yield own, AMONG_COPIES


def _beside_copies(path: Path, beside: dict[str, Path], folder: Path) -> Path:
    """The raster, by a link if possible, in a folder with copies of its neighbours."""
    own = folder / "raster.tif"
    try:
        own.symlink_to(path.absolute())
    except OSError:  # Windows keeps links to administrators
        expect_disk(path, folder, path.stat().st_size)
        shutil.copyfile(path, own)
    for end, part in beside.items():
        _copy(part, end, folder, path.absolute().parent)
    return own


def expect_no_links(raster: Any) -> None:
    """Raises ValueError for an open raster whose metadata name files that GDAL would open: overviews, places."""
    for domain in ("OVERVIEWS", "GEOLOCATION"):
        if raster.tags(ns=domain):
            raise ValueError(f"its metadata {domain} refer to another file")


def _neighbours(path: Path) -> dict[str, Path]:
    """The files beside a raster that belong to it, by the suffix that GDAL knows them by."""
    found = {end: Path(f"{path}{end}") for end in (_MASK, _OWN_VALUES)}
    stem = path.with_suffix("")
    for end in _WORLD_FILES:
        for name in (Path(f"{stem}{end}"), Path(f"{stem}{end.upper()}")):
            if ".tfw" not in found and name.is_file():
                found[".tfw"] = name
    return {end: part for end, part in found.items() if part.is_file()}


def _copy(part: Path, end: str, folder: Path, home: Path) -> None:
    if leads_out(part, home):
        raise ValueError(f"its file '{part.name}' is a link to another folder")
    size = part.stat().st_size
    if end == ".tfw":
        if size > _MAX_WORLD_FILE:
            raise ValueError(f"its file '{part.name}' has {size:,} bytes")
        shutil.copyfile(part, folder / "raster.tfw")
        return
    target = folder / f"raster.tif{end}"
    if end == _OWN_VALUES:
        if size > _MAX_OWN_VALUES:
            raise ValueError(f"its file '{part.name}' has {size:,} bytes")
        target.write_text(_own_values(part), encoding="utf-8")
        return
    _expect_mask(part)
    expect_disk(part, folder, size)
    shutil.copyfile(part, target)


def _expect_mask(path: Path) -> None:
    import rasterio
    from rasterio.errors import RasterioError

    try:
        with rasterio.Env(**ALONE):
            mask = rasterio.open(path, driver="GTiff")
        with mask:
            expect_no_links(mask)
    except RasterioError:
        raise ValueError(f"its mask '{path.name}' is no TIFF") from None


def _own_values(path: Path) -> str:
    """What a raster's `.aux.xml` says about its values and their place, written again without anything else."""
    try:
        root = parse_xml(path.read_bytes(), path.name)
    except InputError as error:
        raise ValueError(error.what) from None
    parts = [_written(one) for one in root.children if one.tag in _OF_DATASET]
    for band in root.all("PAMRasterBand"):
        values = "".join(_written(one) for one in band.children if one.tag in _OF_BAND)
        parts.append(f"<PAMRasterBand band='{escape(band.get('band'))}'>{values}</PAMRasterBand>")
    return f"<PAMDataset>{''.join(parts)}</PAMDataset>"


def _written(element: Element) -> str:
    attributes = "".join(f' {name}="{escape(value)}"' for name, value in element.attributes.items())
    return f"<{element.tag}{attributes}>{escape(element.text)}</{element.tag}>"
