"""Segments of images, or of the colours of the cloud itself, vote on the class of what they cover."""

from __future__ import annotations

from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.features.classes import Feature
from furrowmap.core.features.neighbours import first_above, sort_into_columns
from furrowmap.core.runtime.arrays import FloatArray, IntArray

VOTED: Final = (Feature.HORIZONTAL_PLANE, Feature.VERTICAL_PLANE, Feature.LINE, Feature.SCATTER)
MIN_VOTING_VOXELS: Final = 8
"""Voxels of a segment that votes."""
GREEN: Final = (0.1, 0.4)
"""Excess green index (2g - r - b) / (r + g + b) of what may be, and of what is green vegetation (Woebbecke et al. 1995,
Transactions of the ASAE 38, 259-269)."""
LEAF_AS_OBJECT, OBJECT_AS_LEAF = 0.5, 0.6
"""Weight of planes and lines that are all green, and of scatter that is not green at all."""
IMAGE_SCALE: Final = 60.0
"""Preference for larger segments of images, in 255ths of a colour."""
MIN_SEGMENT_PIXELS: Final = 30
COLOUR_SCALE: Final = 0.1
"""The same of a cloud's own colours, of which black and white differ by 1."""


def vote_classes(evidence: FloatArray, segment: IntArray, rgb: FloatArray | None) -> NDArray[np.uint8]:
    """Class of each voxel by its own evidence and that of its segment.

    Args:
        evidence: (n, 4) of :data:`VOTED`, from 0 to 1.
        segment: (n,) segment of each voxel; below 0 for none.
        rgb: (n, 3) colours from 0 to 1, nan where unknown; None without any.
    """
    total = evidence.copy()
    known = segment >= 0
    if known.any():
        there, number, count = np.unique(segment[known], return_inverse=True, return_counts=True)
        mean = np.column_stack([np.bincount(number, evidence[known, k], len(there)) for k in range(4)])
        mean[count < MIN_VOTING_VOXELS] = 0.0
        # What is sure of itself does not listen. Lines are thinner than segments: those around them have no say.
        unsure = np.clip(2.0 * (1.0 - evidence[known].max(axis=1)), 0.0, 1.0)
        total[known] += (unsure * (evidence[known, 2] < 0.5))[:, None] * (mean / count[:, None])[number]
        if rgb is not None:
            green = greenness(rgb[known])
            seen = np.isfinite(green)
            counted = np.bincount(number[seen], minlength=len(there))
            share = (np.bincount(number[seen], green[seen], len(there)) / np.maximum(counted, 1))[number]
            unsure = np.where(seen, unsure, 0.0)
            total[known, :3] *= (1.0 - unsure * (1.0 - LEAF_AS_OBJECT) * share)[:, None]
            total[known, 3] *= 1.0 - unsure * (1.0 - OBJECT_AS_LEAF) * (1.0 - share)
    out: NDArray[np.uint8] = np.array(VOTED, np.uint8)[np.argmax(total, axis=1)]
    return out


def greenness(rgb: FloatArray) -> FloatArray:
    """From 0, not green, to 1, as leaves, of colours (n, 3); nan for black or unknown."""
    total = rgb.sum(axis=1)
    index = (3.0 * rgb[:, 1] - total) / np.where(total > 0.0, total, np.nan)
    out: FloatArray = np.clip((index - GREEN[0]) / (GREEN[1] - GREEN[0]), 0.0, 1.0)
    return out


def image_segments(image: NDArray[np.uint8]) -> NDArray[np.int32]:
    """Number from 0 of the segment of each pixel (rows, columns) of an image (rows, columns, 3).

    P. F. Felzenszwalb, D. P. Huttenlocher (2004), Efficient graph-based image segmentation, International Journal of
    Computer Vision 59, 167-181. Needs the extra `photo`.
    """
    from skimage.segmentation import felzenszwalb

    labels: NDArray[np.int32] = felzenszwalb(image, scale=IMAGE_SCALE, sigma=0.8, min_size=MIN_SEGMENT_PIXELS).astype(
        np.int32
    )
    return labels


def colour_segments(xyz_m: FloatArray, rgb: FloatArray, reach_m: float) -> IntArray:
    """Segment (n,) of voxels (n, 3) by their colours (n, 3), from 0 to 1: segmentation of the graph of the voxels.

    Felzenszwalb and Huttenlocher (2004), as :func:`image_segments`, with
    neighbours within a distance instead of pixels.
    """
    if not len(xyz_m):
        return np.zeros(0, np.int64)
    near = sort_into_columns(xyz_m, reach_m)
    colour = np.nan_to_num(rgb)[near.order]
    a, b, weight = _edges(near.xyz_m, near.starts, reach_m, *near.across, colour)
    order = np.argsort(weight)
    out = np.empty(len(xyz_m), np.int64)
    out[near.order] = _merge_segments(a[order], b[order], weight[order], len(xyz_m), COLOUR_SCALE)
    return out


@numba.njit(cache=True, nogil=True)
def _edges(xyz, starts, reach, across, rows, colour):  # type: ignore[no-untyped-def]
    """Pairs of near points, and how their colours differ."""
    first, second, weight = [0 for _ in range(0)], [0 for _ in range(0)], [0.0 for _ in range(0)]
    for i in range(len(xyz)):
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        column, row = int(x // reach), int(y // reach)
        for beside in range(column, min(column + 2, across)):
            for near in range(max(row - 1, 0), min(row + 2, rows)):
                begin, end = starts[beside * rows + near], starts[beside * rows + near + 1]
                for j in range(first_above(xyz, begin, end, z - reach), end):
                    c = xyz[j, 2] - z
                    if c > reach:
                        break
                    a, b = xyz[j, 0] - x, xyz[j, 1] - y
                    if j > i and a * a + b * b + c * c <= reach * reach:
                        r, g, h = colour[j, 0] - colour[i, 0], colour[j, 1] - colour[i, 1], colour[j, 2] - colour[i, 2]
                        first.append(i)
                        second.append(j)
                        weight.append(np.sqrt((r * r + g * g + h * h) / 3.0))
    return np.array(first, np.int64), np.array(second, np.int64), np.array(weight, np.float64)


@numba.njit(cache=True, nogil=True)
def _merge_segments(a, b, weight, n, scale):  # type: ignore[no-untyped-def]
    """Segments of a graph whose edges are sorted by weight."""
    parent, size, most = np.arange(n), np.ones(n, np.int64), np.full(n, scale)
    for k in range(len(a)):
        i, j = a[k], b[k]
        while parent[i] != i:
            parent[i] = parent[parent[i]]
            i = parent[i]
        while parent[j] != j:
            parent[j] = parent[parent[j]]
            j = parent[j]
        if i != j and weight[k] <= most[i] and weight[k] <= most[j]:
            if size[i] < size[j]:
                i, j = j, i
            parent[j] = i
            size[i] += size[j]
            most[i] = weight[k] + scale / size[i]
    for i in range(n):
        root = i
        while parent[root] != root:
            root = parent[root]
        parent[i] = root
    return parent
