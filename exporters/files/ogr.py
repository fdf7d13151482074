"""pyogrio without `.aux.xml` files: GDAL would write one with a GeoPackage's metadata after reading it.

Import pyogrio from here.
"""

from __future__ import annotations

import pyogrio
import pyogrio.raw

pyogrio.set_gdal_config_options({"GDAL_PAM_ENABLED": False})

__all__ = ["pyogrio"]
