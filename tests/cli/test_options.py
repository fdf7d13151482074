"""Fields of settings are options: described once, and set by what the command line is given."""

from __future__ import annotations

import datetime as dt
import inspect
from collections.abc import Iterator
from dataclasses import is_dataclass
from typing import Any

import click
import pytest
from click.testing import CliRunner

from furrowmap import settings
from furrowmap.cli.command_options import settings_options
from furrowmap.cli.main import furrowmap as furrowmap_command
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.runtime.options import OptionSettings, options_of
from furrowmap.core.values.plot_grid import PlotGrid

CLASSES = [
    PlotGrid,
    *(one for _, one in inspect.getmembers(settings, is_dataclass) if one not in (Text, OptionSettings)),
]


def given(kind: type, *arguments: str) -> Any:
    """The settings that a command gets."""

    @click.command()
    @settings_options(kind)
    def command(settings: Any) -> None:
        found.append(settings)

    found: list[Any] = []
    done = CliRunner().invoke(command, arguments, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return found[0]


@pytest.mark.parametrize("kind", CLASSES)
def test_options__have_a_help_and_names_of_their_own(kind: type) -> None:
    options = options_of(kind).values()
    assert len({option.name for option in options}) == len(options) > 0
    assert [option.name for option in options if not option.help.endswith(".")] == []


@pytest.mark.parametrize("kind", [one for one in CLASSES if one not in (PlotGrid, settings.CanopySettings)])
def test_options__that_are_not_given_leave_the_defaults(kind: type) -> None:
    assert given(kind) == kind()


def test_options__set_their_fields() -> None:
    assert given(settings.SurfaceSettings, "--bbox", "1,2,3,4", "--class", "2,9", "--fill", "0.5") == (
        settings.SurfaceSettings(box=(1.0, 2.0, 3.0, 4.0), classes=frozenset({2, 9}), fill_m=0.5)
    )
    assert given(settings.TrafficSettings, "--since", "2026-06-11") == settings.TrafficSettings(
        since=dt.date(2026, 6, 11)
    )
    assert given(settings.EvaluationSettings, "--reference-fix", "fixed").fixed_reference_only
    assert given(settings.GrowthSettings, "--day", "2026-06-11", "--day", "2026-06-18").days == (
        "2026-06-11",
        "2026-06-18",
    )
    grid = given(PlotGrid, "--rows", "2", "--columns", "3", "--width", "1.5", "--blocks", "rows")
    assert grid == PlotGrid(2, 3, None, 1.5, serpentine=True, block="rows")


def every_command(command: click.Command) -> Iterator[click.Command]:
    yield command
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in command.list_commands(context):
            found = command.get_command(context, name)
            assert found is not None
            yield from every_command(found)


@pytest.mark.parametrize("text", ["nan", "inf", "-inf"])
def test_numbers__that_are_not_finite_are_refused_by_every_option(text: str) -> None:
    options = [one for command in every_command(furrowmap_command) for one in command.params]
    of_numbers = [one for one in options if isinstance(one.type, (click.FloatRange, click.types.FloatParamType))]
    assert len(of_numbers) > 30
    for one in of_numbers:
        with pytest.raises(click.BadParameter):
            one.type.convert(text, one, None)
