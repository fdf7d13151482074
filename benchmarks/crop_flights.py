"""Heights and volumes of parcels from simulated flights, from the recording to the table, against the truth.

crop_flights.toml beside this file is the table of the flights. They are simulated once and kept in the user's cache
folder; so are their results, until --again. With --points-m2 their clouds are thinned at random to so many points a
square metre on average, and with --published the published method is computed on these, too.
"""

from __future__ import annotations

import argparse
import math
import sys
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import geopandas
import laspy
import numpy as np
import shapely
import shapely.affinity
from flights import simulated
from numpy.typing import NDArray
from scipy.stats import chi2

import furrowmap
from furrowmap.core.crops.measure import measure_parcels
from furrowmap.core.crops.parcel_areas import inset_parcel
from furrowmap.core.crops.parcel_points import PUBLISHED_STRIP_M, ParcelPoints
from furrowmap.core.crops.site_soil import site_soil
from furrowmap.core.values.parcel import Parcel

FloatArray = NDArray[np.float64]

TABLE = Path(__file__).with_suffix(".toml")
CRS = "EPSG:25832"
HEAD = (
    f"{'':12}parcels points/m2   height: bias, RMSE, largest mm   /sigma   volume: bias, RMS, largest %   "
    "soil: RMS, largest mm   /sigma   own, common /sigma   published: height RMSE mm, volume RMS %"
)


@dataclass(frozen=True)
class Judged:
    """Figures of the parcels of a flight; nan where they were not computed.

    Attributes:
        points_m2: (n,) points a square metre.
        height_m: (n,) mean heights.
        sigma_m: (n,) their stated standard deviations.
        common_m: (n,) the part of these that all parcels of a flight share.
        soil_m: (n,) errors of the mean height of the soil, less their mean: an offset of the whole flight
            moves crop and soil alike.
        soil_sigma_m: (n,) their stated standard deviations.
        published_m: (n,) mean heights by the published method.
        published_m3: (n,) volumes by it.
        area_m2: (n,) of the net parcels.
        true_m: (n,) true mean heights.
    """

    points_m2: FloatArray
    height_m: FloatArray
    sigma_m: FloatArray
    common_m: FloatArray
    soil_m: FloatArray
    soil_sigma_m: FloatArray
    published_m: FloatArray
    published_m3: FloatArray
    area_m2: FloatArray
    true_m: FloatArray

    @property
    def parts(self) -> tuple[FloatArray, float]:
        """(n,) errors over sigma of the parcels apart, and that of all together."""
        off, own = self.height_m - self.true_m, np.sqrt(self.sigma_m**2 - self.common_m**2)
        alone = (off - off.mean()) / own * math.sqrt(len(off) / (len(off) - 1))
        return alone, float(off.mean() / math.hypot(rms(self.common_m), rms(own) / math.sqrt(len(off))))


def main() -> int:
    flights = tomllib.loads(TABLE.read_text(encoding="utf-8"))
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=list(flights), choices=list(flights), metavar="NAME")
    parser.add_argument("--points-m2", nargs="+", type=float, default=[math.inf], metavar="N", help="densities")
    parser.add_argument("--published", action="store_true", help="the published method, too")
    parser.add_argument("--again", action="store_true", help="run the flights again")
    options = parser.parse_args()
    print(HEAD, flush=True)
    found: dict[float, list[Judged]] = {}
    for name in options.only:
        trial, recording = flown(name, flights[name])
        out = recording / "out"
        if options.again or not (out / "report.json").exists():
            furrowmap.run(recording / "session.toml", out, overwrite=True)
        print_line(name, table_of(recording, trial))
        for density in options.points_m2:
            judged = judge(recording, trial, density, published=options.published)
            print_line(f"  {density:.0f}", judged)
            found.setdefault(density, []).append(judged)
    for density, flights_judged in found.items():
        print_parts(density, flights_judged)
        if options.only[:2] == ["21_along", "22_across"]:
            print_paths(density, *flights_judged[:2])
    return 0


