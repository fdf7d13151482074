"""The matrix of inputs is whole: every parameter that takes a kind of file is in it, as are all that its tests try."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, get_args, get_type_hints

import click
import msgspec
import pytest

from furrowmap.cli.main import Commands
from furrowmap.core.session.opened import Inputs
from furrowmap.core.values.session import Session

MATRIX = tomllib.loads((Path(__file__).parent / "matrix.toml").read_text(encoding="utf-8"))
KINDS: list[dict[str, Any]] = MATRIX["kinds"]
VALUES = {"CRS", "N,N", "W,S,E,N", "NAME", "DATE", "DAY", "ZONE", "MM-DD", "COLUMN", "X,Y", "ENDS,SIDES", "ID", "URL"}
VALUES |= {"ADDRESS", "PORT,...", "LAT,LON,HEIGHT", "FORWARD,LEFT,UP", "YYYY-MM-DD", "FIELD", "[COMMAND]...", "SOURCE"}
"""Metavars of what is no file."""


def parameters(command: click.Command, words: tuple[str, ...] = ()) -> Iterator[tuple[str, click.Parameter]]:
    """Options and arguments that may be the path of a file, with the words of their command."""
    if isinstance(command, click.Group):
        context = click.Context(command)
        for word in command.list_commands(context):
            below = command.get_command(context, word)
            if isinstance(below, click.Command):
                yield from parameters(below, (*words, word))
        return
    for parameter in command.params:
        numbers = (click.types.BoolParamType, click.types.IntParamType, click.types.FloatParamType, click.Choice)
        if isinstance(parameter.type, (*numbers, click.DateTime)) or parameter.name in ("output", "log_file"):
            continue
        name = (
            parameter.opts[0] if isinstance(parameter, click.Option) else parameter.make_metavar(click.Context(command))
        )
        yield " ".join([*words, name.replace("...", "").replace("{", "").strip("[]")]), parameter


def taken() -> set[str]:
    return {name for kind in KINDS for names in kind["places"].values() for name in names}


def test_parameters_of_commands__that_take_files_are_in_the_matrix_or_said_to_be_of_no_kind() -> None:
    found = {name for name, parameter in parameters(Commands("furrowmap")) if parameter.metavar not in VALUES}
    listed = {name for name in taken() if " " in name} | set(MATRIX["no_kind"])
    assert found == listed


def keys(struct: type, before: str = "") -> Iterator[str]:
    """The keys of a session whose values are texts, such as names of files."""
    for field in msgspec.structs.fields(struct):
        tables = [kind for kind in (field.type, *get_args(field.type)) if isinstance(kind, type)]
        below = [kind for kind in tables if issubclass(kind, msgspec.Struct)]
        if below and not before:
            yield from keys(below[0], field.encode_name)
        elif before and any(
            kind is str or get_args(kind)[:1] == (str,) for kind in (field.type, *get_args(field.type))
        ):
            yield f"{before}.{field.encode_name}"


def test_keys_of_sessions__that_name_files_are_in_the_matrix_or_said_to_be_of_no_kind() -> None:
    texts = set(keys(Session))
    listed = {name for name in taken() if "." in name and " " not in name}
    files = listed | set(MATRIX["no_kind_of_session"])
    assert files <= texts
    # each field of the files that a session opens is one or more of its keys
    others = {"tools", "further_lidars", "positions", "inertial", "camera", "images", "ground_control"}
    opened = set(get_type_hints(Inputs)) - others
    words = {name.split(".")[-1] for name in files} | {name.split(".")[0] for name in files}
    assert opened <= words


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: str(kind["title"]))
def test_lists__are_what_the_tests_try(kind: dict[str, Any]) -> None:
    module = import_module(kind["test"])
    places = getattr(module, "PLACES", None)
    assert set(kind["places"]) == set(module.WAYS if kind["title"] == "Rasters of heights" else places)
    if kind["title"] == "Rasters of heights":
        numbers = [f"no height: {name}" for name in module.NO_HEIGHTS]
        units = [f"unit of the band: {name}" for name in module.UNITS]
        crs = [f"vertical CRS: {name}" for name in module.COMPOUND]
        assert kind["read"] == [*module.SCALES, *units, *crs, *numbers, *module.FORMS]
        assert kind["refused"] == list(module.REFUSED)
        assert kind["read_or_refused"] == list(module.TURNED)
        return
    names = list(module.PROPERTIES)
    assert kind["read"] == names
    assert kind.get("refused", []) == list(module.REFUSED)


def test_properties__are_many() -> None:
    assert sum(len(kind["read"]) + len(kind.get("refused", [])) for kind in KINDS) >= 25
