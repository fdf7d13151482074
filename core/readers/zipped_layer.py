"""The one layer of a zip archive: a zipped Shapefile, or the KML of a KMZ."""

from __future__ import annotations

import zipfile
from pathlib import Path, PurePosixPath
from typing import Final

from furrowmap.core.runtime.limits import expect_disk, expect_growth, expect_memory

ZIP: Final = b"PK\3\4"
_SHAPEFILE_PARTS: Final = (".shp", ".shx", ".dbf", ".prj", ".cpg")
_MAINS: Final = (".shp", ".kml")
MAX_FILES: Final = 1000


def unpacked_layer(path: Path, folder: Path) -> Path:
    """Unpack the only Shapefile or KML of an archive into a folder, under names of its own.

    Raises:
        ValueError: if the archive has no or several layers.
        RefusedError: if it unpacks to far more than its size.
        Exception: of any family, if it is damaged.
    """
    with zipfile.ZipFile(path) as archive:
        files = archive.infolist()
        mains = [
            file
            for file in files
            if PurePosixPath(file.filename).suffix.lower() in _MAINS and "__MACOSX" not in file.filename
        ]
        if len(files) > MAX_FILES:
            raise ValueError(f"it has {len(files):,} files")
        if len(mains) != 1:
            names = ", ".join(file.filename for file in mains[:3])
            raise ValueError(f"it holds {len(mains)} Shapefiles and KML files{': ' + names if names else ''}, not one")
        stem = PurePosixPath(mains[0].filename).with_suffix("").as_posix().casefold()
        parts = [file for file in files if PurePosixPath(file.filename).with_suffix("").as_posix().casefold() == stem]
        wanted = [file for file in parts if PurePosixPath(file.filename).suffix.lower() in (*_SHAPEFILE_PARTS, ".kml")]
        whole = sum(file.file_size for file in wanted)
        expect_growth(path, path.stat().st_size, whole)
        expect_memory(path, max(file.file_size for file in wanted))
        expect_disk(path, folder, whole)
        for file in wanted:
            with archive.open(file) as stream:
                data = stream.read(file.file_size + 1)
            (folder / f"layer{PurePosixPath(file.filename).suffix.lower()}").write_bytes(data)
        return folder / f"layer{PurePosixPath(mains[0].filename).suffix.lower()}"
