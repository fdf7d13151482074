"""A map of a run: worked ground by pass, overlaps, missed strips and the tool's way over the relief of the ground."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
import pyogrio
from geopandas import GeoDataFrame
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, LightSource, LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy import ndimage

from furrowmap.core.runtime.errors import InputError
from furrowmap.exporters.reports.drawings import pass_colour
from furrowmap.exporters.work_colours import MISSED_COLOUR, OVERLAP_COLOUR

FloatArray = NDArray[np.float64]

NOT_GROUND = (7, 64, 65)
"""Classes that never show the ground: noise, vehicle, implement."""
CLUTTER_M = 0.15
"""Points this much above a cell's lowest one are not ground."""
LAST_VIEW_S = 3.0
MARGIN_M = 3.5
FINEST_CELL_M = 0.04
LONGEST_SIDE = 1500
HOLE = 4
CHUNK = 2_000_000
EXAGGERATION = 4.0

GROUND_COLOURS = ["#6f675c", "#a2988a", "#d6cebf"]
INK = "#1f2a30"


@dataclass(frozen=True)
class HeightGrid:
    """Mean heights of the ground in square cells, rows going north.

    Attributes:
        height_m: (rows, cols); nan where nothing was measured.
        e0_m: easting of the lower left corner of the cell [0, 0].
        n0_m: northing of the same corner.
        cell_m: length of a cell's sides.
    """

    height_m: FloatArray
    e0_m: float
    n0_m: float
    cell_m: float

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """West, east, south and north border."""
        rows, cols = self.height_m.shape
        return self.e0_m, self.e0_m + cols * self.cell_m, self.n0_m, self.n0_m + rows * self.cell_m


@dataclass(frozen=True)
class WorkedGround:
    """Layers of a run's GeoPackage, empty where the run has none.

    Attributes:
        track_en_m: (n, 2) easting and northing of the vehicle.
        passes, overlaps, misses: polygons with their areas; passes with their numbers.
        tool_path: lines of the tool, with "up", "down" or "unknown".
        events: points where the tool was lowered or raised.
    """

    track_en_m: FloatArray
    passes: GeoDataFrame
    overlaps: GeoDataFrame
    misses: GeoDataFrame
    tool_path: GeoDataFrame
    events: GeoDataFrame


def draw_map(result: Path, picture: Path, title: str) -> None:
    """Draw the map of a run into a PNG file.

    Args:
        result: the folder of the run, with ``cloud.copc.laz`` and ``field.gpkg``.
        picture: the file to write.
        title: the heading above the map.

    Raises:
        InputError: if one of the two products is missing or empty.
    """
    worked = read_worked_ground(result / "field.gpkg")
    grid = ground_around(result / "cloud.copc.laz", worked.track_en_m)
    _draw(grid, worked, title).savefig(picture)


def read_worked_ground(path: Path) -> WorkedGround:
    """The layers of a run's GeoPackage.

    Raises:
        InputError: if it has no trajectory.
    """
    if not path.is_file():
        raise _missing(path)
    there = {name for name, _ in pyogrio.list_layers(path)}
    names = ("trajectory", "passes", "overlaps", "misses", "tool_path", "events")
    none = GeoDataFrame(columns=["pass", "implement", "kind", "geometry"], geometry="geometry")
    layers = [pyogrio.read_dataframe(path, layer=name) if name in there else none for name in names]
    if layers[0].empty:
        raise _missing(path)
    return WorkedGround(layers[0].get_coordinates().to_numpy(np.float64), *layers[1:])


