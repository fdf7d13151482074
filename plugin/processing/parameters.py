# SPDX-License-Identifier: GPL-2.0-or-later
"""Descriptions of parameters and outputs as QGIS's own objects."""

from __future__ import annotations

from collections.abc import Callable

from qgis.core import (
    QgsProcessing,
    QgsProcessingOutputBoolean,
    QgsProcessingOutputDefinition,
    QgsProcessingOutputFile,
    QgsProcessingOutputFolder,
    QgsProcessingOutputMultipleLayers,
    QgsProcessingOutputNumber,
    QgsProcessingOutputRasterLayer,
    QgsProcessingOutputString,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterCrs,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterEnum,
    QgsProcessingParameterExtent,
    QgsProcessingParameterFile,
    QgsProcessingParameterFileDestination,
    QgsProcessingParameterFolderDestination,
    QgsProcessingParameterMultipleLayers,
    QgsProcessingParameterNumber,
    QgsProcessingParameterPoint,
    QgsProcessingParameterRasterDestination,
    QgsProcessingParameterString,
)

from .description import Output, Parameter
from .layer_files import layer_parameter

OUTPUTS = {
    "boolean": QgsProcessingOutputBoolean,
    "file": QgsProcessingOutputFile,
    "folder": QgsProcessingOutputFolder,
    "layers": QgsProcessingOutputMultipleLayers,
    "number": QgsProcessingOutputNumber,
    "raster": QgsProcessingOutputRasterLayer,
    "text": QgsProcessingOutputString,
}


def qgis_output(output: Output, translate: Callable[[str], str]) -> QgsProcessingOutputDefinition:
    """The definition of an :class:`.description.Output`; `translate` gives texts in the user's language."""
    return OUTPUTS[output.kind](output.name, translate(output.label))


def qgis_parameter(parameter: Parameter, translate: Callable[[str], str]) -> QgsProcessingParameterDefinition:
    """The definition of a :class:`.description.Parameter`; `translate` gives texts in the user's language."""
    unit = f" ({parameter.unit})" if parameter.unit else ""
    definition = _definition(parameter, translate(parameter.label) + unit)
    definition.setHelp(translate(parameter.help))
    if parameter.advanced:
        definition.setFlags(definition.flags() | QgsProcessingParameterDefinition.Flag.FlagAdvanced)
    if parameter.adds:
        definition.setMetadata({"widget_wrapper": {"dontconfirmoverwrite": True}})
    return definition


def _definition(parameter: Parameter, label: str) -> QgsProcessingParameterDefinition:
    name, kind, default = parameter.name, parameter.kind, parameter.default
    given = {"name": name, "description": label, "optional": parameter.optional}
    created = {"createByDefault": not parameter.optional}
    if kind == "flag":
        return QgsProcessingParameterBoolean(name, label, defaultValue=False)
    if kind in ("choice", "choices"):
        several = {"allowMultiple": kind == "choices", "usesStaticStrings": True}
        return QgsProcessingParameterEnum(**given, options=parameter.choices, defaultValue=default, **several)
    if kind in ("integer", "number"):
        types = QgsProcessingParameterNumber.Type
        limits = {"minValue": parameter.minimum, "maxValue": parameter.maximum}
        return QgsProcessingParameterNumber(
            **given,
            type=types.Integer if kind == "integer" else types.Double,
            defaultValue=default,
            **{key: value for key, value in limits.items() if value is not None},
        )
    if parameter.layers:
        return layer_parameter(parameter, given)
    if kind == "files":
        return QgsProcessingParameterMultipleLayers(**given, layerType=QgsProcessing.SourceType.TypeFile)
    if kind == "file":
        return QgsProcessingParameterFile(**given, fileFilter=parameter.filter)
    if kind == "new file":
        return QgsProcessingParameterFileDestination(**given, fileFilter=parameter.filter, **created)
    if kind == "new folder":
        return QgsProcessingParameterFolderDestination(**given, **created)
    if kind == "new raster":
        return QgsProcessingParameterRasterDestination(**given, **created)
    if kind == "crs":
        return QgsProcessingParameterCrs(**given, defaultValue=default)
    if kind == "extent":
        return QgsProcessingParameterExtent(**given)
    if kind == "point":
        return QgsProcessingParameterPoint(**given)
    return QgsProcessingParameterString(**given, defaultValue=default, multiLine=kind == "texts")
