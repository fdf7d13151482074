"""The section of a run's page on its control points, with a picture of each target."""

from collections.abc import Iterator
from typing import Final

import numpy as np
from markupsafe import Markup

from furrowmap.core.pipeline.control.control_points import ControlledPoint, ControlResult
from furrowmap.core.pipeline.control.frame_error import CRITICAL_RESIDUAL
from furrowmap.core.runtime.languages.texts import Text, Words, figure_text, label_text
from furrowmap.exporters.reports.html_pages import render
from furrowmap.exporters.reports.svg import drawing, element, image, segment
from furrowmap.exporters.vectors.labels import VALUES

MAX_CONTROL_ROWS: Final = 100
"""Maximum length of the table, and most pictures."""
TARGET_PICTURE_WIDTH: Final = 160.0
CROSS_WIDTH: Final = 12.0
"""Half of the length of the lines of the cross at the surveyed place."""


def control_section(control: ControlResult) -> str:
    """The section as HTML."""
    return render(
        "control.html",
        control=control,
        rows=list(_rows(control.points)),
        pictures=[(point.name, drawn) for point in control.points if (drawn := _picture(point))],
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
    """Name, target, state, reason, visits, residuals, sigma of the height and normalised residual of each."""
    for point in points:
        east, north, up = (f"{1000.0 * value:+.0f}" if value == value else "–" for value in point.residual_m.tolist())
        sigma = f"{1000.0 * point.sigma_m[2]:.0f}" if point.sigma_m[2] == point.sigma_m[2] else "–"
        worst = figure_text(f"{point.worst:.1f}") if point.worst == point.worst else "–"
        state = label_text(VALUES["state"][point.state.value])
        reason = label_text(VALUES["why_not"].get(point.why_not.value, ""))
        target = label_text(VALUES["target"][point.target.kind.value])
        yield point.name, target, state, reason, str(point.visits), east, north, up, sigma, worst


def _picture(point: ControlledPoint) -> Markup:
    """What the scanner sees round a point, from above: a cross where it was surveyed, a ring where its target is."""
    picture = point.picture
    if picture is None:
        return Markup()
    seen = np.isfinite(picture.intensity)
    low, high = np.percentile(picture.intensity[seen], [2.0, 98.0])
    grey = np.clip((picture.intensity - low) / max(high - low, 1e-9), 0.0, 1.0) * 255.0
    pixels = np.stack([np.where(seen, grey, 0.0), np.where(seen, 255.0, 0.0)], axis=-1).astype(np.uint8)
    middle = 0.5 * TARGET_PICTURE_WIDTH
    cross = {"stroke": "#c51b7d", "stroke_width": 2}
    parts = [
        image(0.0, 0.0, TARGET_PICTURE_WIDTH, TARGET_PICTURE_WIDTH, pixels, class_="depth"),
        segment(middle - CROSS_WIDTH, middle, middle + CROSS_WIDTH, middle, **cross),
        segment(middle, middle - CROSS_WIDTH, middle, middle + CROSS_WIDTH, **cross),
    ]
    if picture.off_m is not None:
        scale = TARGET_PICTURE_WIDTH / picture.side_m
        x = middle + scale * picture.off_m[0]
        y = middle - scale * picture.off_m[1]
        radius = max(0.5 * scale * point.target.size_m, 0.5 * CROSS_WIDTH)
        parts.append(element("circle", cx=x, cy=y, r=radius, fill="none", stroke="#1b7837", stroke_width=2))
    title = Text("what the scanner sees at {name}", name=point.name)
    return drawing(TARGET_PICTURE_WIDTH, TARGET_PICTURE_WIDTH, parts, title)
