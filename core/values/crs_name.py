"""Names of a CRS for users."""

from __future__ import annotations

from pyproj import CRS


def name_of(crs: CRS) -> str:
    """The code, such as ``EPSG:6677``, or the CRS's name if it has none."""
    authority = crs.to_authority()
    return ":".join(authority) if authority else crs.name


def full_name_of(crs: CRS) -> str:
    """Code and name, such as ``EPSG:6677 (JGD2011 / Japan Plane Rectangular CS IX)``; without a code only the name."""
    code = name_of(crs)
    return crs.name if code == crs.name else f"{code} ({crs.name})"
