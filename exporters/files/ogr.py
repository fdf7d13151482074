"""pyogrio, kept from writing a file beside a GeoPackage that it only reads.

GDAL takes metadata that it has read from a GeoPackage for its own, and writes them once more into `.aux.xml` when it
closes the file. Import pyogrio from here.
"""

from __future__ import annotations

import pyogrio
import pyogrio.raw

pyogrio.set_gdal_config_options({"GDAL_PAM_ENABLED": False})

__all__ = ["pyogrio"]
