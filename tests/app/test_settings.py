"""Settings keep to the limits of their options, whoever makes them: from the lists of both."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, fields
from typing import Any

import pytest

from furrowmap import settings
from furrowmap.core.pointclouds.cleaning_steps import Cleaning
from furrowmap.core.runtime.errors import OptionError
from furrowmap.core.runtime.options import Option, OptionSettings, options_of
from furrowmap.core.values.plot_grid import PlotGrid

KINDS = [
    Cleaning,
    PlotGrid,
    *(
        kind
        for kind in vars(settings).values()
        if isinstance(kind, type) and issubclass(kind, OptionSettings) and kind not in (OptionSettings, Cleaning)
    ),
]
NEEDED: dict[str, dict[str, Any]] = {
    "CanopySettings": {"cell_m": 1.0},
    "PlotGrid": {"rows": 2, "columns": 2, "length_m": None, "width_m": 1.0},
}
"""What settings do not make without."""


def wrong_values(option: Option) -> Iterator[object]:
    """Values beyond the limits and choices of an option."""
    if option.choices and not isinstance(option.choices, Mapping):
        yield "no such choice"
    if option.minimum is not None:
        yield option.minimum - 1
    if option.above is not None:
        yield option.above
    if option.maximum is not None:
        yield option.maximum + 1
    if option.metavar in ("METRES", "M", "SECONDS", "DEGREES", "PRICE", "RATIO"):
        yield math.nan
        yield math.inf


CASES = [
    pytest.param(kind, name, (value,) if option.multiple else value, option, id=f"{kind.__name__}-{name}-{value}")
    for kind in KINDS
    for name, option in options_of(kind).items()
    for value in wrong_values(option)
]


@pytest.mark.parametrize(("kind", "name", "value", "option"), CASES)
def test_a_value_beyond_its_limits__is_refused_in_python_too(
    kind: type[OptionSettings], name: str, value: object, option: Option
) -> None:
    with pytest.raises(OptionError) as raised:
        kind(**{**NEEDED.get(kind.__name__, {}), name: value})
    assert option.name in str(raised.value).splitlines()[0]


@pytest.mark.parametrize("kind", KINDS)
def test_defaults__are_within_their_limits(kind: type[OptionSettings]) -> None:
    needed = NEEDED.get(kind.__name__, {})
    assert all(
        each.default is not MISSING or each.default_factory is not MISSING or each.name in needed
        for each in fields(kind)
    )
    kind(**needed)
