# SPDX-License-Identifier: GPL-2.0-or-later
"""Parameters that take a layer of the project or a file, and the file that the worker reads for a layer.

QGIS's own layer parameters load every file that they are given; these take a path as it is, since the worker reads
formats that QGIS does not, and a point cloud is not indexed for nothing.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from qgis.core import (
    QgsMapLayer,
    QgsProcessing,
    QgsProcessingContext,
    QgsProcessingFeedback,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterMapLayer,
    QgsProcessingParameterMultipleLayers,
    QgsProcessingParameterPointCloudLayer,
    QgsProcessingParameterVectorLayer,
    QgsProcessingUtils,
    QgsProviderRegistry,
    QgsVectorLayer,
)

from .description import Parameter

SOURCE_TYPES = QgsProcessing.SourceType
LAYER_GEOMETRIES = {
    "polygons": SOURCE_TYPES.TypeVectorPolygon,
    "points": SOURCE_TYPES.TypeVectorPoint,
    "table": SOURCE_TYPES.TypeVector,
}
"""What the lists of layers offer."""
READ_FORMATS = {"polygons": ("gpkg", "shp", "geojson", "fgb", "kml"), "points": ("gpkg",), "table": ("csv",)}
"""Formats of vector layers that the worker reads, the one first into which others are written."""


class _TakesPaths:
    """Accepts any layer and any text: a path is checked as that of a file."""

    def checkValueIsAcceptable(self: Any, value: Any, context: QgsProcessingContext | None = None) -> bool:  # noqa: N802, ARG002 - the names are QGIS's
        """Whether it is a layer or a text, or a list of them."""
        values = value if isinstance(value, list | tuple) else [value]
        given = [each for each in values if each not in (None, "")]
        optional = bool(self.flags() & self.Flag.FlagOptional)
        return (bool(given) or optional) and all(isinstance(each, str | QgsMapLayer) for each in given)


class LayersOrFiles(_TakesPaths, QgsProcessingParameterMultipleLayers):
    """Several layers or files."""


class CloudOrFile(_TakesPaths, QgsProcessingParameterPointCloudLayer):
    """A point cloud."""


class RasterOrCloudOrFile(_TakesPaths, QgsProcessingParameterMapLayer):
    """A raster or a point cloud."""


class VectorOrFile(_TakesPaths, QgsProcessingParameterVectorLayer):
    """A vector layer."""


def layer_parameter(parameter: Parameter, given: dict[str, Any]) -> QgsProcessingParameterDefinition:
    """The definition of a :class:`.description.Parameter` with `layers`."""
    if parameter.kind == "files":
        return LayersOrFiles(**given, layerType=LAYER_GEOMETRIES.get(parameter.layers, SOURCE_TYPES.TypePointCloud))
    if parameter.layers == "cloud":
        return CloudOrFile(**given)
    if parameter.layers == "raster or cloud":
        return RasterOrCloudOrFile(**given, types=[SOURCE_TYPES.TypeRaster, SOURCE_TYPES.TypePointCloud])
    return VectorOrFile(**given, types=[LAYER_GEOMETRIES[parameter.layers]])


def layer_files(
    parameter: Parameter, value: Any, context: QgsProcessingContext, feedback: QgsProcessingFeedback
) -> list[str]:
    """The files of a value: a path, a layer, its id, name or source, or a list of these.

    A vector layer that is not one whole file of :data:`READ_FORMATS` (a layer among others in a GeoPackage, a filter, a
    scratch layer, a database) is written to a temporary file.
    """
    return [_file(parameter, each, context, feedback) for each in _each(value)]


def first_unknown(parameter: Parameter, value: Any, context: QgsProcessingContext) -> str:
    """The first text of a value that is neither a file nor a layer; "" if there is none."""
    return next(
        (str(each) for each in _each(value) if _layer(parameter, each, context) is None and not _is_file(each)), ""
    )


def _each(value: Any) -> list[Any]:
    values = value if isinstance(value, list | tuple) else [value]
    return [each for each in values if each not in (None, "")]


def _is_file(value: Any) -> bool:
    return isinstance(value, str) and Path(value).exists()


def _layer(parameter: Parameter, value: Any, context: QgsProcessingContext) -> QgsMapLayer | None:
    """The layer of a value; None for a path. Only a vector's source that names a layer within a file is opened."""
    if isinstance(value, QgsMapLayer) or _is_file(value):
        return value if isinstance(value, QgsMapLayer) else None
    return QgsProcessingUtils.mapLayerFromString(value, context, parameter.layers in READ_FORMATS and "|" in value)


def _file(parameter: Parameter, value: Any, context: QgsProcessingContext, feedback: QgsProcessingFeedback) -> Any:
    layer = _layer(parameter, value, context)
    if layer is None:
        return value
    if not isinstance(layer, QgsVectorLayer):
        return (
            QgsProviderRegistry.instance().decodeUri(layer.providerType(), layer.source()).get("path") or layer.source()
        )
    formats = READ_FORMATS[parameter.layers]
    return QgsProcessingUtils.convertToCompatibleFormat(
        layer,
        False,  # noqa: FBT003 - not only what is selected
        parameter.name.lower(),
        list(formats),
        formats[0],
        context,
        feedback,
    )
