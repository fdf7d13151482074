# SPDX-License-Identifier: GPL-2.0-or-later
"""An algorithm as data: the options of its command from `commands.json`, and what only QGIS has to know of them.

Imports nothing of QGIS, so that scripts and tests can read the algorithms as well.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

COMMANDS = json.loads(Path(__file__).with_name("commands.json").read_text(encoding="utf-8"))
"""Command → argument's name or option → its facts. Written by `scripts/plugin_commands.py`."""


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
    choices: tuple = ()
    minimum: float = None
    maximum: float = None
    unit: str = ""
    count: int = None
    crs: str = ""
    filter: str = ""
    adds: bool = False
    layers: str = ""
    folder_of: str = ""
    if_absent: str = ""

    @property
    def optional(self):
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
    value: Callable


@dataclass(frozen=True)
class Algorithm:
    """A command as an algorithm.

    Attributes:
        command: its words, such as "farm add"; the algorithm's id is made of them.
        title: in the toolbox.
        group: id of the toolbox group.
        summary: what it does, in a paragraph.
        basic, advanced: argument's name or option → :func:`parameter`; the sum of two where either gives the argument.
            Options of the command that are not named here become advanced parameters.
        outputs: beside the files and folders that parameters name.
        opens: whether the user may have the products opened.
        layers: takes the answer, gives the files to open as layers.
        layer_group: for these in the layer tree; by default the name of their folder.
    """

    command: str
    title: str
    group: str
    summary: str
    basic: dict
    advanced: dict = field(default_factory=dict)
    outputs: tuple = ()
    opens: bool = False
    layers: Callable = None
    layer_group: str = ""

    @property
    def id(self):
        """Within the provider."""
        return self.command.replace(" ", "_")

    @property
    def parameters(self):
        """Every :class:`Parameter`: the basic ones, the advanced ones, and options that only `commands.json` has."""
        options = COMMANDS[self.command]
        named = {**self.basic, **self.advanced}
        rest = {option: parameter(*_derived_names(option)) for option in options if option not in named}
        return [
            Parameter(**{"option": option, "advanced": option not in self.basic, **options[option], **either, **facts})
            for option, ways in {**named, **rest}.items()
            for either in [{"required": False} if len(ways) > 1 else {}]
            for facts in ways
        ]


def parameter(name, label, help_text="", **facts):
    """What QGIS has to know of an option: id, label, help that replaces the command's, other facts that differ."""
    return ({"name": name, "label": label, **({"help": help_text} if help_text else {}), **facts},)


def _derived_names(option):
    words = option.lstrip("-").replace("-", " ")
    return words.upper().replace(" ", "_"), words.capitalize()
