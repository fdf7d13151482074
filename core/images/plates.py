"""Control points in images: plates of black and white quadrants, found near the place where one is expected."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

RADII_PX: Final = (4, 6, 9)
"""Of the circles around a plate's middle on which black and white change four times."""
SAMPLES: Final = 16
LEAST_SHARE: Final = 0.65
"""Of the grey levels' variance on a circle that has two periods a turn: 0.81 for four equal quadrants."""
LEAST_CONTRAST: Final = 35.0
"""Half the difference between white and black, in grey levels of 255."""
REFINED_PX: Final = 6
"""Half the width of the window in which the middle is refined."""


def plate_middle(grey: NDArray[np.uint8], expected: FloatArray, reach_px: float) -> FloatArray | None:
    """The middle of a plate of black and white quadrants; None if there is none.

    A plate must be wider than twice the largest of RADII_PX. Its middle is where grey levels on circles around it have
    two periods a turn; it is refined by the gradients around it (Förstner and Gülch 1987, as in OpenCV).

    Args:
        grey: (rows, columns).
        expected: (2,) column and row.
        reach_px: half the width of the window in which it is looked for.

    Returns:
        (2,) column and row; (0, 0) is the middle of the top left pixel.
    """
    import cv2

    margin = max(RADII_PX) + 1
    first = np.maximum(np.floor(expected - reach_px).astype(int), margin)
    last = np.minimum(np.ceil(expected + reach_px).astype(int), np.array(grey.shape[::-1]) - 1 - margin)
    if (last <= first).any():
        return None
    score = _score(grey.astype(np.float32), first, last)
    row, column = np.unravel_index(int(np.argmax(score)), score.shape)
    if score[row, column] <= 0.0:
        return None
    start = np.array([[first[0] + column, first[1] + row]], np.float32).reshape(-1, 1, 2)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 0.001)
    refined = cv2.cornerSubPix(np.ascontiguousarray(grey), start.copy(), (REFINED_PX, REFINED_PX), (-1, -1), stop)
    if float(np.abs(refined - start).max()) > REFINED_PX:
        return None
    out: FloatArray = refined.reshape(2).astype(np.float64)
    return out


def _score(grey: NDArray[np.float32], first: NDArray[np.int_], last: NDArray[np.int_]) -> FloatArray:
    """Contrast of the quadrants around each pixel of a window; 0 where there are none."""
    height, width = last[1] - first[1] + 1, last[0] - first[0] + 1
    angle = 2.0 * np.pi * np.arange(SAMPLES) / SAMPLES
    turn = np.exp(-2j * angle).astype(np.complex64)
    out, phases = np.full((height, width), np.inf), []
    for radius in RADII_PX:
        steps = np.round(radius * np.column_stack([np.cos(angle), np.sin(angle)])).astype(int)
        ring = np.stack(
            [grey[first[1] + dy : first[1] + dy + height, first[0] + dx : first[0] + dx + width] for dx, dy in steps]
        )
        ring = ring - ring.mean(axis=0)
        power = (ring**2).mean(axis=0)
        twice = np.tensordot(turn, ring, axes=1) * (2.0 / SAMPLES)
        share = 0.5 * np.abs(twice) ** 2 / np.maximum(power, 1e-6)
        clear = (share >= LEAST_SHARE) & (power >= LEAST_CONTRAST**2)
        out = np.minimum(out, np.where(clear, share * np.sqrt(power), 0.0))
        phases.append(twice)
    for other in phases[1:]:
        # The quadrants of all circles lie alike.
        out[(phases[0] * other.conj()).real < 0.5 * np.abs(phases[0] * other)] = 0.0
    return out