def ground_around(path: Path, track_en_m: FloatArray) -> HeightGrid:
    """The ground within a few metres of a track, as it was left at the end.

    A cell's height is the mean of what was seen in the last seconds of its view, close above its lowest point.

    Args:
        path: a LAS or LAZ file in metres; it is read three times, in pieces.
        track_en_m: (n, 2) easting and northing in the same coordinates.

    Raises:
        InputError: if the file is missing or has no ground near the track.
    """
    if not path.is_file():
        raise _missing(path)
    low = np.floor(track_en_m.min(axis=0) - MARGIN_M)
    size = np.ceil(track_en_m.max(axis=0) + MARGIN_M) - low
    cell_m = max(FINEST_CELL_M, float(size.max()) / LONGEST_SIDE)
    cols, rows = (int(n) for n in np.ceil(size / cell_m))

    lowest, last_s = np.full(rows * cols, np.inf), np.full(rows * cols, -np.inf)
    for cell, z, _ in _cells(path, low, cell_m, rows, cols):
        np.minimum.at(lowest, cell, z)
    for cell, z, t_s in _cells(path, low, cell_m, rows, cols):
        near = z < lowest[cell] + CLUTTER_M
        np.maximum.at(last_s, cell[near], t_s[near])
    total, count = np.zeros(rows * cols), np.zeros(rows * cols, np.int64)
    for cell, z, t_s in _cells(path, low, cell_m, rows, cols):
        near = (z < lowest[cell] + CLUTTER_M) & (t_s > last_s[cell] - LAST_VIEW_S)
        total += np.bincount(cell[near], z[near], rows * cols)
        count += np.bincount(cell[near], minlength=rows * cols)
    if not count.any():
        raise _missing(path)
    height_m = np.where(count > 0, total / np.maximum(count, 1), np.nan).reshape(rows, cols)
    return HeightGrid(height_m, float(low[0]), float(low[1]), cell_m)


def _cells(
    path: Path, low: FloatArray, cell_m: float, rows: int, cols: int
) -> Iterator[tuple[NDArray[np.int64], FloatArray, FloatArray]]:
    """Cell, height and GPS time of each point of the file that may show the ground within the grid, piece by piece."""
    with laspy.open(path) as file:
        for points in file.chunk_iterator(CHUNK):
            col = np.floor((np.asarray(points.x) - low[0]) / cell_m).astype(np.int64)
            row = np.floor((np.asarray(points.y) - low[1]) / cell_m).astype(np.int64)
            inside = (col >= 0) & (col < cols) & (row >= 0) & (row < rows)
            inside &= ~np.isin(np.asarray(points.classification), NOT_GROUND)
            cell = (row * cols + col)[inside]
            yield cell, np.asarray(points.z, np.float64)[inside], np.asarray(points.gps_time, np.float64)[inside]


def _missing(path: Path) -> InputError:
    return InputError(
        "nothing-to-draw",
        what=f"{path} is missing or has nothing to draw.",
        meaning="The map shows the ground of the cloud and the trajectory over it; without both there is no picture.",
        remedy="Name the folder that 'furrowmap run' wrote.",
    )


def _draw(grid: HeightGrid, worked: WorkedGround, title: str) -> Figure:
    ground = _without_pinholes(grid.height_m)
    west, east, south, north = grid.extent
    width_in, legend_in = 10.0, 2.2
    map_in = (width_in - legend_in - 0.4) * (north - south) / (east - west)
    height_in = map_in + 0.9
    figure = Figure(figsize=(width_in, height_in), dpi=150)
    axes = figure.add_axes((0.02, 0.35 / height_in, (width_in - legend_in - 0.4) / width_in, map_in / height_in))
    norm = Normalize(*np.nanpercentile(ground, [2, 98]))
    colours = LinearSegmentedColormap.from_list("ground", GROUND_COLOURS)
    axes.imshow(_relief(ground, grid.cell_m, colours, norm), extent=grid.extent, origin="lower")
    _draw_worked(axes, worked)
    _draw_tool(axes, worked)
    _draw_scale_bar(axes, grid.extent)
    _draw_north_arrow(axes)
    axes.set(xlim=(west, east), ylim=(south, north))
    axes.set_axis_off()
    axes.set_title(title, loc="left", color=INK, fontsize=14, fontweight="bold")
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize=10, labelcolor=INK)
    caption = (
        f"Ground from the laser scanner in cells of {100 * grid.cell_m:.0f} cm, lit from the north-west, relief "
        f"{EXAGGERATION:.0f} times exaggerated."
    )
    figure.text(0.02, 0.1 / height_in, caption, color=INK, fontsize=8)
    return figure


def _draw_worked(axes: Axes, worked: WorkedGround) -> None:
    """Passes, one colour each, and loud over them what was worked twice, and what was left out between them."""
    for k, number in enumerate(worked.passes["pass"]):
        colour = pass_colour(k + 1, len(worked.passes))
        one = worked.passes.iloc[[k]]
        one.plot(ax=axes, facecolor=colour, alpha=0.55, edgecolor="white", linewidth=1.2, zorder=2)
        axes.plot([], [], "s", color=colour, alpha=0.7, markersize=11, label=f"pass {number}: {one.area.sum():.1f} m²")
    layers = ((worked.overlaps, OVERLAP_COLOUR, "worked twice"), (worked.misses, MISSED_COLOUR, "missed"))
    for layer, colour, label in layers:
        if not layer.empty:
            layer.plot(ax=axes, facecolor=colour, alpha=0.9, edgecolor=INK, linewidth=0.6, zorder=3)
            area = f"{label}: {layer.area.sum():.1f} m²"
            axes.plot([], [], "s", color=colour, markeredgecolor=INK, markersize=11, label=area)