def flown(name: str, keys: Mapping[str, Any]) -> tuple[Mapping[str, Any], Path]:
    """The trial and the recording of a flight, with its parcels in the session."""
    trial = keys["trial"]
    rng = np.random.default_rng(keys["seed"])
    flight = {
        **keys["flight"],
        "plots_m": [[*place, h] for place, h in zip(plots(trial), heights(trial, rng), strict=True)],
    }
    recording = simulated(name, {k: v for k, v in keys.items() if k != "trial"} | {"flight": flight}, 0, scans=True)
    session = recording / "session.toml"
    if not (recording / "parcels.gpkg").exists():
        parcels = trial_parcels(recording, trial)
        geopandas.GeoDataFrame({"id": [p.id for p in parcels]}, geometry=[p.gross for p in parcels], crs=CRS).to_file(
            recording / "parcels.gpkg"
        )
        with session.open("a", encoding="utf-8") as file:
            file.write(f'\n[parcels]\nfile = "parcels.gpkg"\nnet_inset_m = {trial["net_inset_m"]}\n')
    return trial, recording


def plots(trial: Mapping[str, Any]) -> list[list[float]]:
    """East and north of the middle, direction, length and width of each plot, row by row."""
    (length, width), (alley, track) = trial["plot_m"], trial["gap_m"]
    turn = math.radians(trial["turn_deg"])
    out = []
    for k in range(trial["columns"] * trial["rows"]):
        u = k % trial["columns"] * (length + alley) + 0.5 * length
        v = k // trial["columns"] * (width + track) + 0.5 * width
        east = trial["corner_m"][0] + u * math.cos(turn) - v * math.sin(turn)
        north = trial["corner_m"][1] + u * math.sin(turn) + v * math.cos(turn)
        out.append([round(east, 4), round(north, 4), trial["turn_deg"], length, width])
    return out


def heights(trial: Mapping[str, Any], rng: np.random.Generator) -> list[float]:
    """Of the crop on each plot."""
    drawn = rng.uniform(*trial["heights_m"], trial["columns"] * trial["rows"])
    return [round(height, 3) for height in drawn.tolist()]


def trial_parcels(recording: Path, trial: Mapping[str, Any]) -> list[Parcel]:
    """The parcels on the map."""
    with np.load(recording / "truth" / "surface.npz") as truth:
        e0, n0 = float(truth["e0"]), float(truth["n0"])
    out = []
    for number, (east, north, turn, length, width) in enumerate(plots(trial), 1):
        box = shapely.box(-0.5 * length, -0.5 * width, 0.5 * length, 0.5 * width)
        gross = shapely.affinity.translate(shapely.affinity.rotate(box, turn, (0, 0)), e0 + east, n0 + north)
        net = inset_parcel(gross, *trial["net_inset_m"])
        assert net is not None
        out.append(Parcel(str(number), gross, net))
    return out


def truth_of(recording: Path, parcels: list[Parcel]) -> tuple[FloatArray, FloatArray]:
    """Mean height of the canopy and of the soil in the net parcels."""
    with np.load(recording / "truth" / "surface.npz") as truth:
        e0, n0, cell, h0 = (float(truth[k]) for k in ("e0", "n0", "cell_m", "h0_m"))
        canopy, soil = truth["canopy_height"].astype(np.float64), truth["soil"].astype(np.float64) + h0
    out = np.empty((2, len(parcels)))
    for k, parcel in enumerate(parcels):
        west, south, east, north = parcel.net.bounds
        rows = slice(math.floor((south - n0) / cell), math.ceil((north - n0) / cell))
        columns = slice(math.floor((west - e0) / cell), math.ceil((east - e0) / cell))
        e = e0 + (np.arange(columns.start, columns.stop) + 0.5) * cell
        n = n0 + (np.arange(rows.start, rows.stop) + 0.5) * cell
        inside = shapely.contains_xy(parcel.net, *np.meshgrid(e, n))
        out[:, k] = canopy[rows, columns][inside].mean(), soil[rows, columns][inside].mean()
    return out[0], out[1]


def table_of(recording: Path, trial: Mapping[str, Any]) -> Judged:
    """The layer `parcels` of the run against the truth."""
    parcels = trial_parcels(recording, trial)
    true, _ = truth_of(recording, parcels)
    layer = geopandas.read_file(recording / "out" / "field.gpkg", layer="parcels").set_index("id")
    layer = layer.loc[[p.id for p in parcels]]
    columns = ("points_m2", "mean_height_m", "height_sigma_m", "common_sigma_m")
    density, height, sigma, common = (layer[name].to_numpy(float) for name in columns)
    none = np.full(len(true), math.nan)
    area = layer["area_m2"].to_numpy(float)
    return Judged(density, height, sigma, common, none, none, none, none, area, true)


