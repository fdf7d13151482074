"""How a CRS is called in words for users."""

from __future__ import annotations

from pyproj import CRS


def name_of(crs: CRS) -> str:
    """Such as ``EPSG:6677``, or the CRS's own name where it has no code."""
    authority = crs.to_authority()
    return ":".join(authority) if authority else crs.name


def full_name_of(crs: CRS) -> str:
    """Code and name, such as ``EPSG:6677 (JGD2011 / Japan Plane Rectangular CS IX)``; the name alone without a code."""
    code = name_of(crs)
    return crs.name if code == crs.name else f"{code} ({crs.name})"
