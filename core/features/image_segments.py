"""Segments of an image: regions of one colour, by scikit-image."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

SCALE: Final = 60.0
"""Preference for larger segments, in 255ths of a colour."""
FEWEST: Final = 30
"""Pixels of a segment."""


def image_segments(image: NDArray[np.uint8]) -> NDArray[np.int32]:
    """Number from 0 of the segment of each pixel (rows, columns) of an image (rows, columns, 3).

    P. F. Felzenszwalb, D. P. Huttenlocher (2004), Efficient graph-based image segmentation, International Journal of
    Computer Vision 59, 167-181. Needs the extra `photo`.
    """
    from skimage.segmentation import felzenszwalb

    labels: NDArray[np.int32] = felzenszwalb(image, scale=SCALE, sigma=0.8, min_size=FEWEST).astype(np.int32)
    return labels
