"""What people read of layers, their columns and values, in English: the tables of `labels.toml`."""

import tomllib
from collections.abc import Mapping
from importlib.resources import files
from typing import Any, Final

_LABELS: Final[Mapping[str, Any]] = tomllib.loads(
    files("furrowmap.exporters.vectors").joinpath("labels.toml").read_text("utf-8")
)
COLUMN_LABELS: Final[Mapping[str, str]] = _LABELS["columns"]
"""Columns of all layers of a run."""
FARM_LABELS: Final[Mapping[str, str]] = _LABELS["farm_columns"]
"""Columns that only a farm map has."""
VALUES: Final[Mapping[str, Mapping[str, str]]] = {
    column: words for columns, words in _LABELS["values"].items() for column in columns.split()
}
"""Words for the values of a column, by its name."""
LAYER_NAMES: Final[Mapping[str, str]] = _LABELS["layers"]
FARM_LAYER_NAMES: Final[Mapping[str, str]] = {**LAYER_NAMES, **_LABELS["farm_layers"]}
SHARED_LAYERS: Final[Mapping[str, str]] = _LABELS["shared_layers"]
"""Layers and rasters of a shared result."""
