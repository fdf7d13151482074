# SPDX-License-Identifier: GPL-2.0-or-later
"""An algorithm as data: the options of its command from `commands.json`, the rest from `algorithms.json`.

Types, choices, defaults, limits, labels and the help of options come from the command line. `algorithms.json` has the
texts of algorithms and of arguments, ids that are not made of the option's name, which layer may stand for a file, and
what becomes of the command's JSON answer. Strings are translated where they are shown. Imports nothing of QGIS, so that
scripts and tests can read the algorithms as well.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

COMMAND_OPTIONS: dict[str, dict[str, dict[str, Any]]] = json.loads(
    Path(__file__).with_name("commands.json").read_text(encoding="utf-8")
)
"""Command → argument's name or option → its facts. Written by `scripts/plugin_commands.py`."""
COMMAND_EXAMPLES: dict[str, str] = json.loads(Path(__file__).with_name("examples.json").read_text(encoding="utf-8"))
"""Command → one with its arguments, as its help has it. Written by the same script."""
_TEXTS: dict[str, Any] = json.loads(Path(__file__).with_name("algorithms.json").read_text(encoding="utf-8"))
TOOLBOX_GROUPS: dict[str, tuple[str, str]] = _TEXTS["groups"]
"""Id of a group in the toolbox → its title, and the first words of its commands."""
Facts = dict[str, Any]
"""Attributes of a :class:`Parameter` that differ from those of the command's argument or option."""


@dataclass(frozen=True)
class Parameter:
    """An argument or option of a command as a parameter of an algorithm.

    Attributes:
        name: the id, which models and scripts keep.
        option: of the command; an argument has no dashes.
        kind: "file", "files", "new file", "new folder", "new raster", "flag", "choice", "choices", "integer", "number",
            "numbers" (separated by commas), "text", "texts" (one per line), "crs", "extent" or "point".
        label: in the dialog, without the unit.
        required: whether it has to be given where it has no default.
        count: how many numbers.
        crs: of an extent or a point: the option that takes its CRS.
        adds: whether a file that exists is added to instead of replaced.
        layers: which layer may stand for the file: "cloud", "raster or cloud", "polygons", "points", "table" or "".
        folder_of: pattern of files that stand for their folder, since a dialog that lists files offers no folders.
        if_absent: what the command gets where nothing is given.
        lists: "fields" for a box with the fields of the farm map.
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
    lists: str = ""

    @property
    def optional(self) -> bool:
        """Whether QGIS may leave it empty."""
        return not self.required and self.default is None


@dataclass(frozen=True)
class Output:
    """A value that an algorithm gives beside its files.

    `kind` is "boolean", "file", "folder", "layers", "number", "raster" or "text"; `source` a name in :data:`_VALUES`,
    and what it takes from the command's JSON answer.
    """

    name: str
    kind: str
    label: str
    source: str

    def value(self, answer: Any) -> Any:
        """The value in an answer; None where there is none."""
        how, _, name = self.source.partition(" ")
        return _VALUES[how](answer, name)


@dataclass(frozen=True)
class Algorithm:
    """A command as an algorithm.

    Attributes:
        command: its words, such as "farm add"; the algorithm's id is made of them.
        basic: names of arguments and options in the order of the dialog; all others are advanced parameters.
        facts: of arguments and options, where neither `commands.json` nor the facts shared by all commands say it all;
            several where any of several parameters gives the argument.
        outputs: beside the files and folders that parameters name.
        layers: names of products that the user may have opened as layers, or one of :data:`_LAYERS`.
        layer_group: for these in the layer tree, with {name} for the first input; by default the name of their folder.
    """

    command: str
    title: str
    summary: str
    basic: Sequence[str]
    facts: dict[str, Facts | list[Facts]] = field(default_factory=dict)
    outputs: Sequence[Output] = ()
    layers: str | Sequence[str] = ()
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
        return bool(self.layers) or self.command == "run"

    @property
    def parameters(self) -> list[Parameter]:
        """Every :class:`Parameter`, the basic ones first."""
        options = COMMAND_OPTIONS[self.command]
        facts = {**_TEXTS["shared_facts"], **self.facts}
        found = []
        for option in (*self.basic, *(option for option in options if option not in self.basic)):
            words = option.lstrip("-").replace("-", " ").replace("_", " ")
            derived = {"option": option, "name": words.upper().replace(" ", "_"), "label": words.capitalize()}
            known = {**derived, "advanced": option not in self.basic, **options[option]}
            ways = facts.get(option, {})
            if isinstance(ways, list):
                found += [Parameter(**{**known, "required": False, **way}) for way in ways]
            else:
                found.append(Parameter(**{**known, **ways}))
        return found

    def opened(self, answer: Any) -> list[str]:
        """The files in the command's answer that the user may have opened as layers."""
        if isinstance(self.layers, str):
            return _LAYERS[self.layers](answer)
        return [path for path in (_product(answer, name) for name in self.layers) if path]


def _value(answer: Any, name: str) -> Any:
    for key in name.split("."):
        answer = (answer or {}).get(key)
    return answer


def _product(answer: Any, name: str) -> str | None:
    """The path of a file in the answer's folder; None where it was not written."""
    return str(Path(answer["folder"]) / name) if name in answer["products"] else None


def _evaluated(answer: Any, name: str) -> list[str]:
    return [str(Path(answer["output"]) / name)] if answer["output"] else []


_VALUES: dict[str, Callable[[Any, str], Any]] = {
    "value": _value,
    "file": _product,
    "count": lambda answer, name: len(answer[name]),
    "texts": lambda answer, name: "\n".join(notice["text"] for notice in answer[name]),
    "json": lambda answer, name: json.dumps(answer[name] if name else answer, ensure_ascii=False, indent=1),
    "met": lambda answer, _: all(verdict["met"] for verdict in answer["verdicts"].values()),
    "page": lambda answer, _: next(iter(_evaluated(answer, "evaluation.html")), None),
    "worked": lambda answer, _: sum(each["worked_area_m2"] or 0.0 for each in answer["fields"]),
}
"""What an output takes from a command's answer."""
_LAYERS: dict[str, Callable[[Any], list[str]]] = {
    "output": lambda answer: [answer["output"]],
    "farm map": lambda answer: [answer["farm_map"]] if Path(answer["farm_map"]).is_file() else [],
    "changes": lambda answer: [str(Path(answer["folder"], row["raster"])) for row in answer["changes"]],
    "mosaics": lambda answer: [str(path) for path in sorted(Path(answer["folder"]).glob("mosaics/*/*.vrt"))],
    "evaluation": lambda answer: _evaluated(answer, "evaluation.gpkg"),
}
"""Layers that are not products of fixed names."""

ALGORITHMS = tuple(
    Algorithm(**{**known, "outputs": [Output(*row) for row in known.get("outputs", ())]})
    for known in _TEXTS["algorithms"]
)
