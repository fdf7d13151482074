# SPDX-License-Identifier: GPL-2.0-or-later
"""Descriptions of parameters and outputs as QGIS's own objects."""

from __future__ import annotations

from collections.abc import Callable

from qgis import core

from .description import Output, Parameter
from .layer_files import layer_parameter

OUTPUTS = {
    "boolean": core.QgsProcessingOutputBoolean,
    "file": core.QgsProcessingOutputFile,
    "folder": core.QgsProcessingOutputFolder,
    "layers": core.QgsProcessingOutputMultipleLayers,
    "number": core.QgsProcessingOutputNumber,
    "raster": core.QgsProcessingOutputRasterLayer,
    "text": core.QgsProcessingOutputString,
}


def qgis_output(output: Output, translate: Callable[[str], str]) -> core.QgsProcessingOutputDefinition:
    """The definition of an :class:`.description.Output`; `translate` gives texts in the user's language."""
    return OUTPUTS[output.kind](output.name, translate(output.label))


def qgis_parameter(parameter: Parameter, translate: Callable[[str], str]) -> core.QgsProcessingParameterDefinition:
    """The definition of a :class:`.description.Parameter`; `translate` gives texts in the user's language."""
    unit = f" ({parameter.unit})" if parameter.unit else ""
    definition = _definition(parameter, translate(parameter.label) + unit)
    definition.setHelp(translate(parameter.help))
    if parameter.advanced:
        definition.setFlags(definition.flags() | core.QgsProcessingParameterDefinition.Flag.FlagAdvanced)
    if parameter.adds:
        definition.setMetadata({"widget_wrapper": {"dontconfirmoverwrite": True}})
    if parameter.lists == "fields":
        definition.setMetadata({"widget_wrapper": {"class": f"{__package__}.field_list.FieldListWrapper"}})
    return definition


def _definition(parameter: Parameter, label: str) -> core.QgsProcessingParameterDefinition:
    name = parameter.name
    kind = parameter.kind
    default = parameter.default
    given = {"name": name, "description": label, "optional": parameter.optional}
    created = {"createByDefault": not parameter.optional}
    if kind == "flag":
        return core.QgsProcessingParameterBoolean(name, label, defaultValue=False)
    if kind in ("choice", "choices"):
        several = {"allowMultiple": kind == "choices", "usesStaticStrings": True}
        return core.QgsProcessingParameterEnum(**given, options=parameter.choices, defaultValue=default, **several)
    if kind in ("integer", "number"):
        types = core.QgsProcessingParameterNumber.Type
        limits = {"minValue": parameter.minimum, "maxValue": parameter.maximum}
        return core.QgsProcessingParameterNumber(
            **given,
            type=types.Integer if kind == "integer" else types.Double,
            defaultValue=default,
            **{key: value for key, value in limits.items() if value is not None},
        )
    if parameter.layers:
        return layer_parameter(parameter, given)
    if kind == "files":
        return core.QgsProcessingParameterMultipleLayers(**given, layerType=core.QgsProcessing.SourceType.TypeFile)
    if kind == "file":
        return core.QgsProcessingParameterFile(**given, fileFilter=parameter.filter)
    if kind == "new file":
        return core.QgsProcessingParameterFileDestination(**given, fileFilter=parameter.filter, **created)
    if kind == "new folder":
        return core.QgsProcessingParameterFolderDestination(**given, **created)
    if kind == "new raster":
        return core.QgsProcessingParameterRasterDestination(**given, **created)
    if kind == "crs":
        return core.QgsProcessingParameterCrs(**given, defaultValue=default)
    if kind == "extent":
        return core.QgsProcessingParameterExtent(**given)
    if kind == "point":
        return core.QgsProcessingParameterPoint(**given)
    return core.QgsProcessingParameterString(**given, defaultValue=default, multiLine=kind == "texts")
