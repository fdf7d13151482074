"""TOML that others wrote."""

from __future__ import annotations

import tomllib
from typing import Any, Final

LARGEST: Final = 2**63
"""Integers have 64 bits (TOML 1.0.0, "Integer")."""


def parse_toml(text: str) -> dict[str, Any]:
    """The content of a TOML text.

    Raises:
        tomllib.TOMLDecodeError: if it is not valid, has an integer of more than 64 bits, or is nested too deeply.
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except RecursionError:
        raise tomllib.TOMLDecodeError("it is nested too deeply") from None
    except ValueError:  # Python converts no more than 4,300 digits
        raise tomllib.TOMLDecodeError("a number has too many digits") from None
    if _has_huge(data):
        raise tomllib.TOMLDecodeError("an integer has more than 64 bits")
    return data


def _has_huge(value: object) -> bool:
    if isinstance(value, dict):
        return any(map(_has_huge, value.values()))
    if isinstance(value, list):
        return any(map(_has_huge, value))
    return isinstance(value, int) and not -LARGEST <= value < LARGEST
