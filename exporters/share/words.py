"""The texts of a page in English and Japanese."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from importlib.resources import files
from typing import Final

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
    "swaths": "Height difference of swaths (m)",
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
RELIEF: Final = "Relief"
"""Name of `dsm.tif` where no work is known."""

JAPANESE: Final[Mapping[str, str]] = tomllib.loads(
    files("furrowmap.exporters.share").joinpath("japanese.toml").read_text("utf-8")
)
"""English text to Japanese; where the QGIS plugin has the text, in its words."""
