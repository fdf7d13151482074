"""The description of the commands from which the plugin builds its algorithms, read without QGIS."""

from __future__ import annotations

import sys
from pathlib import Path

import click
import pytest

CHECKOUT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(CHECKOUT / "scripts"))
from plugin_commands import FILE, NOT_IN_QGIS, content, examples  # noqa: E402

from furrowmap.cli.calibrate_commands import WithMount, mount  # noqa: E402
from furrowmap.cli.main import COMMANDS, furrowmap  # noqa: E402
from furrowmap.plugin.processing.description import ALGORITHMS, COMMAND_OPTIONS, Output  # noqa: E402


def test_commands__are_those_of_the_command_line() -> None:
    assert FILE.read_text(encoding="utf-8") == content(), "run scripts/plugin_commands.py, then plugin_strings.py"
    assert FILE.with_name("examples.json").read_text(encoding="utf-8") == examples()


def test_every_command__is_an_algorithm_or_stands_in_a_list_with_its_reason() -> None:
    words = set()
    for name in COMMANDS:
        command = furrowmap.get_command(click.Context(furrowmap), name)
        words |= {f"{name} {below}" for below in command.commands} if isinstance(command, click.Group) else {name}
        words |= {f"{name} {mount.name}"} if isinstance(command, WithMount) else set()
    assert {"calibrate mount", "colour", "farm add", "gnss solve"} <= words
    offered = [algorithm.command for algorithm in ALGORITHMS]
    assert sorted(offered) == sorted(words - set(NOT_IN_QGIS))
    assert set(NOT_IN_QGIS) < words
    assert all(len(reason) > 10 for reason in NOT_IN_QGIS.values())


def test_algorithms__name_only_options_of_their_command() -> None:
    for algorithm in ALGORITHMS:
        assert {*algorithm.basic, *algorithm.facts} <= set(COMMAND_OPTIONS[algorithm.command]), algorithm.command


def test_option__that_no_algorithm_names_becomes_an_advanced_parameter(monkeypatch: pytest.MonkeyPatch) -> None:
    options = {**COMMAND_OPTIONS["crs"], "--max-gap": {"kind": "number", "unit": "s", "help": "Longest gap."}}
    monkeypatch.setitem(COMMAND_OPTIONS, "crs", options)
    (crs,) = [algorithm for algorithm in ALGORITHMS if algorithm.command == "crs"]
    added = crs.parameters[-1]
    assert (added.name, added.label, added.advanced, added.optional) == ("MAX_GAP", "Max gap", True, True)


@pytest.mark.parametrize(
    ("source", "value"),
    [
        ("value figures.points", 7),
        ("value figures.none", None),
        ("value none.points", None),
        ("file parcels.csv", str(Path("folder", "parcels.csv"))),
        ("file other.csv", None),
        ("count found", 2),
        ("texts found", "one\ntwo"),
        ("json figures", '{\n "points": 7\n}'),
    ],
)
def test_output__takes_its_value_from_the_answer(source: str, value: object) -> None:
    answer = {"folder": "folder", "products": ["parcels.csv"], "figures": {"points": 7}}
    answer |= {"found": [{"text": "one"}, {"text": "two"}]}
    assert Output("X", "text", "x", source).value(answer) == value