def judge(recording: Path, trial: Mapping[str, Any], points_m2: float, *, published: bool) -> Judged:
    """The cloud of the run, thinned, against the truth."""
    parcels = trial_parcels(recording, trial)
    true, soil_true = truth_of(recording, parcels)
    whole = table_of(recording, trial).points_m2.mean()
    rng = np.random.default_rng(1)
    with ParcelPoints(parcels, None, PUBLISHED_STRIP_M if published else None) as points:
        with laspy.open(recording / "out" / "cloud.copc.laz") as cloud:
            for chunk in cloud.chunk_iterator(2_000_000):
                kept = ~np.isin(np.asarray(chunk.classification), (7, 18, 64))
                kept &= rng.random(len(kept)) < points_m2 / whole
                points.add(np.column_stack([chunk.x, chunk.y, chunk.z])[kept])
        soil = site_soil(points)
        rows = [row for row, _ in measure_parcels(points, soil.soil.under, soil.noise_m, compare=published)]
        patches = [soil.soil.under(parcel) for parcel in parcels]
    found = []
    for parcel, patch in zip(parcels, patches, strict=True):
        place = np.random.default_rng(2).uniform(parcel.net.bounds[:2], parcel.net.bounds[2:], (4000, 2))
        inside = shapely.contains_xy(parcel.net, *place.T)
        found.append(patch.at(place[inside]).mean() if patch is not None else math.nan)
    figures, off = [row.figures for row in rows], np.array(found) - soil_true
    return Judged(
        np.array([f.points_m2 for f in figures]),
        np.array([f.mean_height_m for f in figures]),
        np.array([f.height_sigma_m for f in figures]),
        np.array([f.common_sigma_m for f in figures]),
        off - off.mean(),
        np.array([f.soil_sigma_m for f in figures]),
        np.array([row.published_height_m for row in rows]),
        np.array([row.published_volume_m3 for row in rows]),
        np.array([f.area_m2 for f in figures]),
        true,
    )


def rms(values: FloatArray) -> float:
    """Of those that are known."""
    return float(np.sqrt(np.nanmean(values**2))) if np.isfinite(values).any() else math.nan


def print_line(name: str, judged: Judged) -> None:
    """The figures of a flight."""
    off, soil = 1000.0 * (judged.height_m - judged.true_m), 1000.0 * judged.soil_m
    volume, published = 100.0 * (judged.height_m / judged.true_m - 1.0), judged.published_m - judged.true_m
    published_volume = judged.published_m3 / (judged.true_m * judged.area_m2) - 1.0
    print(
        f"{name:12}{len(off):7}{np.mean(judged.points_m2):9.0f}   "
        f"{np.nanmean(off):+6.1f} {rms(off):6.1f} {np.nanmax(np.abs(off)):6.1f}"
        f"{rms(0.001 * off / judged.sigma_m):14.2f}"
        f"     {np.nanmean(volume):+6.2f} {rms(volume):6.2f} {np.nanmax(np.abs(volume)):6.2f}"
        f"        {rms(soil):6.1f} {np.max(np.abs(soil)):6.1f}"
        f"{rms(0.001 * soil / judged.soil_sigma_m):10.2f}"
        f"{rms(judged.parts[0]):12.2f} {judged.parts[1]:+7.2f}"
        f"     {1000.0 * rms(published):6.1f} {100.0 * rms(published_volume):6.1f}",
        flush=True,
    )


def print_parts(density: float, flights: list[Judged]) -> None:
    """Errors over sigma of all flights, and within what limits they are by chance in 95 of 100 cases."""
    alone, common = [np.concatenate([judged.parts[0] for judged in flights]), np.array([j.parts[1] for j in flights])]
    for words, values, freedom in (
        ("parcels apart", alone, len(alone) - len(flights)),
        ("what a flight's parcels share", common, len(common)),
    ):
        low, high = np.sqrt(chi2.ppf([0.025, 0.975], freedom) / freedom)
        print(
            f"error over sigma, {density:.0f} points/m2, {words}: {rms(values):.2f} ({low:.2f} to {high:.2f} by chance)"
        )


def print_paths(density: float, one: Judged, other: Judged) -> None:
    """How volumes of the same parcels by two paths differ."""
    by_default = 100.0 * (other.height_m / one.height_m - 1.0)
    published = 100.0 * (other.published_m3 / one.published_m3 - 1.0)
    print(
        f"two paths, {density:.0f} points/m2: volumes differ by {np.nanmean(by_default):+.2f} % (RMS "
        f"{rms(by_default):.2f} %); published {np.nanmean(published):+.1f} % (RMS {rms(published):.1f} %)"
    )


if __name__ == "__main__":
    sys.exit(main())
