"""A result folder: the names of its files, and reading what a run wrote."""

import datetime as dt
import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, Final
from zoneinfo import ZoneInfo

import msgspec
import numpy as np
import shapely

from furrowmap.core.readers.ogr_layers import list_layers
from furrowmap.core.readers.sqlite_file import SIDECARS
from furrowmap.core.readers.vector_file import VectorLayer, read_vector_layer
from furrowmap.core.runtime.errors import FurrowmapError, InputError, RefusedError
from furrowmap.core.runtime.file_names import inside, read_own, resolved
from furrowmap.core.runtime.plain_reads import expect_plain_file
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.staging import recover, refuse_products

CLOUD: Final = "cloud.copc.laz"
DSM: Final = "dsm.tif"
DSM_BEFORE: Final = "dsm_before.tif"
CHANGE: Final = "change.tif"
SWATHS: Final = "swaths.tif"
DENSITY: Final = "density.tif"
STRIP_OVERLAP: Final = "strip_overlap.tif"
ORTHOPHOTO: Final = "orthophoto.tif"
FIELD: Final = "field.gpkg"
REPORT: Final = "report.json"
REPORT_PAGE: Final = "report.html"
SESSION_FILE: Final = "session.toml"
STATES: Final = "states.csv"
LEARNED: Final = "implement.npz"
ITEM: Final = "item.json"

PREVIEW_TRACK: Final = "preview_track.gpkg"
PREVIEW_DSM: Final = "preview_dsm.tif"
PREVIEW_REPORT: Final = "preview.json"

DTM: Final = "dtm.tif"
HEIGHT_ABOVE_GROUND: Final = "height_above_ground.tif"
HILLSHADE: Final = "hillshade.tif"
SLOPE: Final = "slope.tif"
ROUGHNESS: Final = "roughness.tif"
LOW_SPOTS: Final = "low_spots.tif"
LOW_SPOT_OUTLINES: Final = "low_spots.gpkg"
SURFACES_REPORT: Final = "surfaces.json"

CROP_HEIGHT: Final = "crop_height.tif"
PARCEL_TABLE: Final = "parcels.csv"
PARCEL_SHEET: Final = "parcels.xlsx"
PARCELS: Final = "parcels.gpkg"
PARCELS_REPORT: Final = "parcels.json"

CANOPY: Final = "canopy.gpkg"
CANOPY_HEIGHT: Final = "canopy_height.tif"
CANOPY_TABLE: Final = "canopy.csv"
CANOPY_PROFILES: Final = "canopy_profile.csv"
CANOPY_REPORT: Final = "canopy.json"

GROWTH: Final = "growth.gpkg"
GROWTH_TABLE: Final = "growth.csv"
GROWTH_WORKBOOK: Final = "growth.xlsx"
GROWTH_REPORT: Final = "growth.json"

TIE: Final = "tie.gpkg"
TIE_PAGE: Final = "tie.html"
TIE_REPORT: Final = "tie.json"

FEATURES: Final = "features.gpkg"
FEATURES_REPORT: Final = "features.json"

TRAJECTORY: Final = "trajectory"
"""The layer of `field.gpkg` that every result has."""
BOUNDARY: Final = "boundary"
"""The layer of `field.gpkg` with the field, where the session names its boundary."""


FURTHER_TOOLS: Final = (2, 3)
"""Numbers of the implements of a machine beside that which moves the soil."""


def of_tool(product: str, number: int) -> str:
    """Name of a product of one of several implements: the first has that of the only one."""
    stem, _, kind = product.partition(".")
    return product if number == 1 else f"{stem}_{number}.{kind}"


def style_of(raster: str) -> str:
    """Name of the style file beside a raster, which QGIS loads with it."""
    return str(Path(raster).with_suffix(".qml"))


def packaged_style(name: str) -> str:
    """A QGIS style of this package."""
    return files("furrowmap.exporters").joinpath("styles", name).read_text("utf-8")


