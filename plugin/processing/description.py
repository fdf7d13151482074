# SPDX-License-Identifier: GPL-2.0-or-later
"""An algorithm as data: the options of its command from `commands.json`, and what only QGIS has to know of them.

Imports nothing of QGIS, so that scripts and tests can read the algorithms as well.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

COMMAND_OPTIONS: dict[str, dict[str, dict[str, Any]]] = json.loads(
    Path(__file__).with_name("commands.json").read_text(encoding="utf-8")
)
"""Command → argument's name or option → its facts. Written by `scripts/plugin_commands.py`."""
TOOLBOX_GROUPS = {
    "session": ("Sessions", "init inspect run calibrate machine simulate frames"),
    "surfaces": ("Surfaces and point clouds", "surface cloud colour features"),
    "crops": ("Crops and trials", "parcels growth canopy plots response"),
    "farm": ("Farm map", "farm tie season"),
    "exchange": ("Data exchange", "fields export share"),
    "accuracy": ("Accuracy", "crs gnss check"),
}
"""Id of a group in the toolbox → its title, and the first words of its commands."""
Facts = tuple[dict[str, Any], ...]
"""Of :func:`parameter`; one each of the parameters that give the same argument."""


@dataclass(frozen=True)
class Parameter:
    """An argument or option of a command as a parameter of an algorithm.

    Attributes:
        name: the id, which models and scripts keep.
        option: of the command; an argument has no dashes.
        kind: "file", "files", "new file", "new folder", "new raster", "flag", "choice", "choices", "integer", "number",
            "numbers" (separated by commas), "text", "texts" (one per line), "crs", "extent" or "point".
        label: in the dialog, without the unit.
        help: in the help panel.
        advanced: whether the dialog shows it among the advanced parameters.
        required: whether it has to be given where it has no default.
        default, choices, minimum, maximum, unit: of the value.
        count: how many numbers.
        crs: of an extent or a point: the option that takes its CRS.
        filter: of the file dialog.
        adds: whether a file that exists is added to instead of replaced.
        layers: which layer may stand for the file: "cloud", "raster or cloud", "polygons", "points", "table" or "".
        folder_of: pattern of files that stand for their folder, since a dialog that lists files offers no folders.
        if_absent: what the command gets where nothing is given.
    """

    name: str
    option: str
    kind: str
    label: str
    help: str = ""
    advanced: bool = False
    required: bool = False
    default: object = None
    choices: tuple[str, ...] = ()
    minimum: float | None = None
    maximum: float | None = None
    unit: str = ""
    count: int | None = None
    crs: str = ""
    filter: str = ""
    adds: bool = False
    layers: str = ""
    folder_of: str = ""
    if_absent: str = ""

    @property
    def optional(self) -> bool:
        """Whether QGIS may leave it empty."""
        return not self.required and self.default is None


@dataclass(frozen=True)
class Output:
    """A value that an algorithm gives beside the files it writes.

    Attributes:
        name: the id.
        kind: "boolean", "file", "folder", "layers", "number", "raster" or "text".
        label: as QGIS shows it.
        value: takes the command's JSON answer.
    """

    name: str
    kind: str
    label: str
    value: Callable[[Any], Any]


@dataclass(frozen=True)
class Algorithm:
    """A command as an algorithm.

    Attributes:
        command: its words, such as "farm add"; the algorithm's id is made of them.
        title: in the toolbox.
        summary: what it does, in a paragraph.
        basic: names of arguments and options in the order of the dialog; all others are advanced parameters.
        facts: name → :func:`parameter`, where `commands.json` and :data:`SHARED_FACTS` do not say it all; the sum of
            two where either gives the argument.
        outputs: beside the files and folders that parameters name.
        layers: takes the answer, gives the files that the user may have opened as layers.
        layer_group: for these in the layer tree; by default the name of their folder.
    """

    command: str
    title: str
    summary: str
    basic: tuple[str, ...]
    facts: dict[str, Facts] = field(default_factory=dict)
    outputs: tuple[Output, ...] = ()
    layers: Callable[[Any], list[str]] | None = None
    layer_group: str = ""

    @property
    def id(self) -> str:
        """Within the provider."""
        return self.command.replace(" ", "_")

    @property
    def group(self) -> str:
        """Id of the group in the toolbox."""
        return next(group for group, (_, words) in TOOLBOX_GROUPS.items() if self.command.split()[0] in words.split())

    @property
    def opens(self) -> bool:
        """Whether the user may have the products opened; `run` opens them as a group of its own."""
        return self.layers is not None or self.command == "run"

    @property
    def parameters(self) -> list[Parameter]:
        """Every :class:`Parameter`, the basic ones first."""
        options = COMMAND_OPTIONS[self.command]
        facts, no_facts = {**SHARED_FACTS, **self.facts}, parameter()
        return [
            Parameter(**{**_derived(option), "advanced": option not in self.basic, **options[option], **either, **way})
            for option in (*self.basic, *(option for option in options if option not in self.basic))
            for ways in [facts.get(option, no_facts)]
            for either in [{"required": False} if len(ways) > 1 else {}]
            for way in ways
        ]


def parameter(label: str = "", help_text: str = "", **facts: Any) -> Facts:
    """What only QGIS has to know of an argument or option: label, help and other facts that differ."""
    return ({**({"label": label} if label else {}), **({"help": help_text} if help_text else {}), **facts},)


def _derived(option: str) -> dict[str, str]:
    words = option.lstrip("-").replace("-", " ").replace("_", " ")
    return {"option": option, "name": words.upper().replace(" ", "_"), "label": words.capitalize()}


_FARM_MAP = parameter(
    "Farm map (GeoPackage)", "The farm's GeoPackage.", name="FARM_MAP", kind="file", filter="GeoPackage (*.gpkg)"
)
DATABASE = parameter(
    "Farm map (PostGIS)",
    "A connection URI such as postgresql://me@server/farm, instead of a GeoPackage. Keep passwords in PostgreSQL's "
    "password file.",
    name="DATABASE",
    kind="text",
    advanced=True,
)
_RESULTS = parameter(
    "Results of runs",
    "The report.json of each run; it stands for the folder of the run.",
    name="RESULTS",
    folder_of="*",
)
SHARED_FACTS = {
    "clouds": parameter("Point clouds", "LAS, LAZ or COPC files; they are used together.", layers="cloud"),
    "folders": _RESULTS,
    "parcels_file": parameter(
        "Parcels",
        "Gross parcels: GeoPackage, Shapefile, GeoJSON, FlatGeobuf, KML, or a CSV of corners.",
        name="PARCELS",
        layers="polygons",
    ),
    "results": _RESULTS,
    "session": parameter(
        "Session file",
        "The session.toml beside the recording; 'Create a session file' writes one.",
        filter="TOML (*.toml)",
    ),
    "sources": _FARM_MAP + DATABASE,
    "target": _FARM_MAP + DATABASE,
    "--bbox": parameter(name="EXTENT"),
    "--class": parameter(name="CLASSES"),
    "--ground-method": parameter(name="GROUND"),
    "--net": parameter(layers="polygons"),
    "--net-inset": parameter(count=2),
    "--overwrite": parameter("Overwrite existing files", "Otherwise the algorithm stops if the output exists."),
    "--polygons": parameter(layers="polygons"),
    "--treatments": parameter(layers="table"),
    "--within": parameter(
        help_text="GeoPackage, Shapefile, GeoJSON, FlatGeobuf, KML, or a CSV of corners, in any CRS.", layers="polygons"
    ),
}
"""What holds for an argument or option of any command."""
