"""The page of ties between dates."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from furrowmap.exporters.reports.pages import days_words, render


def tie_page(account: Mapping[str, Any]) -> str:
    """The page of `tie.json` in English: dates and their moves, ties, soil moved; its areas have no unit yet."""
    medians = [change["untouched_median_m"] for change in account["changes"]]
    return render(
        "tie.html",
        **account,
        title="Dates of one field",
        when=days_words(*(account["dates"][k]["start_local"][:10] for k in (0, -1))),
        medians=[abs(median) for median in medians if median is not None],
    )
