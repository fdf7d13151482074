"""Parcels on the map, gross and net: polygons with identifiers from files, and the plots of a trial as a grid."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS

from furrowmap.core.geodesy.projection import scale_at
from furrowmap.core.readers.areas.area import polygons_on_map
from furrowmap.core.readers.areas.polygons import IDS
from furrowmap.core.readers.vector_file import VECTOR_FORMATS
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text, Words
from furrowmap.core.values.parcel import Attribute, Parcel
from furrowmap.core.values.plot_grid import PlotGrid

MAX_PLOTS: Final = 100_000
MAX_MISFIT_M: Final = 0.10
"""Corners that fit the sizes this well raise no notice."""
SHORTEST_PLOT_M: Final = 0.05
"""Shorter ones follow from corners that are the same, or that are no metres."""


def plot_grid(
    grid: PlotGrid,
    corner_m: FloatArray,
    end_m: FloatArray | None = None,
    azimuth_deg: float | None = None,
    scale: float = 1.0,
) -> tuple[tuple[Parcel, ...], list[Notice]]:
    """The plots in the order of their numbers, and how well the corners fit the sizes.

    Args:
        grid: sizes, in metres on the ground, and numbering.
        corner_m: (2,) easting and northing of the outer corner of the first plot, where the base line begins.
        end_m: (2,) the other end of the base line: the outer corner of the last plot of the first row.
        azimuth_deg: instead: direction of the base line, clockwise from grid north.
        scale: of the map: metres of it per metre on the ground.

    Raises:
        InputError: if direction or length are stated neither way or both ways, or the grid is too large.
    """
    if (end_m is None) == (azimuth_deg is None):
        fault = Text("The direction of the base line is stated {twice:twice|nowhere}", twice=end_m is not None)
        raise InputError("plots-grid", fault=fault)
    if end_m is None and grid.length_m is None:
        fault = Text("The length of a plot is not stated, and without the end of the base line it does not follow")
        raise InputError("plots-grid", fault=fault)
    if grid.by_block and grid.block is None:
        raise InputError("plots-grid", fault=Text("Numbers begin anew in each block, but there are no blocks"))
    if grid.rows * grid.columns > MAX_PLOTS:
        count = grid.rows * grid.columns
        fault = Text("The grid has {count:,} plots, more than {largest:,}", count=count, largest=MAX_PLOTS)
        raise InputError("plots-grid", fault=fault)
    gaps_m = (grid.columns - 1) * grid.alley_m
    notices: list[Notice] = []
    if end_m is not None:
        base = end_m - corner_m
        measured = float(np.hypot(*base)) / scale
        along = base / max(scale * measured, 1e-12)
        length_m = grid.length_m if grid.length_m is not None else (measured - gaps_m) / grid.columns
        if length_m < SHORTEST_PLOT_M:
            fault = Text(
                "The corners are {measured_m:.2f} m apart, and the alleys alone take {gaps_m:.2f} m",
                measured_m=measured,
                gaps_m=gaps_m,
            )
            raise InputError("plots-grid", fault=fault)
        needed = grid.columns * length_m + gaps_m
        if abs(needed - measured) > MAX_MISFIT_M:
            notices.append(Notice("plots-baseline", measured_m=measured, needed_m=needed))
    else:
        assert azimuth_deg is not None
        assert grid.length_m is not None
        turn = np.radians(azimuth_deg)
        along = np.array([np.sin(turn), np.cos(turn)])
        length_m = grid.length_m
    across = np.array([-along[1], along[0]]) * (1.0 if grid.side == "left" else -1.0)
    length = scale * length_m * along
    width = scale * grid.width_m * across
    steps = (0.0 * along, length, length + width, width)
    counts: dict[int, int] = {}
    plots = []
    numbers_a_block = max(100, 10 ** len(str(grid.rows * grid.columns)))
    for k, (row, column) in enumerate(_order(grid)):
        start = corner_m + scale * (
            column * (length_m + grid.alley_m) * along + row * (grid.width_m + grid.path_m) * across
        )
        shape = shapely.Polygon([start + step for step in steps])
        block = _block(grid, row, column)
        counts[block] = counts.get(block, 0) + 1
        number = block * numbers_a_block + counts[block] - 1 + grid.first if grid.by_block else k + grid.first
        place = {"row": float(row + 1), "column": float(column + 1)}
        plots.append(Parcel(str(number), shape, shape, str(block) if block else None, place))
    return tuple(plots), notices


def _order(grid: PlotGrid) -> list[tuple[int, int]]:
    """(row, column) of the plots in the order of their numbers, block by block where numbers begin anew."""
    runs, steps = (grid.rows, grid.columns) if grid.along == "rows" else (grid.columns, grid.rows)
    order: list[tuple[int, int]] = []
    for run in range(runs):
        forth = range(steps)[:: -1 if grid.serpentine and run % 2 == 1 else 1]
        order += [(run, step) if grid.along == "rows" else (step, run) for step in forth]
    if grid.by_block:
        order.sort(key=lambda place: _block(grid, *place))  # stable: the order within a block stays
    return order


def _block(grid: PlotGrid, row: int, column: int) -> int:
    """Number of a block, from 1; 0 without blocks."""
    if grid.block is None:
        return 0
    return (row if grid.block == "rows" else column) // grid.block_size + 1


BLOCK_COLUMNS: Final = (
    *("block", "replicate", "replication", "rep", "blk", "wiederholung", "wdh", "gentagelse", "blok", "blocknr"),
    *("反復", "ブロック", "bloc", "bloque", "répétition", "repetition", "replikat"),
)
"""Accepted names of the column of blocks, in any case."""
MIN_PARCEL_M2: Final = 1e-4


@dataclass(frozen=True)
class _GrossParcel:
    """A polygon of a file on the map."""

    id: str
    shape: shapely.Polygon
    attributes: Mapping[str, Attribute]


def read_parcels(
    path: Path,
    target: CRS,
    net_inset_m: tuple[float, float] = (0.0, 0.0),
    net: Path | None = None,
) -> tuple[tuple[Parcel, ...], list[Notice]]:
    """The parcels of a vector file, or of a CSV with one row per corner, in map coordinates.

    Notices say what was decided where a file leaves it open.

    Coordinates in another CRS than `target` are projected; no datum is changed. Identifiers are those of the first
    column named id, parcel, plot or name, else 1, 2, … in the order of the file; blocks those of a column block or rep.
    Raises InputError if a file cannot be read or has no polygon, a polygon is invalid, identifiers repeat or differ
    between the files, the parcels lie outside the domain of `target`, or are smaller than the inset.

    Args:
        path: GeoJSON, GeoPackage, FlatGeobuf, Shapefile (also zipped), KML, or CSV of corners.
        target: projected CRS of the map.
        net_inset_m: width of the strip between gross and net parcel off each end, and off each side, in metres on the
            ground.
        net: file with the net parcels, under the same identifiers, instead of an inset.
    """
    gross, notices = _read_polygons(path, target)
    nets: dict[str, shapely.Polygon] = {}
    if net is not None:
        inner_parcels, of_net = _read_polygons(net, target)
        nets = {found.id: found.shape for found in inner_parcels}
        notices += of_net
    if net is not None and (differing := {found.id for found in gross} ^ nets.keys()):
        missing = [found.id for found in gross if found.id in differing] + [name for name in nets if name in differing]
        raise InputError(
            "parcels-identifiers.expect-same", path=path, net_path=net, missing=list_names(missing, "identifier")
        )
    place = gross[0].shape.centroid
    scale = scale_at(target, place.x, place.y)  # metres of the map per metre on the ground
    if net is not None:
        inners: list[shapely.Polygon | None] = [nets[found.id] for found in gross]
    else:
        inners = inset_parcels([found.shape for found in gross], net_inset_m[0] * scale, net_inset_m[1] * scale)
    parcels = []
    small = []
    for found, inner in zip(gross, inners, strict=True):
        if inner is None or inner.area < MIN_PARCEL_M2:
            small.append(found.id)
            continue
        rest = dict(found.attributes)
        block = next((rest.pop(name) for name in list(rest) if name.casefold() in BLOCK_COLUMNS), None)
        parcels.append(Parcel(found.id, found.shape, inner, None if block is None else _label(block), rest))
    if small:
        raise InputError(
            "parcels-inset",
            path=path,
            small=list_names(small, "parcel"),
            net_inset_m=net_inset_m[0],
            net_inset_sides_m=net_inset_m[1],
        )
    return tuple(parcels), notices


def elsewhere_error(path: Path, points: int, box_m: tuple[float, float, float, float]) -> InputError:
    """The error where no point lies in or around parcels, whose box is west, south, east, north."""
    within = ", ".join(f"{end:.1f}" for end in box_m)
    return InputError("parcels-elsewhere", path=path, points=points, within=within)


def inset_parcels(gross: Sequence[shapely.Polygon], ends_m: float, sides_m: float) -> list[shapely.Polygon | None]:
    """The net parcels; None where nothing, or no single polygon, is left.

    The ends of a parcel with four corners are the two opposite edges that are shorter together, its sides the others.
    Those of any other shape are the edges of its smallest rectangle.
    """
    if ends_m == 0.0 and sides_m == 0.0:
        return list(gross)
    shapes = np.array(gross, dtype=object)
    corners, has_four = _corners(shapes)
    others = np.flatnonzero(~has_four)
    corners[others], has_four[others] = _corners(
        np.array([shapely.minimum_rotated_rectangle(gross[k]) for k in others.tolist()], dtype=object)
    )
    inner = shapes.copy()
    inner[~has_four] = None
    along = np.roll(corners, -1, axis=1) - corners
    length = np.hypot(along[..., 0], along[..., 1])
    first_are_ends = length[:, 0] + length[:, 2] < length[:, 1] + length[:, 3]
    west, south, east, north = shapely.bounds(shapes).T
    far = 4.0 * (east - west + north - south + max(ends_m, sides_m))[:, None]
    for edge in range(4):
        # The half-plane to the left of the edge, moved inwards, as far as the parcel reaches.
        width = np.where((edge % 2 == 0) == first_are_ends, ends_m, sides_m)[:, None]
        direction = along[:, edge] / np.where(has_four, length[:, edge], 1.0)[:, None]
        inwards = np.column_stack([-direction[:, 1], direction[:, 0]])
        at = corners[:, edge] + width * inwards
        half = [
            at - far * direction,
            at + far * direction,
            at + far * (direction + inwards),
            at + far * (inwards - direction),
        ]
        inner = shapely.intersection(inner, shapely.polygons(np.stack(half, axis=1)))
        is_one = (shapely.get_type_id(inner) == shapely.GeometryType.POLYGON) & ~shapely.is_empty(inner)
        inner[~is_one] = None
    found: list[shapely.Polygon | None] = inner.tolist()
    return found


def _corners(shapes: NDArray[np.object_]) -> tuple[FloatArray, NDArray[np.bool_]]:
    """The four corners (n, 4, 2) of convex quadrilaterals, counterclockwise, and which shapes (n,) are such."""
    corners = np.zeros((len(shapes), 4, 2))
    simple = shapely.simplify(shapely.orient_polygons(shapes), 1e-3)
    is_polygon = shapely.get_type_id(simple) == shapely.GeometryType.POLYGON
    has_four = is_polygon & (shapely.get_num_coordinates(simple) == 5) & (shapely.get_num_interior_rings(simple) == 0)
    corners[has_four] = shapely.get_coordinates(simple[has_four]).reshape(-1, 5, 2)[:, :4]
    along = np.roll(corners, -1, axis=1) - corners
    after = np.roll(along, -1, axis=1)
    turns = along[..., 0] * after[..., 1] - along[..., 1] * after[..., 0]
    return corners, has_four & (turns > 0.0).all(axis=1)


def _label(value: object) -> str:
    """An identifier as it is written: a whole number without decimals."""
    if isinstance(value, float | np.floating) and float(value).is_integer():
        return f"{int(value)}"
    return str(value).strip()


def _read_polygons(path: Path, target: CRS) -> tuple[list[_GrossParcel], list[Notice]]:
    def unreadable(why: Words) -> InputError:
        return InputError("parcels-unreadable", path=path, why=why, formats=VECTOR_FORMATS)

    polygons = polygons_on_map(path, target, unreadable)
    columns = {name.casefold(): name for row in reversed(polygons.attributes) for name in row}
    column = next((columns[name] for name in IDS if name in columns), None)
    names = _identifiers(path, polygons.attributes, column)
    named = list(zip(names, polygons.shapes, strict=True))
    several = [name for name, shape in named if not isinstance(shape, shapely.Polygon)]
    crossed = [name for name, shape in named if not (shape.is_valid and shape.area > MIN_PARCEL_M2)]
    for faulty, fault in ((several, Text("several parts")), (crossed, Text("a ring that crosses itself, or no area"))):
        if faulty:
            raise InputError("parcels-invalid", path=path, faulty=list_names(faulty, "parcel"), fault=fault)
    parcels = [
        _GrossParcel(name, shape, _attributes(row, column))
        for (name, shape), row in zip(named, polygons.attributes, strict=True)
        if isinstance(shape, shapely.Polygon)
    ]
    return parcels, list(polygons.notices)


def _identifiers(path: Path, attributes: Sequence[Mapping[str, Any]], column: str | None) -> list[str]:
    if column is None:
        return [str(k) for k in range(1, len(attributes) + 1)]
    names = ["" if row.get(column) is None else _label(row[column]) for row in attributes]
    nameless = [str(k) for k, name in enumerate(names, start=1) if not name]
    repeated = [name for name, count in Counter(names).items() if count > 1 and name]
    if nameless or repeated:
        raise InputError(
            "parcels-identifiers",
            path=path,
            column=column,
            nameless_list=list_names(nameless, "polygon") if nameless else None,
            repeated=list_names(repeated, "identifier") if not nameless else None,
        )
    return names


def _attributes(row: Mapping[str, Any], column: str | None) -> dict[str, Attribute]:
    """The attributes besides the identifier: numbers as such, all else as text; empty cells are left out."""
    return {
        name: float(value) if isinstance(value, int | float | np.number) and not isinstance(value, bool) else str(value)
        for name, value in row.items()
        if name != column and value is not None
    }


COUNTED: Final = {
    "parcel": (Text("parcel"), Text("parcels")),
    "treatment": (Text("treatment"), Text("treatments")),
    "polygon": (Text("polygon"), Text("polygons")),
    "identifier": (Text("identifier"), Text("identifiers")),
}
"""What :func:`list_names` counts: one, and several."""


def list_names(names: Sequence[str], what: str) -> Text:
    """Such as "2 parcels (3, 17)"."""
    return Text(
        "{count} {what} ({names}{more:, …|})",
        count=len(names),
        what=COUNTED[what][len(names) > 1],
        names=tuple(names[:5]),
        more=len(names) > 5,
    )
