"""The settings of the workflows. A field is an option of a command, whose help is the field's entry in the docstring.

Imports nothing that takes time, because the commands' help is made from it.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

from furrowmap.core.pointclouds.cleaning_steps import Cleaning as Cleaning
from furrowmap.core.runtime.errors import InputError, UsageError
from furrowmap.core.runtime.options import OptionSettings, setting

if TYPE_CHECKING:
    from pyproj import CRS

    from furrowmap.core.accuracy.cloud_at_points import Targets
    from furrowmap.core.crops.measure import Method
    from furrowmap.core.crops.response_models import ModelName
    from furrowmap.core.pointclouds.flat_targets import TargetShape
    from furrowmap.core.pointclouds.surfaces import GroundMethod
    from furrowmap.core.readers.las.cloud import Box
    from furrowmap.core.surfaces.outliers import Outliers
    from furrowmap.core.surfaces.statistic import Statistic
    from furrowmap.exporters.farm.traffic import Wheels

_RESPONSE_MODELS: Final = (
    "auto",
    "linear",
    "quadratic",
    "quadratic-plateau",
    "linear-plateau",
    "mitscherlich",
    "logistic",
)
_GROUND_METHODS: Final = ("auto", "class", "smrf", "csf")

_bbox = partial(setting, "--bbox", "W,S,E,N", label="Extent")
_bbox_crs = partial(setting, "--bbox-crs", "CRS")
_classes = partial(setting, "--class", "N,N", label="Class codes to use, such as 2,9")
_crs = partial(setting, "--crs", "CRS", label="CRS of clouds without one")
_dst_crs = partial(setting, "--dst-crs", "CRS", label="CRS of the output")
_every = partial(setting, "--every", "N", default=1, minimum=1, label="Every n-th point")
_ground = partial(setting, "--ground-method", default="auto", choices=_GROUND_METHODS, label="Ground classification")
_net_inset = partial(
    setting, "--net-inset", "ENDS,SIDES", default=(0.0, 0.0), label="Net parcels: metres off each end, off each side"
)
_net = partial(setting, "--net", "FILE", label="Net parcels from a file")
_scheduler = partial(setting, "--scheduler", "ADDRESS")
_within = partial(setting, "--within", "POLYGONS", label="Within polygons")
_workers = partial(setting, "--workers", "N", minimum=1)


@dataclass(frozen=True)
class SurfaceSettings(OptionSettings):
    """How surfaces of clouds are made.

    Attributes:
        cell_m: Cell size [default: the smallest round size with four points per cell].
        box: Keep points in this box, in the CRS of the output.
        box_crs: CRS of --bbox, if it differs.
        classes: Keep points of these classes [default: all but noise and, in furrowmap's own clouds, the machine].
        statistic: Height statistic per cell: median, trimmed, mean, min, max, or a percentile such as p90.
        ground: Ground classification method; auto uses the ground class of the input if there is one, else smrf.
        outliers: Outlier detection method; outliers are left out.
        every: Keep every N-th point.
        fill_m: Fill gaps up to this distance from the nearest measured height, but not beyond the outline of the data.
        tillage_heading_deg: Direction of tillage, clockwise from grid north; removes tillage marks from the random
            roughness.
        crs: CRS of input files without one.
        dst_crs: CRS of the output, in metres [default: that of the input].
        within: Keep points in these polygons: a vector file, a table of corners, a field of AgOpenGPS, or task data.

    Raises:
        UsageError: if there is no such statistic.
    """

    cell_m: float | None = setting("--cell", "METRES", above=0, label="Cell size")
    box: Box | None = _bbox()
    box_crs: CRS | str | None = _bbox_crs()
    classes: frozenset[int] | None = _classes()
    statistic: str = setting("--statistic", "NAME", default="median", label="Cell statistic")
    ground: GroundMethod | Literal["auto"] = _ground(choices=(*_GROUND_METHODS, "none"))
    outliers: Outliers = setting(
        "--outliers", default="none", choices=("none", "radius", "statistical"), label="Outlier detection method"
    )
    every: int = _every()
    fill_m: float = setting("--fill", "METRES", default=0.0, minimum=0, label="Maximum gap to fill")
    tillage_heading_deg: float | None = setting("--tillage", "DEGREES", label="Direction of tillage")
    crs: CRS | str | None = _crs()
    dst_crs: CRS | str | None = _dst_crs(label="CRS of the surfaces")
    within: str | Path | None = _within()

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.cell_statistic

    @property
    def cell_statistic(self) -> Statistic:
        """How the heights of a cell become one."""
        from furrowmap.core.surfaces.statistic import Statistic

        return Statistic.parse(self.statistic)


@dataclass(frozen=True)
class CleanSettings(OptionSettings):
    """How clouds are cleaned.

    Attributes:
        cleaning: Box, filters, thinning.
        box_crs: CRS of --bbox, if it differs.
        crs: CRS of input files without one.
        dst_crs: CRS of the output, in metres [default: that of the input].
        within: Keep points in these polygons: a vector file, a table of corners, a field of AgOpenGPS, or task data.
    """

    cleaning: Cleaning = field(default_factory=Cleaning)
    box_crs: CRS | str | None = _bbox_crs()
    crs: CRS | str | None = _crs()
    dst_crs: CRS | str | None = _dst_crs(label="CRS of the clean point cloud")
    within: str | Path | None = _within()


@dataclass(frozen=True)
class FeatureSettings(OptionSettings):
    """How features of clouds are found.

    Attributes:
        ground: Ground classification method; auto uses the ground class of the input if there is one, else smrf.
        cell_m: Voxel size, the smallest detail [default: the point spacing, 0.05 to 0.4].
        every: Keep every N-th point.
        box: Keep points in this box, in the CRS of the output.
        box_crs: CRS of --bbox, if it differs.
        crs: CRS of input files without one.
        dst_crs: CRS of the output, in metres [default: that of the input].
        within: Keep points in these polygons: a vector file, a table of corners, a field of AgOpenGPS, or task data.
    """

    ground: Literal["auto", "class", "smrf", "csf"] = _ground()
    cell_m: float | None = setting("--voxel", "METRES", minimum=0.02, maximum=2.0, label="Voxel size")
    every: int = _every()
    box: Box | None = _bbox()
    box_crs: CRS | str | None = _bbox_crs()
    crs: CRS | str | None = _crs()
    dst_crs: CRS | str | None = _dst_crs()
    within: str | Path | None = _within()


@dataclass(frozen=True)
class ParcelSettings(OptionSettings):
    """How crops are measured by parcel.

    Attributes:
        net_inset_m: Metres to cut off each end and off each side of the gross parcels [default: none].
        net: Net parcels with the same identifiers, instead of an inset.
        method: Method for heights and volumes: the canopy's top, unbiased by point density, or as published in 2017.
        soil: Soil below the crop: a surface through the bare soil around the parcels, a plane around each, or another
            survey: a surface or terrain model (GeoTIFF), a cloud of bare soil, or the folder of a result.
        compare: Also compute the published method.
        classes: Keep points of these classes [default: all but noise and, in furrowmap's own clouds, the machine].
        crs: CRS of input files without one.
        dst_crs: CRS of the output, in metres [default: that of the input].
        treatments: CSV or spreadsheet with what each parcel or treatment received.
        day: Day up to which doses are summed [default: that of the points].

    Raises:
        UsageError: if there is no such method, or the day is no date.
        InputError: if there is no such survey of the soil.
    """

    net_inset_m: tuple[float, float] = _net_inset()
    net: str | Path | None = _net()
    method: Method = setting(
        "--method",
        default="canopy-top",
        choices=("canopy-top", "christiansen2017"),
        label="Method for heights and volumes",
    )
    soil: str | Path = setting("--soil", "surface|plane|FILE", default="surface", label="Soil below the crop")
    compare: bool = setting("--compare", default=False, label="Compute the published method, too")
    classes: frozenset[int] | None = _classes()
    crs: CRS | str | None = _crs()
    dst_crs: CRS | str | None = _dst_crs()
    treatments: str | Path | None = setting("--treatments", "FILE")
    day: str | None = setting("--day", "DATE", label="Day of the flight")

    def __post_init__(self) -> None:
        from furrowmap.core.crops.trial_tables import day_of

        super().__post_init__()
        soil_file(self.soil)
        day_of(self.day)

    @property
    def published(self) -> bool:
        """Whether the published method is computed."""
        return self.compare or self.method == "christiansen2017"


def soil_file(source: str | Path) -> Path | None:
    """The file with the soil of another survey; None where it is that around the parcels."""
    from furrowmap.core.values.parcel import SOIL_METHODS
    from furrowmap.exporters.files.result_folder import CLOUD, DSM, DTM

    if source in SOIL_METHODS:
        return None
    path = Path(source)
    names = (DTM, DSM, CLOUD)
    if path.is_dir():
        path = next((path / name for name in names if (path / name).is_file()), path)
    if not path.is_file():
        raise InputError(
            "soil-missing",
            path=path,
            is_path=path.is_dir(),
            names=", ".join(names),
            soil_methods=", ".join(SOIL_METHODS),
        )
    return path


@dataclass(frozen=True)
class GrowthSettings(OptionSettings):
    """How the growth of parcels is measured.

    Attributes:
        days: Day of the flight, once for each CLOUD [default: that of its points].
        net_inset_m: Metres to cut off each end and off each side of the gross parcels [default: none].
        net: Net parcels with the same identifiers, instead of an inset.
        classes: Keep points of these classes [default: all but noise and, in furrowmap's own clouds, the machine].
        crs: CRS of input files without one.
        dst_crs: CRS of the output, in metres [default: that of the input].
    """

    days: tuple[str, ...] | None = setting("--day", "DATE", multiple=True, label="Days of the flights")
    net_inset_m: tuple[float, float] = _net_inset()
    net: str | Path | None = _net()
    classes: frozenset[int] | None = _classes()
    crs: CRS | str | None = _crs()
    dst_crs: CRS | str | None = _dst_crs()


@dataclass(frozen=True)
class CanopySettings(OptionSettings):
    """How a canopy is described.

    Attributes:
        cell_m: Describe square cells with sides of this length.
        polygons: Describe these polygons instead of cells.
        pixel_m: Pixel of the canopy height model [default: the smallest round size with four points, up to 1 m].
        ground_m: Returns up to this height count as ground; in forests 2 is usual.
        layer_m: Height of a layer of the profile.
        ground: Ground classification method; auto uses the ground class of the input if there is one, else smrf.
        box: Keep points in this box, in the CRS of the output.
        classes: Keep points of these classes [default: all but noise and, in furrowmap's own clouds, the machine].
        crs: CRS of input files without one.
        dst_crs: CRS of the output, in metres [default: that of the input].

    Raises:
        UsageError: if there are neither cells nor polygons, or both, or a size is not above zero.
    """

    cell_m: float | None = setting("--cell", "METRES", above=0, label="Side of the cells")
    polygons: str | Path | None = setting("--polygons", "FILE", label="Polygons instead of cells")
    pixel_m: float | None = setting("--pixel", "METRES", above=0, label="Pixel of the canopy height model")
    ground_m: float = setting(
        "--ground-height", "METRES", default=0.2, minimum=0, label="Highest return from the ground"
    )
    layer_m: float = setting("--layer", "METRES", default=0.5, above=0, label="Height of a layer of the profile")
    ground: GroundMethod | Literal["auto"] = _ground()
    box: Box | None = _bbox()
    classes: frozenset[int] | None = _classes()
    crs: CRS | str | None = _crs()
    dst_crs: CRS | str | None = _dst_crs()

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.cell_m is None) == (self.polygons is None):
            key = "usage.neither" if self.cell_m is None else "usage.both"
            raise UsageError(key, one="--cell", other="--polygons")


@dataclass(frozen=True)
class ResponseSettings(OptionSettings):
    """What responds to what.

    Attributes:
        measure: Column of the response [default: mean_height_m].
        dose: Column of the dose [default: the first with a name such as n_kg_ha].
        model: Shape of the response; auto compares all and averages over them by weight.
        dose_price: Price of a unit of the dose, such as a kilogram of nitrogen, for the economic optimum.
        measure_price: Price of a unit of the measure, such as a tonne of grain per hectare.
        price_ratio: The first price over the second, instead of both.
        without_blocks: Leave out the effects of blocks.
        factors: Column of another factor beside the dose.
        covariate: Column of a covariate, such as the yield of the year before.
        sites: Column that tells sites or years apart, which are then evaluated together and each alone.
        days: Day of the flight, once for each TABLE.

    Raises:
        UsageError: if only one of two prices is stated, or a ratio beside them.
    """

    measure: str | None = setting("--measure", "COLUMN", label="Column of the measure")
    dose: str | None = setting("--dose", "COLUMN", label="Column of the dose")
    model: ModelName | Literal["auto"] = setting(
        "--model", default="auto", choices=_RESPONSE_MODELS, label="Shape of the response"
    )
    dose_price: float | None = setting("--dose-price", "PRICE", minimum=0.0, label="Price of a unit of the dose")
    measure_price: float | None = setting("--measure-price", "PRICE", above=0.0, label="Price of a unit of the measure")
    price_ratio: float | None = setting("--price-ratio", "RATIO", minimum=0.0, label="Ratio of these prices")
    without_blocks: bool = setting("--without-blocks", default=False, label="Leave out the effects of blocks")
    factors: tuple[str, ...] | None = setting("--factor", "COLUMN", multiple=True, label="Columns of other factors")
    covariate: str | None = setting("--covariate", "COLUMN", label="Column of a covariate")
    sites: tuple[str, ...] | None = setting("--site", "COLUMN", multiple=True, label="Columns of sites and years")
    days: tuple[str, ...] | None = setting("--day", "DATE", multiple=True, label="Days of the flights")

    def __post_init__(self) -> None:
        super().__post_init__()
        both = (self.dose_price is None, self.measure_price is None)
        if both[0] != both[1] or (self.price_ratio is not None and not all(both)):
            raise UsageError("usage.response-prices")

    @property
    def ratio(self) -> float | None:
        """Of the prices; None without them."""
        if self.dose_price is None or self.measure_price is None:
            return self.price_ratio
        return self.dose_price / self.measure_price


@dataclass(frozen=True)
class CheckSettings(OptionSettings):
    """How a product is checked.

    Attributes:
        targets: Detect targets at the points by intensity or colour, for the horizontal error.
        target_shape: Shape of the targets that the points' file does not name in a column target.
        diameter_m: Diameter of discs, side of checkerboards.
        checkerboard_m: Side of checkerboards beside discs of another size [default: that of --diameter].
        points_sigma_m: Standard deviation of the survey on each axis.
        class_m: Maximum vertical RMSE (else exit status 4).
        within: Compare points in these polygons: a vector file, a table of corners, a field of AgOpenGPS, or task data.
    """

    targets: Targets = setting("--targets", default="none", choices=("none", "intensity", "colour"), label="Targets")
    target_shape: TargetShape = setting(
        "--target-shape", default="disc", choices=("disc", "checkerboard"), label="Shape of the targets"
    )
    diameter_m: float = setting("--diameter", "METRES", default=0.3, above=0.0, label="Diameter or side of the targets")
    checkerboard_m: float | None = setting("--checkerboard", "METRES", above=0.0, label="Side of checkerboards")
    points_sigma_m: float | None = setting(
        "--points-sigma", "METRES", above=0.0, label="Standard deviation of the survey"
    )
    class_m: float | None = setting("--require-vertical", "METRES", above=0.0, label="Required vertical RMSE")
    within: str | Path | None = _within()

    @property
    def area_file(self) -> Path | None:
        """The file of the polygons."""
        return Path(self.within) if self.within is not None else None


@dataclass(frozen=True)
class EvaluationSettings(OptionSettings):
    """How a log is compared with a reference.

    Attributes:
        antenna_offset_m: Forward, left, up from the antenna of the reference to that of the log, on one vehicle.
        fixed_reference_only: fixed: leave out epochs without a fixed solution in the reference.
        max_gap_s: Maximum interpolation gap of the reference [default: 1.5 times its interval].
        date: UTC date of the first position, for logs without a date.
    """

    antenna_offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    fixed_reference_only: bool = setting(
        "--reference-fix", default=False, choices={"any": False, "fixed": True}, label="Epochs of the reference"
    )
    max_gap_s: float | None = setting("--max-gap", "SECONDS", above=0.0, label="Maximum interpolation gap")
    date: str | None = setting("--date", "YYYY-MM-DD", label="Date of the first position")


@dataclass(frozen=True)
class SolveSettings(OptionSettings):
    """How positions are computed.

    Attributes:
        base: Antenna of the base in degrees and metres above the ellipsoid [default: approximate, from its file].
        static: The rover stands still.
        mask_deg: Leave out satellites below this elevation.
        antennas: Calibrations of antennas (ANTEX, such as igs20.atx): positions are then from marker to marker.
    """

    base: tuple[float, float, float] | None = setting(
        "--base-position", "LAT,LON,HEIGHT", label="Position of the base station"
    )
    static: bool = setting("--static", default=False, label="The rover stands still")
    mask_deg: float = setting("--mask", "DEGREES", default=15.0, minimum=0.0, maximum=90.0, label="Elevation mask")
    antennas: str | Path | None = setting("--antennas", "FILE", label="Calibrations of antennas (ANTEX)")


@dataclass(frozen=True)
class BatchSettings(OptionSettings):
    """How a batch is done.

    Attributes:
        machine: Machine for recordings without a session: the name of a saved one, or its profile.
        boundaries: Boundaries of fields. Each recording runs once for each field that it enters, from entry to exit.
        workers: Number of worker processes [default: by cores and memory].
        scheduler: Use the workers of this Dask scheduler: tls://HOST:PORT, or tcp:// without encryption.
    """

    machine: str | Path | None = setting("--machine", "NAME|FILE")
    boundaries: str | Path | None = setting("--boundaries", "FILE")
    workers: int | None = _workers()
    scheduler: str | None = _scheduler()


@dataclass(frozen=True)
class SeasonSettings(OptionSettings):
    """Options of a season.

    Attributes:
        content: Products to write. May be repeated [default: all].
        crs: CRS of all products [default: that of the sessions].
        cell_m: Cell size of the mosaics [default: that of the latest surface].
        spacing_m: Thin the points to this spacing; 0 keeps all points.
        most_rows: Maximum number of rows of a Parquet file.
        workers: Number of worker processes [default: by cores and memory].
        scheduler: Use the workers of this Dask scheduler: tls://HOST:PORT, or tcp:// without encryption.
    """

    content: Sequence[str] = setting(
        "--content", default=(), choices=("mosaics", "points", "trajectories"), multiple=True
    )
    crs: CRS | str | None = _dst_crs()
    cell_m: float | None = setting("--cell", "METRES", above=0)
    spacing_m: float = setting("--spacing", "METRES", default=0.0, minimum=0)
    most_rows: int = setting("--most-rows", "N", default=5_000_000, minimum=1)
    workers: int | None = _workers()
    scheduler: str | None = _scheduler()


@dataclass(frozen=True)
class TieSettings(OptionSettings):
    """How dates are tied.

    Attributes:
        reference: Move the dates onto this surveyed surface (GeoTIFF) or these points (table, vector file,
            Elevation.txt).
        reference_sigma_m: Standard deviation of the heights of the reference.
    """

    reference: str | Path | None = setting("--reference", "FILE", label="Surveyed surface or points")
    reference_sigma_m: float = setting(
        "--reference-sigma", "METRES", default=0.0, minimum=0, label="Standard deviation of its heights"
    )


@dataclass(frozen=True)
class MosaicSettings(OptionSettings):
    """Options of a mosaic.

    Attributes:
        crs: CRS of the raster [default: that of the surfaces].
        cell_m: Cell size.
        mean: Average overlapping sessions instead of using the latest.
    """

    crs: CRS | str | None = _dst_crs(label="CRS of the mosaic")
    cell_m: float | None = setting("--cell", "METRES", above=0, label="Cell size")
    mean: bool = setting("--mean", default=False, label="Mean of all sessions")


@dataclass(frozen=True)
class TrafficSettings(OptionSettings):
    """What counts as traffic.

    Attributes:
        season: Only the season that begins in this year.
        since: Only sessions from this day on.
        until: Only sessions up to this day.
        cell_m: Cell size.
        wheels: Of the rear axle; None leaves their band out.
    """

    season: int | None = setting("--season", "YEAR")
    since: dt.date | None = setting("--since", "DAY", label="First day")
    until: dt.date | None = setting("--until", "DAY", label="Last day")
    cell_m: float = setting("--cell", "METRES", default=0.1, above=0, label="Cell size")
    wheels: Wheels | None = None

    def plain(self) -> dict[str, str]:
        """What is stated, as texts."""
        said: dict[str, object] = {"season": self.season, "since": self.since, "until": self.until}
        if self.wheels is not None:
            said |= {"track_width_m": self.wheels.track_width_m, "tyre_width_m": self.wheels.tyre_width_m}
        return {key: str(value) for key, value in said.items() if value is not None}