def packaged_styles() -> frozenset[str]:
    """Names of the QGIS styles of this package."""
    return frozenset(style.name for style in files("furrowmap.exporters").joinpath("styles").iterdir())


RUN_RASTERS: Final = (
    DSM, DSM_BEFORE, CHANGE, SWATHS, DTM, HEIGHT_ABOVE_GROUND, DENSITY, STRIP_OVERLAP, CROP_HEIGHT, ORTHOPHOTO,
)  # fmt: skip
RUN_PRODUCTS: Final = (
    *(CLOUD, *RUN_RASTERS, PARCEL_TABLE, PARCEL_SHEET, *map(style_of, RUN_RASTERS), FIELD, LEARNED, STATES),
    *(of_tool(product, number) for product in (LEARNED, STATES) for number in FURTHER_TOOLS),
    *(REPORT, REPORT_PAGE, SESSION_FILE, ITEM),
)
"""All files that `furrowmap run` may write."""
RUN_FILES: Final = (*RUN_PRODUCTS, *(f"{FIELD}{suffix}" for suffix in SIDECARS))
"""All files that are read as those of a run."""
SURFACE_PRODUCTS: Final = (
    DSM, DTM, HEIGHT_ABOVE_GROUND, HILLSHADE, SLOPE, ROUGHNESS, LOW_SPOTS, LOW_SPOT_OUTLINES, SURFACES_REPORT,
)  # fmt: skip
"""All files that `furrowmap surface` may write."""
PARCEL_PRODUCTS: Final = (PARCELS, PARCEL_TABLE, PARCEL_SHEET, CROP_HEIGHT, style_of(CROP_HEIGHT), PARCELS_REPORT)
"""All files that `furrowmap parcels` may write."""
CANOPY_PRODUCTS: Final = (
    CANOPY, CANOPY_HEIGHT, style_of(CANOPY_HEIGHT), CANOPY_TABLE, CANOPY_PROFILES, CANOPY_REPORT,
)  # fmt: skip
"""All files that `furrowmap canopy` may write."""
GROWTH_PRODUCTS: Final = (GROWTH, GROWTH_TABLE, GROWTH_WORKBOOK, GROWTH_REPORT)
"""All files that `furrowmap growth` may write."""
FEATURE_PRODUCTS: Final = (CLOUD, FEATURES, FEATURES_REPORT)
"""All files that `furrowmap features` writes."""


class _Input(msgspec.Struct):
    name: str
    sha256: str


_Corner = tuple[float, float, float]
_Crs = msgspec.defstruct("_Crs", [("map", str), ("coordinates", str), ("heights", str)])
_Session = msgspec.defstruct("_Session", [("name", str), ("crs", _Crs), ("lidar", dict[str, Any])])
_Figures = msgspec.defstruct(
    "_Figures", [("start", dt.datetime), ("end", dt.datetime), ("points", int), ("bounds_m", tuple[_Corner, _Corner])]
)
_Coordinates = msgspec.defstruct("_Coordinates", [("frame", str | None), ("epoch", float | None)])
_Report = msgspec.defstruct(
    "_Report",
    [
        ("furrowmap", str), ("session", _Session), ("inputs", list[_Input]), ("figures", _Figures),
        ("coordinates", _Coordinates), ("products", list[str]), ("verdict", dict[str, Any] | None, None),
    ],
)  # fmt: skip
"""The keys of `report.json` that exports and farm maps need."""


def refuse_occupied(folder: Path, products: Iterable[str], shared: str, *, overwrite: bool) -> None:
    """Finish what an earlier process left in a folder, and check that products may go there, before the work.

    `shared` is the product that a run has under the same name; those of a run may not be replaced. Raises RefusedError
    if the folder holds products.
    """
    if not folder.is_dir():
        return
    recover(folder)
    if (folder / REPORT).exists():
        raise RefusedError("output-is-run", folder=folder, shared=shared)
    refuse_products(folder, products, overwrite=overwrite)


