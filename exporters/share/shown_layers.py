"""The layers and rasters of a shared result: names for people, order, what is shown."""

from pathlib import Path
from typing import Final

from furrowmap.exporters.files.result_folder import (
    CHANGE,
    DSM,
    DSM_BEFORE,
    DTM,
    ORTHOPHOTO,
    RUN_RASTERS,
    ResultFolder,
    packaged_style,
    style_of,
)
from furrowmap.exporters.rasters.field_rasters import STYLES
from furrowmap.exporters.vectors.labels import SHARED_LAYERS
from furrowmap.exporters.work_colours import WORKED_COLOUR

RELIEFS: Final = (DSM, DSM_BEFORE, DTM)
_ALWAYS: Final = ("boundary", "plants", "lines", "planes", "orthophoto", "dsm")
SHOWN_TOGETHER: Final = (
    (*_ALWAYS, "misses", "unworked", "overlaps", "coverage"),
    (*_ALWAYS, "trajectory", "events", "overlaps", "passes"),
    (*_ALWAYS, "parcels", "crop_height"),
    (*_ALWAYS, "trajectory", "change", "zones", "tool_path"),
    ("control_points", "trajectory", "boundary", "strip_differences", "swaths", "dsm"),
)
"""Layers that are seen together, as in the themes of the QGIS plugin: the first that a result has is shown at first."""
_IN_ANY: Final = frozenset({*_ALWAYS, "trajectory"})
"""Layers that make no theme of their own."""
WORKED_ALPHA: Final = 191
"""Of 255, as of the plugin: the relief below is seen."""
VALUE_RASTERS: Final = frozenset(RUN_RASTERS) - {*RELIEFS, ORTHOPHOTO}
"""Rasters that lie above the reliefs."""
BLENDED: Final = VALUE_RASTERS - {CHANGE}
"""Rasters whose colours blend with the relief below; those of the change are as in its legend, whose steps are fine."""


def rasters_of(result: ResultFolder) -> list[str]:
    """Names of the files, the topmost of the map first: colours, the orthophoto, reliefs."""
    order = [*(name for name in RUN_RASTERS if name in VALUE_RASTERS), ORTHOPHOTO, *RELIEFS]
    return [name for name in order if (result.folder / name).is_file()]


def shown_at_first(result: ResultFolder) -> frozenset[str]:
    """The keys of the layers and rasters that are switched on at first, as in QGIS; all of a result of one layer."""
    keys = {*result.layer_names, *(Path(name).stem for name in rasters_of(result))}
    alone = result.layer_names if len(result.layer_names) == 1 else ()
    first = next((theme for theme in SHOWN_TOGETHER if keys & (set(theme) - _IN_ANY)), SHOWN_TOGETHER[3])
    return frozenset([*first, *alone])


def vector_style(name: str) -> str:
    """The style (QML) of a layer; all ground worked is filled, as in QGIS, where no passes are below it."""
    style = packaged_style(f"{name}.qml")
    if name != "coverage":
        return style
    rgb = ",".join(str(int(WORKED_COLOUR[at : at + 2], 16)) for at in (1, 3, 5))
    filled = style.replace('value="0,0,0,0"', f'value="{rgb},{WORKED_ALPHA}"')
    return filled.replace('name="style" type="QString" value="no"', 'name="style" type="QString" value="solid"')


def raster_style(name: str) -> str:
    """Name of a raster's packaged style."""
    return STYLES.get(name, style_of(name))


def title_of(name: str, result: ResultFolder) -> str:
    """A raster's name for people, in English."""
    worked = result.report["figures"].get("worked_area_m2") is not None
    return "Surface" if name == DSM and not worked else SHARED_LAYERS[Path(name).stem]
