"""Range images of the implement and of the vehicle, with axes: azimuth, laser, and the range by its colour."""

from collections.abc import Iterator
from typing import Final

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from furrowmap.core.work.model import SeenImplement
from furrowmap.exporters.reports.svg import WIDTH, drawing, element, image, label, turned_label

LEFT: Final = 58.0
TOP: Final = 4.0
BOTTOM: Final = 84.0
MAX_TICKS: Final = 9
_NEAR_TO_FAR: Final = np.array([[253.0, 231.0, 37.0], [33.0, 145.0, 140.0], [68.0, 1.0, 84.0]])
_NO_RETURN: Final = np.array([238.0, 238.0, 235.0])
_STEPS_DEG: Final = (1, 2, 5, 10, 15, 20, 30, 45, 60, 90)


def range_images(seen: SeenImplement) -> Iterator[tuple[str, Markup]]:
    """The implement up and down, and what does not move in the scanner's frame: captions and images."""
    images, still_m = seen.images, seen.region.still_m
    around_deg = (np.arange(still_m.shape[1]) + 0.5) * (360.0 / still_m.shape[1])
    for text, range_m, azimuth_deg, shown in (
        ("The implement lifted", images.up_m, images.azimuth_deg, images.implement),
        ("The implement in the ground", images.down_m, images.azimuth_deg, images.implement),
        ("Static returns: the vehicle itself, all around", still_m, around_deg, None),
    ):
        yield text, range_image(range_m, azimuth_deg, shown, text)


def range_image(
    range_m: NDArray[np.float32], azimuth_deg: NDArray[np.float64], shown: NDArray[np.bool_] | None, title: str
) -> Markup:
    """A range image as SVG.

    Args:
        range_m: (lasers, n) the lowest laser first; nan where nothing is seen.
        azimuth_deg: (n,) of the columns, increasing; may go on beyond 360.
        shown: (lasers, n) what is not pale; None for all.
    """
    lasers, columns = range_m.shape
    parts = [image(LEFT, TOP, WIDTH, BOTTOM, range_picture(range_m, shown), class_="depth")]
    row = (BOTTOM - TOP) / lasers
    parts += [
        label(LEFT - 7, BOTTOM - (number - 0.5) * row + 4, str(number), "right")
        for number in sorted({1, (lasers + 1) // 2, lasers})
    ]
    parts.append(turned_label("laser", 0.5 * (TOP + BOTTOM)))
    half_deg = 0.5 * float(azimuth_deg[-1] - azimuth_deg[0]) / max(columns - 1, 1)
    first, last = float(azimuth_deg[0]) - half_deg, float(azimuth_deg[-1]) + half_deg
    step = next((s for s in _STEPS_DEG if (last - first) / s <= MAX_TICKS), _STEPS_DEG[-1])
    marks = np.arange(np.ceil(first / step - 1e-6) * step, last + 1e-6, step)
    places = (LEFT + (marks - first) / max(last - first, 1e-9) * (WIDTH - LEFT)).tolist()
    ticks = "".join(f"M{x:.1f} {BOTTOM}v5" for x in places)
    parts.append(element("path", class_="ticks", d=f"M{LEFT} {TOP}V{BOTTOM}H{WIDTH}{ticks}"))
    parts += [
        label(x, BOTTOM + 18, f"{mark % 360:.0f}°", "right" if x > WIDTH - 14.0 else "middle")
        for x, mark in zip(places, marks.tolist(), strict=True)
    ]
    parts.append(label(LEFT, BOTTOM + 36, "azimuth"))
    low, high = range_limits_m(range_m, shown)
    if np.isfinite(low):
        left, right, y = WIDTH - 250.0, WIDTH - 110.0, BOTTOM + 26.0
        colours = _colours(np.linspace(0.0, 1.0, 64))[None].astype(np.uint8)
        parts.append(label(left - 6, y + 10, f"range {low:.1f} m", "right"))
        parts.append(image(left, y, right, y + 11, colours))
        parts.append(label(right + 6, y + 10, f"{high:.1f} m"))
    return drawing(WIDTH, BOTTOM + 42.0, parts, title)


def range_limits_m(range_m: NDArray[np.float32], shown: NDArray[np.bool_] | None) -> tuple[float, float]:
    """The ranges of the first and the last colour: the 2nd and 98th percentile of what is shown; nan for nothing."""
    known = np.isfinite(range_m)
    if not known.any():
        return float("nan"), float("nan")
    chosen = shown & known if shown is not None else known
    low, high = np.quantile(range_m[chosen if chosen.any() else known], (0.02, 0.98))
    return float(low), float(high)


def range_picture(range_m: NDArray[np.float32], shown: NDArray[np.bool_] | None) -> NDArray[np.uint8]:
    """Colours (lasers, n, 3) by range, the highest laser on top; what is not shown is pale."""
    known = np.isfinite(range_m)
    low, high = range_limits_m(range_m, shown)
    if not known.any():
        return np.full((*range_m.shape, 3), 238, np.uint8)
    chosen = shown & known if shown is not None else known
    share = np.clip((np.where(known, range_m, high) - low) / max(high - low, 1e-3), 0.0, 1.0)
    colour = _colours(share)
    colour = np.where(chosen[..., None], colour, 0.25 * colour + 0.75 * _NO_RETURN)
    picture: NDArray[np.uint8] = np.where(known[..., None], colour, _NO_RETURN)[::-1].astype(np.uint8)
    return picture


def _colours(share: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack([np.interp(share, (0.0, 0.5, 1.0), channel) for channel in _NEAR_TO_FAR.T], axis=-1)