@dataclass(frozen=True)
class ResultFolder:
    """The result of a run; `layer_names` are those of `field.gpkg`, the topmost layer of a map first."""

    folder: Path
    report: dict[str, Any]
    layer_names: tuple[str, ...]

    @property
    def name(self) -> str:
        """The session's name; the folder's where it has none."""
        return str(self.report["session"]["name"]) or resolved(self.folder).name

    @property
    def origin(self) -> Origin:
        """Provenance of files made from this result."""
        return result_origin(self.report, self.name)

    @property
    def zone(self) -> ZoneInfo:
        """Time zone of the field; UTC where the report has none."""
        figures = self.report.get("figures")
        name = figures.get("time_zone") if isinstance(figures, dict) else None
        try:
            return ZoneInfo(str(name)) if name else ZoneInfo("UTC")
        except (OSError, ValueError, KeyError):  # a damaged report, or a zone that this system does not know
            return ZoneInfo("UTC")

    def layer(self, name: str) -> VectorLayer:
        """The features of a layer in the session's CRS."""
        if name not in self.layer_names:
            raise InputError(
                "no-such-layer", folder=self.folder / FIELD, name=name, layer_names=", ".join(self.layer_names)
            )
        with reading_result(self.folder / FIELD):
            layer = read_vector_layer(self.folder / FIELD, name)
            if layer.crs is None or not np.isfinite(shapely.get_coordinates(layer.shapes)).all():
                raise ValueError(f"layer '{name}' has no CRS, or coordinates that are not finite")
        return layer


def result_origin(report: dict[str, Any], name: str = "") -> Origin:
    """Provenance of files made from the result of a run; `name` is the session's, if not that in the report."""
    name = name or str(report["session"]["name"])
    first, last = (dt.datetime.fromisoformat(report["figures"][key]).timestamp() for key in ("start", "end"))
    stated = {**report["session"]["crs"], "frame": report["coordinates"]["frame"]}
    stated["coordinate_epoch"] = report["coordinates"]["epoch"]
    return Origin(
        name,
        name,
        [(record["name"], record["sha256"]) for record in report["inputs"]],
        (first, last),
        {
            "result_of": f"furrowmap {report['furrowmap']}",
            **{key: str(value) for key, value in stated.items() if value},
        },
    )


def open_result(folder: Path) -> ResultFolder:
    """Open a result; raises InputError if there is none or it cannot be read, RefusedError while a run is writing."""
    recover(folder)
    for name in RUN_FILES:
        path = inside(folder, name, folder)
        try:
            if path.exists():
                expect_plain_file(path)
        except OSError as error:
            raise unreadable(path, error) from None
    try:
        report = msgspec.json.decode(read_own(folder, REPORT), type=dict[str, Any])
        msgspec.convert(report, _Report)
    except (FileNotFoundError, NotADirectoryError):
        raise InputError("no-result", folder=folder) from None
    except (ValueError, RecursionError, msgspec.ValidationError) as error:
        raise unreadable(folder / REPORT, error) from None
    try:
        layers = [name for name, kind in list_layers(folder / FIELD) if kind is not None]
    except (OSError, RuntimeError, ValueError, sqlite3.Error) as error:  # pyogrio's own errors are RuntimeErrors
        raise unreadable(folder / FIELD, error) from None
    return ResultFolder(folder, report, tuple(layers))


@contextmanager
def reading_result(folder: Path) -> Iterator[None]:
    """Within it, whatever a library raises on the damaged content of a result becomes InputError."""
    try:
        yield
    except (FurrowmapError, OSError, MemoryError, ImportError):
        raise
    except Exception as error:
        raise unreadable(folder, error) from error


def unreadable(path: Path, error: Exception) -> InputError:
    """The error for a missing or damaged file of a result."""
    return InputError("result-unreadable.damaged-file", path=path, name=type(error).__name__, error=error)
