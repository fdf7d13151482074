"""What the tables of a scenario have in common."""

import math
from typing import Final, TypeAlias

import msgspec

Vector3: TypeAlias = tuple[float, float, float]
Box: TypeAlias = tuple[float, float, float, float, float, float]

BY_KIND: Final = math.nan
"""Placeholder for a default that depends on other values."""


def waits(value: object) -> bool:
    """Whether `value` is, or contains, a placeholder."""
    if isinstance(value, tuple):
        return any(waits(v) for v in value)
    return isinstance(value, float) and math.isnan(value)


class ScenarioTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of the scenario: frozen, without unknown keys."""

    def fill(self, **values: object) -> None:
        """Replace placeholders by `values`."""
        for name, value in values.items():
            if waits(getattr(self, name)):
                msgspec.structs.force_setattr(self, name, value)
