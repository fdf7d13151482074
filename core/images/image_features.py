"""Features of images and their matches, by OpenCV.

SIFT (Lowe 2004), compared by the square roots of its descriptors (Arandjelović and Zisserman 2012) both ways, the
matches of two images checked by their epipolar geometry.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.image_pixels import read_pixels
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.runtime.background import in_turn
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.runtime.settings import threads
from furrowmap.core.values.images import ImageFile

Pair = tuple[int, int]
Shared = Callable[[int, int], NDArray[np.bool_]]

MAX_IMAGE_FEATURES: Final = 1600
"""Of an image; those of the greatest contrast are kept."""
REDUCED: Final = 0.75
"""OpenCV enlarges an image twice before it looks for features: reduced first, half of the time, poses as accurate."""
MAX_SIDE_PX: Final = 1600
"""Of a reduced image."""
DESCRIPTOR: Final = 128
"""Numbers of a descriptor."""
MAX_RATIO: Final = 0.8
"""Largest distance of the best match's descriptor in distances of the second best's (Lowe 2004)."""
MAX_EPIPOLAR_PX: Final = 1.0
MIN_MATCHES: Final = 15
"""Two images with fewer are not linked."""
OF_SCALE: Final = 0.06
"""Standard deviation of a feature's place in units of its scale, before residuals show it."""


@dataclass(frozen=True)
class ImageFeatures:
    """Places (k, 3) of an image: column, row, sigma of both; SIFT's descriptors (k, 128)."""

    places: FloatArray
    descriptors: NDArray[np.uint8]

    def roots(self) -> NDArray[np.float32]:
        """Square roots (k, DESCRIPTOR) of the descriptors, of length 1."""
        own = self.descriptors.astype(np.float32)
        out: NDArray[np.float32] = np.sqrt(own / np.maximum(own.sum(axis=1, keepdims=True), 1.0))
        return out


def match_features(
    features: Sequence[ImageFeatures], pairs: Sequence[Pair], progress: Progress, shared: Shared | None = None
) -> dict[Pair, IntArray]:
    """Numbers (m, 2) of the features that match, by pair of images; reports the stage "matching images".

    Args:
        shared: which features (k,) of an image another one shows, by the numbers of both images; None for all.
    """

    def matches(pair: Pair) -> IntArray:
        of_a, of_b = (
            np.arange(len(features[own].places)) if shared is None else np.flatnonzero(shared(own, other))
            for own, other in (pair, pair[::-1])
        )
        return _matches(features[pair[0]], features[pair[1]], of_a, of_b)

    found = {}
    with ThreadPoolExecutor(threads()) as pool:
        for k, own in enumerate(in_turn(pool, matches, pairs, 2 * threads())):
            if len(own) >= MIN_MATCHES:
                found[pairs[k]] = own
            progress("matching images", (k + 1) / len(pairs))
    return found


def find_features(paths: Sequence[ImageFile], progress: Progress) -> dict[ImageFile, ImageFeatures]:
    """The features of all images, none of one that cannot be read; reports the stage "finding features"."""
    import cv2

    # Each thread has an image of its own.
    cv2.setNumThreads(1)
    found = {}
    descriptors = arrays.zeros((len(paths), MAX_IMAGE_FEATURES, DESCRIPTOR), np.uint8)
    with ThreadPoolExecutor(threads()) as pool:
        for k, (places, own) in enumerate(in_turn(pool, _found, paths, 2 * threads())):
            descriptors[k, : len(own)] = own
            found[paths[k]] = ImageFeatures(places, descriptors[k, : len(own)])
            progress("finding features", (k + 1) / len(paths))
    return found


def _matches(a: ImageFeatures, b: ImageFeatures, of_a: IntArray, of_b: IntArray) -> IntArray:
    """Numbers (m, 2) of the features that match, among those of each image (k,) that are compared."""
    import cv2

    alike = a.roots()[of_a] @ b.roots()[of_b].T
    if min(alike.shape) < MIN_MATCHES:
        return np.zeros((0, 2), np.int64)
    # Of descriptors of length 1 the square of the distance is 2 − 2 times their product.
    rows = np.arange(len(alike))
    best = alike.argmax(axis=1)
    most = alike.max(axis=0)
    product = alike[rows, best]
    alike[rows, best] = -1.0
    clear = 1.0 - product < MAX_RATIO**2 * (1.0 - alike.max(axis=1))
    chosen = np.flatnonzero(clear & (product == most[best]))
    out = np.column_stack([of_a[chosen], of_b[best[chosen]]]).astype(np.int64)
    if len(out) < MIN_MATCHES:
        return out
    first = a.places[out[:, 0], :2]
    second = b.places[out[:, 1], :2]
    try:
        _, fits = cv2.findFundamentalMat(first, second, cv2.USAC_FAST, MAX_EPIPOLAR_PX, 0.999, 2000)
    except cv2.error:  # where no sample of the matches gives a geometry
        return out[:0]
    return out[:0] if fits is None else out[np.asarray(fits).ravel() > 0]


def _found(path: ImageFile) -> tuple[FloatArray, NDArray[np.uint8]]:
    """Places and descriptors of the features of an image."""
    import cv2

    nothing = np.zeros((0, 3)), np.zeros((0, DESCRIPTOR), np.uint8)
    try:
        grey = cv2.cvtColor(read_pixels(path, 1), cv2.COLOR_RGB2GRAY)
    except ValueError:
        return nothing
    whole = np.array(grey.shape[::-1])
    size = np.maximum(np.rint(whole * min(REDUCED, MAX_SIDE_PX / whole.max())), 1).astype(int)
    # Means of areas that are no whole pixels displace what they show by up to 0.08 pixel; more is lost without them.
    interpolation = cv2.INTER_AREA if 2 * size[0] < whole[0] else cv2.INTER_LINEAR
    small = cv2.resize(grey, size.tolist(), interpolation=interpolation)
    sift = cv2.SIFT.create(MAX_IMAGE_FEATURES, enable_precise_upscale=True)
    keypoints, descriptors = sift.detectAndCompute(small, None)
    if not keypoints:
        return nothing
    # Features of equal contrast may be more than asked for.
    found = np.array([(*point.pt, 0.5 * point.size) for point in keypoints])[:MAX_IMAGE_FEATURES]
    stretch = whole / size
    found[:, :2] = (found[:, :2] + 0.5) * stretch - 0.5
    found[:, 2] = OF_SCALE * np.maximum(found[:, 2] * stretch.max(), 1.0)
    return found, descriptors[:MAX_IMAGE_FEATURES].astype(np.uint8)
