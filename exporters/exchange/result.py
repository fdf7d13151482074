"""A folder of products as those see it who pass it on."""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from furrowmap.core.values.errors import InputError
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.staging import recover

if TYPE_CHECKING:
    import geopandas as gpd

FIELD = "field.gpkg"
REPORT = "report.json"


class _Crs(msgspec.Struct):
    map: str
    coordinates: str


class _Session(msgspec.Struct):
    name: str
    crs: _Crs
    lidar: dict[str, Any]


class _Figures(msgspec.Struct):
    start: str
    end: str
    points: int
    bounds_m: tuple[tuple[float, float, float], tuple[float, float, float]]


class _Coordinates(msgspec.Struct):
    frame: str | None
    epoch: float | None


class _Report(msgspec.Struct):
    """What is needed of a report."""

    furrowmap: str
    session: _Session
    inputs: list[dict[str, Any]]
    figures: _Figures
    coordinates: _Coordinates
    products: list[str]


@dataclass(frozen=True)
class Result:
    """What a run left in a folder.

    Attributes:
        folder: of the products.
        report: the content of `report.json`.
        layers: names of the layers of `field.gpkg`, those that a map shows on top first.
    """

    folder: Path
    report: dict[str, Any]
    layers: tuple[str, ...]

    @property
    def name(self) -> str:
        """The session's name; the folder's where it has none."""
        return str(self.report["session"]["name"]) or self.folder.resolve().name

    @property
    def origin(self) -> Origin:
        """Where what is passed on comes from."""
        return result_origin(self.report, self.name)

    def layer(self, name: str) -> gpd.GeoDataFrame:
        """The features of a layer in the session's CRS.

        Raises:
            InputError: if the file does not hold it, or is damaged.
        """
        import geopandas as gpd

        if name not in self.layers:
            raise InputError(
                f"{self.folder / FIELD} has no layer '{name}'.",
                "It cannot be passed on.",
                f"It has: {', '.join(self.layers)}.",
                code="no-such-layer",
            )
        try:
            return gpd.read_file(self.folder / FIELD, layer=name)
        except (OSError, RuntimeError, ValueError) as error:
            raise _unreadable(self.folder / FIELD, error) from None


def result_origin(report: dict[str, Any], name: str = "") -> Origin:
    """Where the products of a run come from, by their `report.json`.

    Args:
        report: its content.
        name: of the session, if another one than the report's is to be told.
    """
    name = name or str(report["session"]["name"])
    first, last = (dt.datetime.fromisoformat(report["figures"][key]).timestamp() for key in ("start", "end"))
    told = {**report["session"]["crs"], "frame": report["coordinates"]["frame"]}
    told["coordinate_epoch"] = report["coordinates"]["epoch"]
    return Origin(
        name,
        name,
        [(record["name"], record["sha256"]) for record in report["inputs"]],
        (first, last),
        {
            "result_of": f"furrowmap {report['furrowmap']}",
            **{key: str(value) for key, value in told.items() if value},
        },
    )


def open_result(folder: Path) -> Result:
    """The products in `folder`.

    Raises:
        InputError: if there are none, or what is there cannot be read.
        RefusedError: if a run is writing them just now.
    """
    from furrowmap.exporters.vectors.ogr import pyogrio

    if folder.is_dir():
        recover(folder)
    try:
        report = msgspec.json.decode((folder / REPORT).read_bytes(), type=dict[str, Any])
        msgspec.convert(report, _Report)
    except FileNotFoundError:
        raise InputError(
            f"{folder} holds no {REPORT}.",
            "It is no folder that `furrowmap run` wrote.",
            "Name the folder of the products, the one that the run told at its end.",
            code="no-result",
        ) from None
    except (ValueError, msgspec.ValidationError) as error:
        raise _unreadable(folder / REPORT, error) from None
    try:
        layers = [str(name) for name, kind in pyogrio.list_layers(folder / FIELD) if kind is not None]
    except (RuntimeError, ValueError) as error:  # pyogrio's own errors are RuntimeErrors
        raise _unreadable(folder / FIELD, error) from None
    return Result(folder, report, tuple(layers))


def _unreadable(path: Path, error: Exception) -> InputError:
    return InputError(
        f"{path} cannot be read ({error}).",
        "It is missing or damaged, so there is nothing to pass on.",
        "Run the session again: `furrowmap run session.toml -o` and this folder.",
        code="result-unreadable",
    )
