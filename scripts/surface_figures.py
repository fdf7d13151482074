"""Draws the figures of docs/explanation/surfaces.md from a sample recording beside the checkout."""

from __future__ import annotations

import tempfile
from pathlib import Path

import matplotlib as mpl

mpl.use("agg")
import geopandas as gpd
import matplotlib.pyplot as plt
import numpy as np
import rasterio
from matplotlib.axes import Axes
from matplotlib.colors import LightSource
from numpy.typing import NDArray

import furrowmap

CHECKOUT = Path(__file__).resolve().parents[1]
DATA = CHECKOUT.parent / "shared" / "data"
IMAGES = CHECKOUT / "docs" / "images"
AROUND_M = 1.0
EXAGGERATION = 3.0


def read(path: Path, box: tuple[float, float, float, float]) -> NDArray[np.float32]:
    """First band of a raster within west, south, east, north."""
    with rasterio.open(path) as raster:
        values: NDArray[np.float32] = raster.read(1, window=raster.window(*box))
    return values


def shaded(axes: Axes, height_m: NDArray[np.float32], cell_m: float, extent: list[float]) -> None:
    """Relief lit from the north-west; white where nothing was seen."""
    light = LightSource(azdeg=315, altdeg=45)
    filled = np.where(np.isfinite(height_m), height_m, np.nanmedian(height_m))
    grey = light.hillshade(filled, vert_exag=EXAGGERATION, dx=cell_m, dy=cell_m)
    axes.imshow(np.where(np.isfinite(height_m), grey, np.nan), cmap="gray", vmin=0.2, vmax=1.0, extent=extent)


def before_after_change(result: Path, picture: Path) -> None:
    """The three rasters of a run side by side, round the ground worked."""
    passes = gpd.read_file(result / "field.gpkg", layer="passes")
    west, south, east, north = passes.total_bounds + np.array([-1, -1, 1, 1]) * AROUND_M
    box = (west, south, east, north)
    extent = [0.0, east - west, 0.0, north - south]
    figure, axes = plt.subplots(1, 3, figsize=(11, 3.9), layout="constrained", sharey=True)
    for one, name, title in zip(axes, ("dsm_before", "dsm"), ("before", "as left at the end"), strict=False):
        with rasterio.open(result / f"{name}.tif") as raster:
            cell_m = raster.res[0]
        shaded(one, read(result / f"{name}.tif", box), cell_m, extent)
        one.set_title(title, loc="left", fontsize=10)
    change = axes[2].imshow(read(result / "change.tif", box), cmap="BrBG_r", vmin=-0.08, vmax=0.08, extent=extent)
    axes[2].set_title("change", loc="left", fontsize=10)
    figure.colorbar(change, ax=axes[2], shrink=0.7, label="m")
    for one in axes:
        passes.geometry.translate(-west, -south).boundary.plot(ax=one, color="#c8102e", linewidth=0.6)
        one.set(aspect="equal", xlabel="m", ylabel="")
        for side in ("top", "right"):
            one.spines[side].set_visible(False)
    axes[0].set_ylabel("m")
    figure.savefig(picture, dpi=90)


def main() -> None:
    """Run the sample and draw."""
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder, "result")
        furrowmap.run(DATA / "tractor_loop" / "session.toml", result)
        before_after_change(result, IMAGES / "surfaces-before-after.png")


if __name__ == "__main__":
    main()
