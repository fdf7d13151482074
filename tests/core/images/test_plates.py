"""Plates of black and white quadrants, rendered at places that are known to a fraction of a pixel."""

from __future__ import annotations

import numpy as np
import pytest

from furrowmap.core.images.control_points import plate_middle

pytest.importorskip("cv2")


def rendered(middle: tuple[float, float], turn_deg: float, half_px: float = 20.0) -> np.ndarray:
    """A grey image of 120 × 160 with a plate, each pixel the mean of 8 × 8 places in it."""
    fine = (np.arange(160 * 8) + 0.5) / 8.0 - 0.5
    x, y = np.meshgrid(fine - middle[0], fine[: 120 * 8] - middle[1])
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    a, b = c * x + s * y, c * y - s * x
    plate = np.where(a * b > 0, 220.0, 30.0)
    level = np.where(np.maximum(abs(a), abs(b)) < half_px, plate, 110.0)
    mean = level.reshape(120, 8, 160, 8).mean(axis=(1, 3))
    return (mean + np.random.default_rng(0).normal(0.0, 1.5, mean.shape)).clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize(("middle", "turn_deg"), [((80.3, 60.6), 10.0), ((71.0, 52.25), 45.0), ((84.75, 66.5), 88.0)])
def test_middle__is_found_to_a_tenth_of_a_pixel(middle: tuple[float, float], turn_deg: float) -> None:
    found = plate_middle(rendered(middle, turn_deg), np.array([78.0, 58.0]), 25.0)
    assert found is not None
    assert found == pytest.approx(middle, abs=0.1)


def test_image_without_plate__has_none() -> None:
    rng = np.random.default_rng(1)
    grey = (110 + np.kron(rng.normal(0, 25, (30, 40)), np.ones((4, 4)))).clip(0, 255).astype(np.uint8)
    assert plate_middle(grey, np.array([80.0, 60.0]), 45.0) is None
    assert plate_middle(grey, np.array([500.0, 60.0]), 45.0) is None
