"""Margins of error: ± is twice the standard deviation, 95 % of a normal distribution, wherever people read it."""

import math
from typing import Final

MARGIN_SIGMAS: Final = 2.0


def margin(sigma: float | None, unit: str = "", factor: float = 1.0) -> str:
    """A margin to two significant digits: "± 2.8 cm", "± 180 cm"; "unknown" without a standard deviation above 0.

    `factor` leads from the unit of `sigma` to the one shown.
    """
    if sigma is None or not math.isfinite(sigma) or sigma <= 0.0:
        return "unknown"
    half = MARGIN_SIGMAS * factor * sigma
    places = _places(half)
    return f"± {round(half, places):,.{max(0, places)}f}{unit}"


def with_margin(
    value: float | None,
    sigma: float | None,
    unit: str = "",
    factor: float = 1.0,
    digits: int = 1,
    *,
    sign: bool = False,
) -> str:
    """A value in the digits that its margin leaves: "34.2 ± 1.8 cm", "4 ± 23 m²"; "unknown" where it is not finite.

    `factor` leads from the unit of `value` and `sigma` to the one shown; `digits` are those of a value without a
    margin.
    """
    if value is None or not math.isfinite(value):
        return "unknown"
    plus = "+" if sign else ""
    if sigma is None or not math.isfinite(sigma) or sigma <= 0.0:
        return f"{factor * value:{plus},.{digits}f}{unit}"
    places = _places(MARGIN_SIGMAS * factor * sigma)
    return f"{factor * value:{plus},.{max(0, places)}f} {margin(sigma, unit, factor)}"


def _places(half: float) -> int:
    """Decimal places of two significant digits."""
    return 1 - math.floor(math.log10(half))
