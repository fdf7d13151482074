"""Layers as arrays into vector files by GDAL."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any, Final

import pyogrio
import pyogrio.raw

from furrowmap.core.runtime.write_errors import writing

pyogrio.set_gdal_config_options({"GDAL_PAM_ENABLED": False})


def write_arrays(target: Path | io.BytesIO, *arrays: Any, **options: Any) -> None:
    """Write a layer as pyogrio does; how layers are read is in :mod:`furrowmap.core.readers.ogr_layers`.

    Raises WriteError where that is not possible.
    """
    with writing(target) if isinstance(target, Path) else nullcontext():
        pyogrio.raw.write(target, *arrays, **options)


@contextmanager
def unflushed() -> Iterator[None]:
    """Within it, GDAL does not wait for the disk after each transaction: for a file that is flushed as a whole."""
    pyogrio.set_gdal_config_options({"OGR_SQLITE_SYNCHRONOUS": "OFF"})
    try:
        yield
    finally:
        pyogrio.set_gdal_config_options({"OGR_SQLITE_SYNCHRONOUS": None})


UTC_OFFSET: Final = 100
"""OGR's time zone code of UTC (0 unknown, 1 local, 100 UTC)."""
