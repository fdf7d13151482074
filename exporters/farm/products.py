"""What a run left in a folder, as far as a base map takes it: its report and the layers of the field."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS

from furrowmap.core.values.errors import InputError
from furrowmap.exporters.exchange.result import FIELD, REPORT, open_result
from furrowmap.exporters.vectors.field_layers import Layer
from furrowmap.exporters.vectors.ogr import pyogrio

TRAJECTORY: Final = "trajectory"
_SESSION: Final = "session.toml"
_NAME: Final = re.compile(r"[a-z][a-z0-9_]{0,40}")
"""Layers of other names are not a run's."""


@dataclass(frozen=True)
class Products:
    """The products in a folder.

    Attributes:
        report: the content of `report.json`: it tells the session's name, CRS and heights, its inputs and figures.
        report_text: the same as it stands in the file.
        session_text: of `session.toml`; None where that is missing.
        digest: of the report and the layers' file.
        crs: of all layers.
        layers: those of `field.gpkg` by name, `trajectory` (which has positions) among them.
    """

    report: dict[str, Any]
    report_text: str
    session_text: str | None
    digest: str
    crs: CRS
    layers: Mapping[str, Layer]


def read_products(folder: Path) -> Products:
    """The products that `furrowmap run` left in `folder`; the cloud is not read.

    Raises:
        InputError: if there are none, or they cannot be read.
        RefusedError: if a run is writing them just now.
    """
    names = open_result(folder).layers
    try:
        return _read(folder, names)
    except (KeyError, TypeError, ValueError, RuntimeError) as error:  # pyogrio's own errors are RuntimeErrors
        raise InputError(
            f"{folder}: {REPORT} and {FIELD} are not as a run writes them ({type(error).__name__}: {error}).",
            "Without them nobody can say which session this is and where it lies, so nothing was done.",
            "Run the session again: `furrowmap run session.toml -o` and this folder.",
            code="result-unreadable",
        ) from None


def _read(folder: Path, names: tuple[str, ...]) -> Products:
    text = (folder / REPORT).read_bytes()
    digest = hashlib.sha256(text)
    with (folder / FIELD).open("rb") as file:
        digest.update(hashlib.file_digest(file, "sha256").digest())
    report = json.loads(text)
    _check_report(report)
    layers = {name: _layer(folder / FIELD, name) for name in names if _NAME.fullmatch(name)}
    if not len(layers[TRAJECTORY].shapes):
        raise ValueError("there are no positions")
    session = folder / _SESSION
    return Products(
        report=report,
        report_text=text.decode("utf-8"),
        session_text=session.read_text("utf-8") if session.is_file() else None,
        digest=digest.hexdigest(),
        crs=CRS.from_user_input(pyogrio.read_info(folder / FIELD, layer=TRAJECTORY)["crs"]),
        layers=layers,
    )


def _check_report(report: Any) -> None:
    """See that what tells the session's identity is there.

    Raises:
        KeyError: if it is not.
        TypeError: likewise.
        ValueError: likewise.
    """
    known = {
        "session.name": report["session"]["name"],
        "session.crs.heights": report["session"]["crs"]["heights"],
        **{f"inputs[{i}].name": record["name"] for i, record in enumerate(report["inputs"])},
        **{f"inputs[{i}].sha256": record["sha256"] for i, record in enumerate(report["inputs"])},
    }
    wrong = [key for key, value in known.items() if not isinstance(value, str)]
    if wrong or not isinstance(report["figures"], dict):
        raise ValueError(f"{', '.join(wrong) or 'figures'} is of another kind")


def _layer(path: Path, name: str) -> Layer:
    meta, _, shapes, data = pyogrio.raw.read(path, layer=name)
    columns = {
        str(field): _values(values, str(kind))
        for field, kind, values in zip(meta["fields"], meta["dtypes"], data, strict=True)
    }
    kind = str(meta["geometry_type"])
    kind = f"2.5D {kind.removesuffix(' Z')}" if kind.endswith(" Z") else kind
    return Layer(name, kind, _description(path, name), array_of(shapely.from_wkb(shapes)), columns)


def _description(path: Path, name: str) -> str:
    return str((pyogrio.read_info(path, layer=name).get("layer_metadata") or {}).get("DESCRIPTION", ""))


def _values(values: NDArray[Any], kind: str) -> NDArray[Any]:
    """A column with its own type again: whole numbers come as floating ones where some are NULL."""
    if kind.startswith("int") and values.dtype.kind == "f":
        missing = np.isnan(values)
        return np.ma.MaskedArray(np.where(missing, 0, values).astype(kind), missing)
    return values


def array_of(shapes: Any) -> NDArray[np.object_]:
    """Geometries (n,), of which None are none."""
    out = np.empty(len(shapes), object)
    out[:] = shapes
    return out
