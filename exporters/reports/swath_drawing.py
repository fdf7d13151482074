"""Histogram of height differences between swaths as SVG."""

from __future__ import annotations

from typing import Final

import numpy as np

from furrowmap.core.surfaces.visits import BIN_M, BINS, SwathDifferences
from furrowmap.exporters.reports.svg import WIDTH, Axis, drawing

_REACHES_M: Final = (0.01, 0.02, 0.05, BINS * BIN_M)
"""Possible half widths of the histogram."""
_SHARE: Final = 0.98
"""Share of the ground within the half width; the rest is in the outermost bars."""
_TOP: Final = 18.0
_BOTTOM: Final = 150.0
_LEFT: Final = 74.0


def half_width_m(swaths: SwathDifferences) -> float:
    """A round half width of a histogram that shows nearly all differences."""
    return next((reach for reach in _REACHES_M if swaths.within_m(_SHARE) <= reach), _REACHES_M[-1])


def swath_histogram(swaths: SwathDifferences, reach_m: float | None = None) -> str:
    """Share of the ground by height difference; the outermost bars include all larger differences.

    Args:
        swaths: the differences.
        reach_m: half width; None for that of :func:`half_width_m`.
    """
    reach_m = half_width_m(swaths) if reach_m is None else reach_m
    bins = round(reach_m / BIN_M)
    low, high = BINS - bins, BINS + bins
    count = swaths.histogram[low:high].astype(np.float64)
    count[0] += swaths.histogram[:low].sum()
    count[-1] += swaths.histogram[high:].sum()
    share = count / max(swaths.blocks, 1)
    shares = Axis(0.0, max(float(share.max()), 1e-3), _BOTTOM, _TOP)
    wide = (WIDTH - _LEFT) / len(share)
    parts = shares.grid(_LEFT, lambda value: f"{100.0 * value:g} %")
    for k, top in enumerate(shares.at(share).tolist()):
        if share[k]:
            place = f'x="{_LEFT + k * wide + 0.5:.1f}" y="{top:.1f}" width="{wide - 1.0:.1f}"'
            parts.append(f'<rect class="bars" {place} height="{_BOTTOM - top:.1f}"/>')
    middle = 0.5 * (_LEFT + WIDTH)
    parts.append(f'<line class="threshold" x1="{middle:.1f}" x2="{middle:.1f}" y1="{_TOP}" y2="{_BOTTOM}"/>')
    last = 2 * BINS - 1  # like the first, of all larger differences
    beyond = bool(swaths.histogram[: max(low, 1)].any() or swaths.histogram[min(high, last) :].any())
    edge = f"{1000 * reach_m:g} mm" + (" and more" if beyond else "")
    for at, kind, text in (
        (_LEFT, "label", f"−{edge}"),
        (middle, "label middle", "0"),
        (WIDTH, "label right", f"+{edge}"),
    ):
        parts.append(f'<text class="{kind}" x="{at:.1f}" y="{_BOTTOM + 18}">{text}</text>')
    return drawing(WIDTH, _BOTTOM + 24.0, parts, "Differences in height of swaths over the same ground")
