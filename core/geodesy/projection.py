"""The map frame of a session and its projection, also in a stated frame and epoch such as "itrf2020@2026.4".

Official correction parameters of Japan (GSI .par files) shift between epochs or datums, on a mesh. Geospatial
Information Authority of Japan, semi-dynamic correction: the file of a fiscal year holds, on a mesh of 2.5' by 3.75',
the ground motion since the reference epoch. Added to coordinates at the epoch of the map, interpolated bilinearly, it
gives those at the current epoch. POS2JGD: steady crustal motion for a quarter of a year, for PPP and CLAS. The header
states fields, period and both datums, but not the sign. It follows from the motion: since the epoch of JGD2011 the
plates under Japan have moved south in every ITRF, except the Philippine Sea plate (Izu and Ogasawara islands).
"""

import datetime as dt
import math
import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any, Final

import jgdtrans
import numpy as np
from numpy.typing import NDArray
from pyproj import CRS, Proj, Transformer
from pyproj.crs import CompoundCRS, ProjectedCRS
from pyproj.database import CRSInfo, query_crs_info
from pyproj.enums import PJType
from pyproj.exceptions import CRSError, ProjError
from pyproj.transformer import TransformerGroup

from furrowmap.core.geodesy.crs_change import FrameChange, frame_change
from furrowmap.core.geodesy.gravity import radius_m
from furrowmap.core.geodesy.longitudes import middle_deg
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, RefusedError
from furrowmap.core.runtime.file_names import resolved
from furrowmap.core.runtime.file_signatures import binary_kind
from furrowmap.core.runtime.languages.texts import Text, Words, reason
from furrowmap.core.runtime.plain_reads import read_plain_bytes
from furrowmap.core.values.crs import crs_of_file, name_of
from furrowmap.core.values.session import AS_RECORDED, CURRENT_EPOCH, ELLIPSOIDAL, Crs

GEOIDS_OF_JAPAN: Final = {"GSIGEO2011": "JGD2011", "JPGEO2024": "JGD2024"}
"""Geoid models of Japan, and the realisation whose ellipsoidal heights each applies to."""
VERTICAL_CRS: Final = {"EGM84": "EPSG:5798", "EGM96": "EPSG:5773", "EGM2008": "EPSG:3855"}
"""Global geoid models and their vertical CRS."""
_JGD2011: Final = 6695
"""EPSG code of JGD2011 (vertical), the heights of GSIGEO2011."""
_JGD2024_NAME: Final = "JGD2024 (vertical) height"
_JGD2024: Final = (
    f'VERTCRS["{_JGD2024_NAME}",VDATUM["Japanese Geodetic Datum 2024 (vertical)"],CS[vertical,1],'
    'AXIS["gravity-related height (H)",up],LENGTHUNIT["metre",1]]'
)
"""For PROJ databases before EPSG 12.055 (April 2026)."""