def _draw_tool(axes: Axes, worked: WorkedGround) -> None:
    """The way of the tool, in the ground and raised, and where it was lowered and raised; else that of the vehicle."""
    halo = [patheffects.withStroke(linewidth=3.5, foreground="white", alpha=0.8)]
    if worked.tool_path.empty:
        axes.plot(*worked.track_en_m.T, color=INK, linewidth=1.4, label="vehicle", path_effects=halo)
    for state, style, label in (("down", "-", "tool in the ground"), ("up", (0, (4, 2)), "tool raised")):
        for k, line in enumerate(worked.tool_path.geometry[worked.tool_path["implement"] == state]):
            part, named = np.asarray(line.coords)[:, :2].T, label if k == 0 else None
            axes.plot(*part, color=INK, linestyle=style, linewidth=1.4, label=named, path_effects=halo, zorder=4)
    lowered, raised = (worked.events[worked.events["kind"] == kind].get_coordinates() for kind in ("down", "up"))
    way = worked.track_en_m if worked.tool_path.empty else worked.tool_path.get_coordinates().to_numpy()
    marks = {"lowered": (lowered, "v"), "raised": (raised, "^"), "start": (way[:1], "o"), "end": (way[-1:], "s")}
    for label, (places, mark) in marks.items():
        if len(places):
            east, north = np.asarray(places)[:, :2].T
            axes.plot(east, north, mark, color="white", markeredgecolor=INK, markersize=9, label=label, zorder=5)


def _without_pinholes(height_m: FloatArray) -> FloatArray:
    """The grid with holes of up to a few cells, which no ray happened to meet, filled from the nearest cell."""
    met = np.isfinite(height_m)
    row, col = ndimage.distance_transform_edt(~met, return_distances=False, return_indices=True)
    closed = ndimage.binary_closing(np.pad(met, HOLE), iterations=HOLE)[HOLE:-HOLE, HOLE:-HOLE]
    filled: FloatArray = np.where(met | closed, height_m[row, col], np.nan)
    return filled


def _relief(ground: FloatArray, cell_m: float, colours: Colormap, norm: Normalize) -> FloatArray:
    """Colours (rows, cols, 4) by height, lit from the north-west; clear where nothing is known."""
    known = np.isfinite(ground)
    solid = np.where(known, ground, np.nanmin(ground))
    light = LightSource(azdeg=315, altdeg=45)
    lit = light.shade(solid, cmap=colours, norm=norm, blend_mode="soft", vert_exag=EXAGGERATION, dx=cell_m, dy=cell_m)
    lit[..., 3] = known
    shades: FloatArray = lit
    return shades


def _draw_scale_bar(axes: Axes, extent: tuple[float, float, float, float]) -> None:
    west, east, south, north = extent
    length_m = max(n for n in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000) if n <= max(1.0, (east - west) / 4))
    x, y = west + 0.03 * (east - west), south + 0.04 * (north - south)
    halo = [patheffects.withStroke(linewidth=6, foreground="white", alpha=0.8)]
    axes.plot([x, x + length_m], [y, y], color=INK, linewidth=3, solid_capstyle="butt", path_effects=halo)
    axes.annotate(f"{length_m} m", (x + length_m / 2, y), (0, 4), textcoords="offset points", ha="center", color=INK)


def _draw_north_arrow(axes: Axes) -> None:
    halo = [patheffects.withStroke(linewidth=4, foreground="white", alpha=0.8)]
    arrow = {"arrowstyle": "-|>", "color": INK, "linewidth": 2.5, "mutation_scale": 20, "path_effects": halo}
    place = "axes fraction", "offset points"
    axes.annotate("", (0.965, 0.985), (0, -45), *place, arrowprops=arrow)
    axes.annotate("N", (0.965, 1.0), (0, -68), *place, ha="center", color=INK, fontweight="bold", path_effects=halo)
