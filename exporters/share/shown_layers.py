"""The layers and rasters of a shared result: names for people, order, what is shown."""

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
from furrowmap.exporters.vectors.labels import SHARED_LAYERS

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
    return "Relief" if name == DSM and not worked else SHARED_LAYERS[Path(name).stem]