GeoidHeight = Callable[[FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True)
class HeightSystem:
    """The height system of a map.

    Attributes:
        name: "ellipsoidal", or the geoid as the session names it.
        vertical: CRS of the heights; None for ellipsoidal ones.
        geoid_m: geoid heights (n,) at longitudes and latitudes (n,); nan outside the model.
    """

    name: str
    vertical: CRS | None
    source: str
    geoid_m: GeoidHeight

    def with_heights(self, flat: CRS) -> CRS:
        """The compound of a horizontal CRS and these heights; unchanged for ellipsoidal heights."""
        if self.vertical is None:
            return flat
        whole = CompoundCRS(f"{flat.name} + {self.vertical.name}", [flat, self.vertical])
        known = whole.to_epsg(min_confidence=100)
        return CRS.from_epsg(known) if known is not None else whole


ABOVE_ELLIPSOID: Final = HeightSystem(ELLIPSOIDAL, None, "the ellipsoid", lambda lon, _: np.zeros(len(lon)))


def height_system(name: str, base: CRS, grid: Path | None = None) -> HeightSystem:
    """The height system that a session requests.

    Args:
        name: "ellipsoidal", a key of `GEOIDS_OF_JAPAN` or `VERTICAL_CRS`, or any vertical CRS that PROJ reads.
        grid: geoid grid that PROJ reads (GeoTIFF, GTX), for other models than those of Japan and of PROJ.

    Raises:
        InputError: if there is no such model, or the grid is none.
        RefusedError: if PROJ lacks the grid, or has no transformation.
    """
    if name == ELLIPSOIDAL:
        return ABOVE_ELLIPSOID
    if name.upper() in GEOIDS_OF_JAPAN:
        return _japan(name.upper())
    try:
        vertical = crs_of_file(VERTICAL_CRS.get(name.upper(), name))
    except CRSError:
        vertical = None
    if vertical is None or not vertical.is_vertical or vertical.is_compound:
        raise InputError(
            "heights-unknown",
            name=name,
            ellipsoidal=ELLIPSOIDAL,
            japan=", ".join(GEOIDS_OF_JAPAN),
            vertical=", ".join(VERTICAL_CRS),
        )
    if grid is None and vertical == CRS.from_epsg(_JGD2011):
        return _japan("GSIGEO2011")
    geoid_m, source = _from_grid(grid) if grid is not None else _from_proj(name, vertical, base)
    return HeightSystem(name, vertical, source, geoid_m)


def _japan(name: str) -> HeightSystem:
    """GSI models; JPGEO2024 refers to Tokyo Bay everywhere, Hrefconv2024 is the difference on some islands."""
    import japan_geoid

    if name == "GSIGEO2011":
        model, vertical = japan_geoid.load_embedded_gsigeo2011(), CRS.from_epsg(_JGD2011)
        source = "GSIGEO2011 of the Geospatial Information Authority of Japan"
    else:
        known = query_crs_info(auth_name="EPSG", pj_types=PJType.VERTICAL_CRS)
        code = next((info.code for info in known if info.name == _JGD2024_NAME and not info.deprecated), None)
        vertical = CRS.from_wkt(_JGD2024) if code is None else CRS.from_authority("EPSG", code)
        model = japan_geoid.load_embedded_jpgeo2024_hrefconv2024()
        source = "JPGEO2024 with Hrefconv2024 of the Geospatial Information Authority of Japan"
    return HeightSystem(name, vertical, source, lambda lon, lat: np.asarray(model.get_heights(lon, lat), np.float64))


def _from_grid(grid: Path) -> tuple[GeoidHeight, str]:
    """A grid of geoid heights, interpolated bilinearly by PROJ."""
    place = resolved(grid).as_posix()
    if any(sign in place for sign in ',"'):
        raise InputError("geoid-unreadable", grid=grid)
    try:
        shift = Transformer.from_pipeline(
            "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
            f'+step +proj=vgridshift +grids="{place}" +multiplier=1 +step +proj=unitconvert +xy_in=rad +xy_out=deg'
        )
    except ProjError as error:
        raise InputError("geoid-unreadable.unreadable-by-proj", grid=grid, error=error) from None
    return _geoid_heights(shift, 1.0), f"the grid {grid.name}"


def _from_proj(name: str, vertical: CRS, base: CRS) -> tuple[GeoidHeight, str]:
    """PROJ's transformation from ellipsoidal heights, never a ballpark one."""
    whole = CompoundCRS(f"{base.name} + {vertical.name}", [base.to_2d(), vertical])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of missing grids, of which more is said below
        group = TransformerGroup(base.to_3d(), whole, always_xy=True, allow_ballpark=False)
    if group.transformers:
        best = group.transformers[0]
        return _geoid_heights(best, -1.0), best.description
    needed = [grid.short_name for operation in group.unavailable_operations for grid in operation.grids]
    if needed:
        raise RefusedError("geoid-grid-missing", name=name, needed=needed[0])
    raise RefusedError("geoid-unknown", base=base.name, vertical=vertical.name)


def _geoid_heights(change: Transformer, sign: float) -> GeoidHeight:
    """Geoid heights as the transformation of points on the ellipsoid."""

    def geoid_m(lon_deg: FloatArray, lat_deg: FloatArray) -> FloatArray:
        moved: Any = change.transform(lon_deg, lat_deg, np.zeros(len(lon_deg)))
        height = sign * np.asarray(moved[2], np.float64)
        return np.where(np.isfinite(height), height, np.nan)

    return geoid_m


YEAR: Final = "SemiDynaEXE"
QUARTER: Final = "POS2JGD"
BETWEEN_EPOCHS: Final = (YEAR, QUARTER)
"""Formats between the epoch of the map and the current one of a fiscal year, or of a quarter."""
_SOUTH_NORTH_DEG: Final = (0.0, 66.6)
_WEST_EAST_DEG: Final = (100.0, 180.0)
"""Where mesh codes are defined (JIS X 0410)."""
MAX_PARAMETER_BYTES: Final = 50_000_000
"""The largest official file (TKY2JGD, 390,000 nodes) has 11 MB."""
MAX_CORRECTION: Final = (1.0 / 60.0, 1.0 / 60.0, 100.0)
"""Degrees and metres of a change of datum: a minute of arc and 100 m."""
_ROW: Final = re.compile(r"[0-9]{8}(\s+-?[0-9]+\.[0-9]{5}){1,3}\s*|\s*")
"""The columns are of fixed width: with a digit lost, all behind it would be read from the wrong place."""
_INVERSE_ROUNDS: Final = 6
"""Iterations of the inverse: parameters vary by less than 1e-3, so each adds three digits."""
_JAPAN_TIME: Final = dt.timezone(dt.timedelta(hours=9))

_POS2JGD_TITLE: Final = "GRIDDED CORRECTION PARAMETER FOR POS2JGD"
_POS2JGD_DATUMS: Final = ("JGD2011", "JGD2024")
_POS2JGD_FIELDS: Final = "'4 MeshCode dB dL dH'"
_IZU_DEG: Final = 138.0, 35.0
"""East of this longitude and south of this latitude the islands move north-west."""


@dataclass(frozen=True)
class ParameterFile:
    """Corrections on a mesh.

    Attributes:
        format: as named by jgdtrans, or "POS2JGD".
        days: first and last day (Japan) of validity of a file between epochs; None where unstated.
        corrections: (m, 3) forward, longitude and latitude in degrees, height in metres.
        from_map: whether forward is from the epoch of the map to the current one.
    """

    name: str
    format: str
    days: tuple[dt.date, dt.date] | None
    codes: NDArray[np.int64]
    corrections: FloatArray
    from_map: bool = True

    def to_map(self, lon_deg: FloatArray, lat_deg: FloatArray, height_m: FloatArray) -> tuple[FloatArray, ...]:
        """(longitude, latitude, height), each (n,), in the epoch of the map.

        InputError if a position is not covered.
        """
        return (self.backward if self.from_map else self.forward)(lon_deg, lat_deg, height_m)

    def forward(self, lon_deg: FloatArray, lat_deg: FloatArray, height_m: FloatArray) -> tuple[FloatArray, ...]:
        """Corrected (longitude, latitude, height), each (n,); InputError if the file does not cover a position."""
        moved = self._at(lon_deg, lat_deg)
        return lon_deg + moved[:, 0], lat_deg + moved[:, 1], height_m + moved[:, 2]

    def backward(self, lon_deg: FloatArray, lat_deg: FloatArray, height_m: FloatArray) -> tuple[FloatArray, ...]:
        """The inverse of :meth:`forward` to 1e-13°, by fixed-point iteration; InputError as there."""
        moved = np.median(self.corrections, axis=0)[None, :]
        for _ in range(_INVERSE_ROUNDS):
            moved = self._at(lon_deg - moved[:, 0], lat_deg - moved[:, 1])
        return lon_deg - moved[:, 0], lat_deg - moved[:, 1], height_m - moved[:, 2]

    @cached_property
    def holds_s(self) -> tuple[float, float] | None:
        """Period of validity (UTC) of a file between epochs; None where unknown."""
        if self.days is None:
            return None
        begin, end = (dt.datetime.combine(day, dt.time(), _JAPAN_TIME) for day in self.days)
        return begin.timestamp(), (end + dt.timedelta(days=1)).timestamp()

    def _at(self, lon_deg: FloatArray, lat_deg: FloatArray) -> FloatArray:
        """Corrections (n, 3) at places (n,)."""
        unit = 5 if self.format in BETWEEN_EPOCHS else 1
        inside = (lat_deg >= _SOUTH_NORTH_DEG[0]) & (lat_deg < _SOUTH_NORTH_DEG[1])
        inside &= (lon_deg >= _WEST_EAST_DEG[0]) & (lon_deg < _WEST_EAST_DEG[1])
        if not inside.all():
            raise self._outside(lon_deg, lat_deg, ~inside)
        # Third-order cells of JIS X 0410 are 30" by 45"; those of epochs five times as large.
        row = lat_deg * (120.0 / unit)
        column = (lon_deg - 100.0) * (80.0 / unit)
        south = np.floor(row)
        west = np.floor(column)
        up = (row - south)[:, None]
        right = (column - west)[:, None]
        out = np.zeros((len(lon_deg), 3))
        for north in (0, 1):
            for east in (0, 1):
                share = (up if north else 1.0 - up) * (right if east else 1.0 - right)
                y = unit * (south.astype(np.int64) + north)
                x = unit * (west.astype(np.int64) + east)
                code = (y // 80) * 1_000_000 + (x // 80) * 10_000
                code += (y % 80 // 10) * 1_000 + (x % 80 // 10) * 100 + (y % 10) * 10 + x % 10
                index = np.minimum(np.searchsorted(self.codes, code), len(self.codes) - 1)
                known = self.codes[index] == code
                missing = ~known & (share[:, 0] > 0.0)
                if missing.any():
                    raise self._outside(lon_deg, lat_deg, missing)
                out += share * np.where(known[:, None], self.corrections[index], 0.0)
        return out

    def _outside(self, lon_deg: FloatArray, lat_deg: FloatArray, where: NDArray[np.bool_]) -> InputError:
        k = int(np.flatnonzero(where)[0])
        return InputError(
            "parameters-outside",
            name=self.name,
            lat_deg=lat_deg[k],
            lon_deg=lon_deg[k],
            where=int(where.sum()),
            lon_deg_count=len(lon_deg),
        )


def read_parameters(path: Path) -> ParameterFile:
    """The parameters in a .par file, by its layout; InputError if it is no such file, or is damaged."""
    try:
        if path.stat().st_size > MAX_PARAMETER_BYTES:
            raise _unreadable(path, Text("it has {size:,} bytes", size=path.stat().st_size))
        content = read_plain_bytes(path)
    except OSError as error:
        raise _unreadable(path, error.strerror or Text("cannot be read")) from None
    if (binary := binary_kind(content)) is not None:
        raise _unreadable(path, Text("it is {kind}, not text", kind=binary))
    text = content.decode("cp932", "replace")
    lines = text.splitlines()
    if lines and lines[0].strip() == _POS2JGD_TITLE:
        return _read_pos2jgd(path, lines)
    head = next((k for k, line in enumerate(lines) if re.match(r"\d{8}\s", line)), None)
    if head is None:
        raise _unreadable(path, Text("it has no mesh codes after a header of 2 or 16 lines"))
    damaged = next((k for k, line in enumerate(lines[head:], start=1 + head) if not _ROW.fullmatch(line)), 0)
    if damaged:
        raise _unreadable(
            path,
            Text(
                "line {line} ({text!r}) is not a mesh code and parameters", line=damaged, text=lines[damaged - 1][:60]
            ),
        )
    kind = _kind(lines, head)
    if kind is None:
        raise _unreadable(path, Text("it has no mesh codes after a header of 2 or 16 lines"))
    try:
        found = jgdtrans.par.loads(text.rstrip(), format=kind).parameter
    except Exception as error:  # noqa: BLE001 damage ends in errors of several families
        raise _unreadable(path, reason(error)) from None
    codes = np.array(sorted(found), np.int64)
    rows = np.array([(p.longitude / 3600.0, p.latitude / 3600.0, p.altitude) for p in map(found.__getitem__, codes)])
    _check_corrections(path, rows)
    year = re.search(r"SemiDyna(20\d\d)", f"{path.name} {' '.join(lines[:head])}", re.IGNORECASE)
    days = (dt.date(int(year[1]), 4, 1), dt.date(int(year[1]) + 1, 3, 31)) if year and kind == YEAR else None
    return ParameterFile(path.name, kind, days, codes, rows)


def _read_pos2jgd(path: Path, lines: list[str]) -> ParameterFile:
    head = {key.strip(): value.strip() for key, _, value in (line.partition("=") for line in lines if "=" in line)}
    if head.get("DATA_FIELDS", _POS2JGD_FIELDS) != _POS2JGD_FIELDS:
        raise _unreadable(
            path, Text("its fields are {stated}, not {wanted}", stated=head["DATA_FIELDS"], wanted=_POS2JGD_FIELDS)
        )
    if head.get("NATIONAL_DATUM") not in _POS2JGD_DATUMS:
        raise _unreadable(
            path, Text("its NATIONAL_DATUM is {datum:{datum}|not stated}", datum=head.get("NATIONAL_DATUM"))
        )
    days = []
    for key in ("START_OF_APPLICABLE_PERIOD", "END_OF_APPLICABLE_PERIOD"):
        try:
            days.append(dt.datetime.strptime(head.get(key, ""), "%Y%m%d").date())  # noqa: DTZ007 - a day of a calendar
        except ValueError:
            raise _unreadable(path, Text("its {key} is not a date such as 20230601", key=key)) from None
    rows = [line.split() for line in lines if line[:8].isdigit()]
    if not rows or any(len(row) != 4 or len(row[0]) != 8 for row in rows):
        raise _unreadable(path, Text("not every line after its header has a mesh code and three numbers"))
    try:
        values = np.array([[float(value) for value in row[1:]] for row in rows])
        codes = np.array([int(row[0]) for row in rows], np.int64)
    except ValueError as error:
        raise _unreadable(path, reason(error)) from None
    north_deg = codes // 1_000_000 / 1.5
    east_deg = 100.0 + codes // 10_000 % 100
    on_islands = (north_deg < _IZU_DEG[1]) & (east_deg >= _IZU_DEG[0])
    northward = values[~on_islands & (values[:, 0] != 0.0), 0]
    if not len(northward) or max((northward < 0.0).mean(), (northward > 0.0).mean()) < 0.9:
        why = "the sign of its numbers cannot be determined without nodes on the main islands of Japan"
        raise _unreadable(path, why)
    order = np.argsort(codes)
    corrections = values[order][:, [1, 0, 2]] / (3600.0, 3600.0, 1.0)
    _check_corrections(path, corrections)
    from_map = bool(np.median(northward) < 0.0)
    return ParameterFile(path.name, QUARTER, (days[0], days[1]), codes[order], corrections, from_map)


def _check_corrections(path: Path, rows: FloatArray) -> None:
    """Refuse corrections (n, 3) that are not numbers of the size of a change of datum."""
    if not len(rows) or not (np.abs(rows) <= MAX_CORRECTION).all():
        raise _unreadable(path, Text("some of its parameters are not numbers, or larger than any"))


def _kind(lines: list[str], head: int) -> str | None:
    """The format, from the length of the header, the columns and the mesh; None if unknown."""
    codes = [line[:8] for line in lines[head:] if line.strip()]
    if head == 2:
        return "TKY2JGD"
    if head != 16:
        return None
    columns = [word.lower()[:2] for word in lines[15].split()[1:]]
    if columns == ["db", "dl"]:
        return "PatchJGD"
    if columns == ["dh"]:
        return "PatchJGD_H"
    return YEAR if all(code[6] in "05" and code[7] in "05" for code in codes) else "PatchJGD_HV"


def _unreadable(path: Path, why: Words) -> InputError:
    return InputError("parameters-unreadable", path=path, why=why)


FIRST_EPOCH: Final = 1984.0
LAST_EPOCH: Final = 2100.0
"""Years outside which no satellite positions exist."""


@dataclass(frozen=True)
class StatedFrame:
    """A terrestrial frame, a geographic CRS, and the epoch of coordinates in it, a decimal year."""

    frame: CRS
    epoch: float

    @property
    def name(self) -> str:
        """Such as "ITRF2020 @ 2026.4"."""
        return f"{self.frame.name} @ {self.epoch:.10g}"

    def map_crs(self, flat: CRS) -> CRS:
        """The projection of a map CRS on this frame, with frame and epoch in its name."""
        conversion = flat.coordinate_operation
        assert conversion is not None
        # As a plain CRS: a ProjectedCRS of pyproj has no way to two dimensions.
        return CRS(ProjectedCRS(conversion, f"{self.name} / {conversion.name}", geodetic_crs=self.frame))


def stated_frame(text: str) -> StatedFrame | None:
    """The frame and epoch in a session's `crs.coordinates`; None where it has another form than `frame@epoch`.

    InputError if PROJ knows no such frame, or the epoch is out of range.
    """
    found = re.fullmatch(r"\s*(.+?)\s*@\s*(-?\d+(?:\.\d+)?)\s*", text)
    if found is None:
        return None
    frame = _frame_of(found[1])
    if frame is None:
        raise InputError("frame-unknown", found=found[1])
    epoch = float(found[2])
    if not FIRST_EPOCH <= epoch <= LAST_EPOCH:
        raise InputError(
            "epoch-out-of-range.stated-epoch", found=found[2], first_epoch=FIRST_EPOCH, last_epoch=LAST_EPOCH
        )
    return StatedFrame(frame, epoch)


def _frame_of(name: str) -> CRS | None:
    """The geographic CRS that EPSG names so; None for none."""
    info = _frames().get(name.casefold())
    return CRS.from_authority(info.auth_name, info.code) if info is not None else None


@cache
def _frames() -> dict[str, CRSInfo]:
    """The geographic CRS that EPSG names, by their names in lower case."""
    found = query_crs_info(auth_name="EPSG", pj_types=PJType.GEOGRAPHIC_2D_CRS)
    return {info.name.casefold(): info for info in found if not info.deprecated}


MAX_SCALE_ERROR: Final = 1e-3
"""Largest scale error of a map: a metre in a kilometre, two and a half times that of UTM."""
AREA_MARGIN_DEG: Final = 1.2
"""Margin around the area of use of a CRS, so that fields at a zone border stay in one zone: the maps of Denmark and
Norway use UTM zone 32 from 4.9° to 12.7° east, its area of use is 6° to 12°."""


def is_in_area(bounds_deg: tuple[float, float, float, float], lon_deg: float, lat_deg: float) -> bool:
    """Whether a place is in the area of use of a CRS or within its margin.

    Args:
        bounds_deg: west, south, east and north of the area, which may cross the antimeridian.
    """
    west, south, east, north = bounds_deg
    beyond_west_deg = (lon_deg - west) % 360.0
    width_deg = (east - west) % 360.0 or 360.0
    in_longitude = beyond_west_deg <= width_deg + AREA_MARGIN_DEG or beyond_west_deg >= 360.0 - AREA_MARGIN_DEG
    return in_longitude and south - AREA_MARGIN_DEG <= lat_deg <= north + AREA_MARGIN_DEG


@dataclass(frozen=True)
class MapFrame:
    """The projected CRS of a session, easting first, with the transformations that lead to it.

    Longitudes and latitudes are in the geographic base of the CRS, so :meth:`project` is the map projection alone;
    :mod:`furrowmap.core.geodesy.coordinates` applies the steps before.

    Attributes:
        parameters: from the current epoch to that of the map; None where positions are used as recorded.
        stated: stated frame and epoch of the coordinates, then the base of `crs`.
        named: the CRS that the session names where `crs` is its projection on a stated frame.
        unused: vertical part of the CRS of the session that `heights` does not request.
        change: from the frame of the positions, at their own time, to that of the map; None where it is the same.
    """

    crs: CRS
    parameters: ParameterFile | None = None
    stated: StatedFrame | None = None
    heights: HeightSystem = ABOVE_ELLIPSOID
    named: CRS | None = None
    unused: CRS | None = None
    change: FrameChange | None = None

    @property
    def as_recorded(self) -> bool:
        """Whether longitudes and latitudes are used as recorded."""
        return self.parameters is None and self.change is None

    @cached_property
    def _transformer(self) -> Transformer:
        base = self.crs.geodetic_crs
        assert base is not None
        return Transformer.from_crs(base.to_2d(), self.crs, always_xy=True)

    @cached_property
    def whole_crs(self) -> CRS:
        """The compound with the heights above a geoid, if any."""
        return self.heights.with_heights(self.crs)

    @property
    def sentences(self) -> tuple[Text, ...]:
        """What is to be known besides the CRS; none where positions are used as recorded."""
        said = []
        if self.parameters is not None:
            file = self.parameters.name
            said.append(Text("Recorded positions are transformed to the epoch of the map with {file}.", file=file))
        if self.change is not None:
            name = self.change.name
            said.append(Text("Recorded positions are transformed to the frame of the map with {change}.", change=name))
        if self.heights.vertical is not None:
            source = self.heights.source
            said.append(Text("Heights are above {heights} ({source}).", heights=self.heights.name, source=source))
        if self.stated is not None:
            said.append(Text("Coordinates are those of {frame}.", frame=self.stated.name))
        return tuple(said)

    @property
    def words(self) -> str:
        """The sentences for the metadata of products."""
        return " ".join(map(str, self.sentences))

    @property
    def wkt(self) -> str:
        """WKT 2 of the whole CRS, with the coordinate epoch where stated (ISO 19162, 15.3)."""
        text = self.whole_crs.to_wkt()
        return f"COORDINATEMETADATA[{text},EPOCH[{self.stated.epoch:.10g}]]" if self.stated is not None else text

    @property
    def name(self) -> str:
        """Code such as ``EPSG:6677``, or the name of a CRS without a code."""
        return name_of(self.crs)

    def project(self, lon_deg: FloatArray, lat_deg: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(easting, northing) in metres, each (n,), of longitudes and latitudes (n,) in degrees.

        RefusedError if the site lies outside the area of use of the CRS, or its scale error there is too large.
        """
        if len(lon_deg):
            lon, lat = middle_deg(lon_deg, lat_deg)
            area = (self.named or self.crs).area_of_use
            if area is not None and not is_in_area(area.bounds, lon, lat):
                raise RefusedError(
                    "crs-outside-area",
                    lat=lat,
                    lon=lon,
                    name=self.name,
                    south=area.south,
                    north=area.north,
                    west=area.west,
                    east=area.east,
                )
            scale = self.scale(lon, lat)
            if abs(scale - 1.0) > MAX_SCALE_ERROR:
                raise RefusedError("crs-scale", name=self.name, scale=scale)
        e, n = self._transformer.transform(lon_deg, lat_deg)
        return np.asarray(e, np.float64), np.asarray(n, np.float64)

    def to_lon_lat(self, e_m: FloatArray, n_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(longitude, latitude) in degrees, each (n,), of map coordinates: inverse of :meth:`project`."""
        lon, lat = self._transformer.transform(e_m, n_m, direction="INVERSE")
        return np.asarray(lon, np.float64), np.asarray(lat, np.float64)

    def convergence_deg(self, lon_deg: FloatArray, lat_deg: FloatArray) -> FloatArray:
        """Meridian convergence (n,): true heading − grid heading."""
        factors: Any = Proj(self.crs).get_factors(lon_deg, lat_deg)
        return np.asarray(factors.meridian_convergence, np.float64)

    def scale(self, lon_deg: float, lat_deg: float) -> float:
        """Scale at a site: map distance over ellipsoidal distance, mean of meridian and parallel."""
        return scale_of(self.crs, lon_deg, lat_deg)

    def ground_scale(self, lon_deg: float, lat_deg: float, height_m: float) -> float:
        """Map distance over distance on the ground at an ellipsoidal height."""
        radius = radius_m(lat_deg)
        return self.scale(lon_deg, lat_deg) * radius / (radius + height_m)


def scale_of(crs: CRS, lon_deg: float, lat_deg: float) -> float:
    """Scale of a projection at a place: map distance over ellipsoidal distance, mean of meridian and parallel."""
    factors: Any = Proj(crs).get_factors(lon_deg, lat_deg)
    return 0.5 * float(factors.meridional_scale + factors.parallel_scale)


def scale_at(crs: CRS, e_m: float, n_m: float) -> float:
    """Metres of the map per metre on the ellipsoid at a place of the map: 0.9996 to 1.001 in UTM; 1 where unknown."""
    flat = crs.to_2d()
    scale = scale_of(flat, *Proj(flat)(e_m, n_m, inverse=True))
    return scale if math.isfinite(scale) else 1.0


def map_frame(crs: Crs, parameters_file: Path | None = None, geoid_grid: Path | None = None) -> MapFrame:
    """The map frame of a session, with the files that its table `[crs]` names.

    InputError if the CRS, the heights or the coordinates are unknown, the CRS is not projected or not in metres, or a
    file is missing or of another kind; RefusedError if there is no exact transformation.
    """
    try:
        whole = crs_of_file(crs.map)
    except CRSError as error:
        raise InputError("crs-unknown.projected", map=crs.map, error=error) from None
    flat, *vertical = whole.sub_crs_list if whole.is_compound else [whole.to_2d()]
    units = {axis.unit_name for axis in flat.axis_info}
    if not flat.is_projected or units != {"metre"}:
        raise InputError(
            "crs-not-projected.projected", map=crs.map, whole=whole.name, units=" and ".join(sorted(units))
        )
    unused = vertical[0] if vertical and crs.heights == ELLIPSOIDAL else None
    parameters = None
    if crs.coordinates == CURRENT_EPOCH:
        base = flat.geodetic_crs
        if base is None or not base.name.startswith(("JGD2011", "JGD2024")):
            raise RefusedError("epoch-map", map=crs.map, flat=flat.name)
        if parameters_file is None:
            raise RefusedError("parameters-missing", current_epoch=CURRENT_EPOCH)
        parameters = read_parameters(parameters_file)
        if parameters.format not in BETWEEN_EPOCHS:
            raise InputError("parameters-kind", found=parameters.name, format=parameters.format)
    stated = stated_frame(crs.coordinates)
    known = stated is not None or crs.coordinates in (AS_RECORDED, CURRENT_EPOCH)
    change = None if known else frame_change(crs.coordinates, flat, _frame_of)
    if not known and change is None:
        raise InputError(
            "crs-coordinates", coordinates=crs.coordinates, as_recorded=AS_RECORDED, current_epoch=CURRENT_EPOCH
        )
    base = (stated.frame if stated is not None else flat.geodetic_crs) or flat
    heights = height_system(crs.heights, base, geoid_grid)
    if stated is not None:
        return MapFrame(stated.map_crs(flat), None, stated, heights, flat, unused)
    return MapFrame(flat, parameters, None, heights, None, unused, change)
