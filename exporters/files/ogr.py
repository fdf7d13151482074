"""pyogrio without `.aux.xml` files: GDAL would write one with a GeoPackage's metadata after reading it.

Import pyogrio from here.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import pyogrio
import pyogrio.raw

pyogrio.set_gdal_config_options({"GDAL_PAM_ENABLED": False})

__all__ = ["pyogrio", "unflushed"]


@contextmanager
def unflushed() -> Iterator[None]:
    """Within it, GDAL does not wait for the disk after each transaction: for a file that is flushed as a whole."""
    pyogrio.set_gdal_config_options({"OGR_SQLITE_SYNCHRONOUS": "OFF"})
    try:
        yield
    finally:
        pyogrio.set_gdal_config_options({"OGR_SQLITE_SYNCHRONOUS": None})
