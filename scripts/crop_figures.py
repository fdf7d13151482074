"""Draws figures 8 to 11 of Christiansen et al. 2017, for docs/explanation/crops.md, from a run of the sample flight.

crop_figures.py RESULT FLIGHT [FOLDER]       RESULT is a run of FLIGHT; the pictures go to docs/images by default

Their two flights were flown along two paths. Here path A are the strips along the parcels, path B those across them,
each thinned to the density of their clouds.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from furrowmap.process import prepare_process

prepare_process()

import laspy  # noqa: E402
import pandas as pd  # noqa: E402
from matplotlib import pyplot as plt  # noqa: E402
from numpy.typing import NDArray  # noqa: E402
from pyproj import CRS  # noqa: E402

from furrowmap.core.crops.dose_response import fit_response  # noqa: E402
from furrowmap.core.crops.measure import MeasuredParcel, measure_parcels  # noqa: E402
from furrowmap.core.crops.parcel_areas import read_parcels  # noqa: E402
from furrowmap.core.crops.parcel_points import PUBLISHED_STRIP_M, ParcelPoints  # noqa: E402
from furrowmap.core.crops.response_values import ResponseQuestion  # noqa: E402
from furrowmap.core.crops.site_soil import site_soil  # noqa: E402
from furrowmap.core.values.parcel import Parcel  # noqa: E402
from furrowmap.core.values.scan import PointClass  # noqa: E402
from furrowmap.exporters.reports.trial_charts import ParcelValues, response_chart, standalone  # noqa: E402

FloatArray = NDArray[np.float64]

IMAGES = Path(__file__).resolve().parents[1] / "docs" / "images"
DENSITY_M2 = 700.0
LEAST_M2 = 400.0
"""Parcels with fewer points were not flown over: the clouds of the paper have 400 to 700."""
PATHS = {"A: along the parcels": (1, 2, 3), "B: across them": (4, 5, 6)}
EASTERN_M = 36.5
"""Where the last block of parcels begins, from the west of the cloud."""
BLUE, RED = "#0072b2", "#d55e00"


def points_of(result: Path, strips: tuple[int, ...], parcels: tuple[Parcel, ...]) -> FloatArray:
    """The points (n, 3) of strips near the parcels, thinned at random."""
    with laspy.open(result / "cloud.copc.laz") as file:
        las = file.read()
    kept = np.isin(las.point_source_id, strips)
    kept &= ~np.isin(las.classification, (PointClass.NOISE, PointClass.VEHICLE))
    xyz = np.asarray(las.xyz)[kept]
    west, south, east, north = np.array([parcel.gross.bounds for parcel in parcels]).T
    low, high = np.array([west.min(), south.min()]) - 3.5, np.array([east.max(), north.max()]) + 3.5
    xyz = xyz[((xyz[:, :2] > low) & (xyz[:, :2] < high)).all(axis=1)]
    share = DENSITY_M2 * float(np.prod(high - low)) / len(xyz)
    return xyz[np.random.default_rng(1).random(len(xyz)) < share]


def measure(xyz: FloatArray, parcels: tuple[Parcel, ...]) -> list[MeasuredParcel]:
    """The parcels by both methods."""
    with ParcelPoints(parcels, None, PUBLISHED_STRIP_M) as points:
        points.add(xyz)
        soil = site_soil(points)
        return [row for row, _ in measure_parcels(points, soil.soil.under, soil.noise_m, compare=True)]


def draw_clouds(clouds: dict[str, FloatArray], file: Path) -> None:
    """Figures 8 and 9: the clouds of both paths from above, and the eastern parcels from the side."""
    figure = plt.figure(figsize=(8, 5.4), layout="constrained")
    origin = next(iter(clouds.values())).min(axis=0)
    for k, (name, xyz) in enumerate(clouds.items()):
        x, y, z = (xyz - origin).T
        z = z - np.percentile(z, 1)
        flat = figure.add_subplot(2, 2, k + 1)
        flat.scatter(x[::4], y[::4], 0.1, z[::4], vmin=0.0, vmax=0.9, cmap="turbo", lw=0)
        flat.set(title=name, aspect="equal", xlim=(0, 52), ylim=(0, 25), xlabel="easting (m)", ylabel="northing (m)")
        solid = figure.add_subplot(2, 2, k + 3, projection="3d")
        near = (x > EASTERN_M) & (x < EASTERN_M + 12.0) & (y > 4.0) & (y < 22.0)
        solid.scatter(x[near], y[near], z[near], s=0.4, c=z[near], vmin=0.0, vmax=0.9, cmap="turbo", lw=0)
        solid.set_box_aspect((12.0, 18.0, 4.0), zoom=1.6)
        solid.set(xlim=(EASTERN_M, EASTERN_M + 12.0), ylim=(4.0, 22.0), zlim=(0.0, 1.2))
        solid.view_init(24, -25)
        solid.set_axis_off()
    figure.savefig(file, dpi=90)


def draw_response(rows: list[MeasuredParcel], doses: FloatArray, blocks: list[str], file: Path) -> str:
    """Figure 10: mean height over nitrogen, with the logistic curve and its band; what it says."""
    height = np.array([row.figures.mean_height_m for row in rows])
    found = fit_response(doses, height, blocks, ResponseQuestion(unit="kg/ha"))
    points = ParcelValues(height, blocks, "mean height (m)", "block")
    file.write_text(standalone(response_chart(doses, points, found, "nitrogen (kg/ha)")), encoding="utf-8")
    return found.words


def draw_volumes(rows: dict[str, list[MeasuredParcel]], file: Path) -> None:
    """Figure 11: volumes by parcel for both paths, by both methods."""
    figure, axes = plt.subplots(2, 1, figsize=(7, 5), sharex=True, sharey=True, layout="constrained")
    for axis, method in zip(axes, ("canopy-top", "christiansen2017"), strict=True):
        for (name, found), colour, mark in zip(rows.items(), (BLUE, RED), ("o", "^"), strict=True):
            flown = np.flatnonzero(flown_over(found))
            axis.plot(flown + 1, volumes(found, method)[flown], mark, ms=5, color=colour, label=f"path {name}")
        axis.set(title=method, ylabel="volume (m³)")
        axis.grid(alpha=0.3)
    axes[0].legend(frameon=False)
    axes[1].set(xlabel="parcel", xticks=range(1, 21))
    figure.savefig(file)


def main(result: Path, flight: Path, folder: Path) -> None:
    """Draw all, and print the table."""
    parcels = read_parcels(flight / "parcels.geojson", CRS.from_epsg(25832), (1.00, 0.11))[0]
    plan = pd.read_csv(flight / "treatments.csv").set_index("id")
    truth = pd.read_csv(flight / "truth" / "parcels_truth.csv").set_index("id")
    clouds = {name: points_of(result, strips, parcels) for name, strips in PATHS.items()}
    draw_clouds(clouds, folder / "crops-points.png")
    rows = {name: measure(xyz, parcels) for name, xyz in clouds.items()}
    first, second = rows.values()
    ids = [int(parcel.id) for parcel in parcels]
    doses = plan.loc[ids, "n_kg_ha"].to_numpy(np.float64)
    print(draw_response(first, doses, [str(parcel.block) for parcel in parcels], folder / "crops-response.svg"))
    draw_volumes(rows, folder / "crops-volumes.svg")
    true = truth.loc[ids, "volume_m3"].to_numpy()
    both = flown_over(first) & flown_over(second)
    print(f"{both.sum()} parcels on both paths")
    for method in ("canopy-top", "christiansen2017"):
        one, other = (volumes(found, method)[both] for found in (first, second))
        apart = 100.0 * (other / one - 1.0)
        for name, volume in zip(rows, (one, other), strict=True):
            off = 100.0 * (volume / true[both] - 1.0)
            print(
                f"{method}, {name}: {volume.min():.2f} to {volume.max():.2f} m3, {off.mean():+.1f} % (mean), ", end=""
            )
            print(f"{np.sqrt((off**2).mean()):.1f} % (RMS) of the truth")
        print(f"  B less A: {apart.mean():+.2f} % (mean), {np.sqrt((apart**2).mean()):.2f} % (RMS)")


def flown_over(rows: list[MeasuredParcel]) -> NDArray[np.bool_]:
    """Which parcels (n,) have enough points."""
    return np.array([row.figures.points_m2 >= LEAST_M2 for row in rows])


def volumes(rows: list[MeasuredParcel], method: str) -> FloatArray:
    """Volumes (n,) of parcels by a method."""
    if method == "canopy-top":
        return np.array([row.figures.volume_m3 for row in rows])
    return np.array([row.published_volume_m3 for row in rows])


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[3]) if len(sys.argv) > 3 else IMAGES)
