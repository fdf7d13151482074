"""The section of a run's page on its control points."""

from collections.abc import Iterator
from typing import Final

from furrowmap.core.pipeline.control.control_points import ControlledPoint, ControlResult
from furrowmap.core.pipeline.control.frame_error import CRITICAL_RESIDUAL
from furrowmap.core.runtime.languages.texts import Text, Words, figure_text, label_text
from furrowmap.exporters.reports.html_pages import render
from furrowmap.exporters.vectors.labels import VALUES

MAX_CONTROL_ROWS: Final = 100
"""Maximum length of the table."""


def control_section(control: ControlResult) -> str:
    """The section as HTML."""
    return render(
        "control.html",
        control=control,
        rows=list(_rows(control.points)),
        max_rows=MAX_CONTROL_ROWS,
        critical=CRITICAL_RESIDUAL,
        axes=[
            (name, 1000.0 * shift, 1000.0 * sigma, 1000.0 * spread)
            for name, shift, sigma, spread, known in zip(
                (Text("easting"), Text("northing"), Text("height")),
                control.shift_m.tolist(),
                control.sigma_m.tolist(),
                control.range_m.tolist(),
                control.axes.tolist(),
                strict=True,
            )
            if known
        ],
    )


def _rows(points: tuple[ControlledPoint, ...]) -> Iterator[tuple[Words, ...]]:
    """Name, state, reason, visits, residuals, sigma of the height and normalised residual of each."""
    for point in points:
        east, north, up = (f"{1000.0 * value:+.0f}" if value == value else "–" for value in point.residual_m.tolist())
        sigma = f"{1000.0 * point.sigma_m[2]:.0f}" if point.sigma_m[2] == point.sigma_m[2] else "–"
        worst = figure_text(f"{point.worst:.1f}") if point.worst == point.worst else "–"
        state = label_text(VALUES["state"][point.state.value])
        reason = label_text(VALUES["why_not"].get(point.why_not.value, ""))
        yield point.name, state, reason, str(point.visits), east, north, up, sigma, worst
