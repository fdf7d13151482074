"""The layers and rasters of a shared result: names for people in English and Japanese, order, what is shown."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Final

from furrowmap.exporters.files.result_folder import (
    CHANGE,
    CROP_HEIGHT,
    DSM,
    DSM_BEFORE,
    DTM,
    ORTHOPHOTO,
    RUN_RASTERS,
    ResultFolder,
    style_of,
)
from furrowmap.exporters.rasters.field_rasters import STYLES

LAYER_TITLES: Final = {
    "events": "Events",
    "trajectory": "Positions of the vehicle",
    "tool_path": "Path of the tool",
    "misses": "Missed ground",
    "unworked": "Ground not worked yet",
    "boundary": "Field boundary",
    "overlaps": "Ground worked twice",
    "coverage": "Worked ground",
    "passes": "Passes",
    "zones": "Headland and body of the field",
    "strips": "Strips of the flight",
    "strip_differences": "Height differences of strips",
    "parcels": "Parcels",
    "change": "Height change (m)",
    "swaths": "Height difference of swaths (mm)",
    "dsm": "Relief after the work",
    "dsm_before": "Relief before the work",
    "dtm": "Relief of the ground",
    "height_above_ground": "Height above ground (m)",
    "density": "Points a square metre",
    "strip_overlap": "Number of strips",
    "crop_height": "Height of the crop (m)",
    "orthophoto": "Orthophoto",
}
"""Names of layers for people; rasters as in the legends of the QGIS plugin."""

JAPANESE: Final[Mapping[str, str]] = tomllib.loads(
    files("furrowmap.exporters.share").joinpath("japanese.toml").read_text("utf-8")
)
"""English text to Japanese; where the QGIS plugin has the text, in its words."""
RELIEFS: Final = (DSM, DSM_BEFORE, DTM)
SHOWN_AT_FIRST: Final = frozenset({CHANGE, CROP_HEIGHT, DSM, ORTHOPHOTO})
VALUE_RASTERS: Final = frozenset(RUN_RASTERS) - {*RELIEFS, ORTHOPHOTO}
"""Rasters that lie above the reliefs."""
BLENDED: Final = VALUE_RASTERS - {CHANGE}
"""Rasters whose colours blend with the relief below; those of the change are as in its legend, whose steps are fine."""


def rasters_of(result: ResultFolder) -> list[str]:
    """Names of the files, the topmost of the map first: colours, the orthophoto, reliefs."""
    order = [*(name for name in RUN_RASTERS if name in VALUE_RASTERS), ORTHOPHOTO, *RELIEFS]
    return [name for name in order if (result.folder / name).is_file()]


def raster_style(name: str) -> str:
    """Name of a raster's packaged style."""
    return STYLES.get(name, style_of(name))


def title_of(name: str, result: ResultFolder) -> str:
    """A raster's name for people, in English."""
    worked = result.report["figures"].get("worked_area_m2") is not None
    return "Relief" if name == DSM and not worked else LAYER_TITLES[Path(name).stem]
