"""Features of images and their matches, by COLMAP on the processor.

SIFT (Lowe 2004), matched both ways, the matches of two images checked by their epipolar geometry.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.exif import write_image
from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.runtime.settings import threads
from furrowmap.core.values.camera import COLMAP_MIDDLE, Camera
from furrowmap.core.values.images import RAW, ImageFile, StoredImage

Pair = tuple[int, int]

MAX_IMAGE_FEATURES: Final = 2000
"""Of an image; those of the largest scales are kept."""
MIN_CONTRAST: Final = 0.0083
"""COLMAP's `peak_threshold`, 1.25 times its own: a quarter fewer features to match, the poses as accurate."""
MIN_MATCHES: Final = 15
"""Two images with fewer are not linked."""
OF_SCALE: Final = 0.06
"""Standard deviation of a feature's place in units of its scale, before residuals show it."""
BATCH: Final = 8
"""Images, and pairs for each image of these, between two calls of `progress`."""


class FeatureStore:
    """Features and matches of some images, in a database in a folder."""

    def __init__(self, folder: Path, paths: Sequence[ImageFile], camera: Camera) -> None:
        import pycolmap

        # What is wrong with an image shows in its features; errors are raised.
        pycolmap.logging.minloglevel = int(pycolmap.logging.FATAL)
        self._colmap: Any = pycolmap
        self._folder, self._camera = folder, camera
        self._database = folder / "features.db"
        self._images = folder / "images"
        self._images.mkdir()
        # COLMAP's lists of pairs have no names with spaces.
        self._names = [f"{k:07d}{'.tif' if path.suffix == RAW else path.suffix}" for k, path in enumerate(paths)]
        self._paths = paths

    def extract(self, progress: Progress) -> None:
        """Find the features of all images; reports the stage "finding features"."""
        options = self._colmap.FeatureExtractionOptions()
        options.use_gpu, options.num_threads = False, threads()
        options.sift.max_num_features, options.sift.first_octave = MAX_IMAGE_FEATURES, 0
        options.sift.peak_threshold = MIN_CONTRAST
        c = self._camera
        reader = self._colmap.ImageReaderOptions()
        reader.camera_model = "FULL_OPENCV"
        params = (
            c.fx, c.fy, c.cx + COLMAP_MIDDLE, c.cy + COLMAP_MIDDLE, c.k1, c.k2, c.p1, c.p2, c.k3, 0.0, 0.0, 0.0
        )  # fmt: skip
        reader.camera_params = ",".join(map(repr, params))
        for begin in range(0, len(self._names), BATCH):
            progress("finding features", begin / len(self._names))
            names = self._names[begin : begin + BATCH]
            for name, path in zip(names, self._paths[begin : begin + BATCH], strict=True):
                _put(path, self._images / name)
            self._colmap.extract_features(
                self._database,
                self._images,
                image_names=names,
                camera_mode=self._colmap.CameraMode.SINGLE if begin == 0 else self._colmap.CameraMode.AUTO,
                reader_options=reader,
                extraction_options=options,
                device=self._colmap.Device.cpu,
            )
            for name in names:
                (self._images / name).unlink()
        progress("finding features", 1.0)

    def match(self, pairs: Sequence[Pair], progress: Progress) -> None:
        """Match pairs of images; reports the stage "matching images"."""
        options = self._colmap.FeatureMatchingOptions()
        options.use_gpu, options.num_threads = False, threads()
        checking = self._colmap.TwoViewGeometryOptions()
        checking.ransac.random_seed = 0
        pairing = self._colmap.ImportedPairingOptions()
        pairing.match_list_path = self._folder / "pairs.txt"
        for begin in range(0, len(pairs), BATCH * BATCH):
            progress("matching images", begin / len(pairs))
            batch = pairs[begin : begin + BATCH * BATCH]
            lines = [f"{self._names[a]} {self._names[b]}\n" for a, b in batch]
            pairing.match_list_path.write_text("".join(lines), encoding="ascii")
            self._colmap.match_image_pairs(
                self._database,
                matching_options=options,
                pairing_options=pairing,
                verification_options=checking,
                device=self._colmap.Device.cpu,
            )
        progress("matching images", 1.0)

    def found(self) -> tuple[dict[int, FloatArray], dict[Pair, IntArray]]:
        """Column, row and standard deviation of both (k, 3) of the features by image; matches (m, 2) by two images."""
        database = self._colmap.Database.open(self._database)
        try:
            number = {image.image_id: int(Path(image.name).stem) for image in database.read_all_images()}
            keypoints = {number[k]: _places_and_sigmas(database.read_keypoints(k)) for k in number}
            matches = {}
            for key, geometry in zip(*database.read_two_view_geometries(), strict=True):
                a, b = (number[k] for k in self._colmap.pair_id_to_image_pair(key))
                if len(geometry.inlier_matches) >= MIN_MATCHES:
                    matches[a, b] = geometry.inlier_matches.astype(np.int64)
        finally:
            database.close()
        return keypoints, matches


@contextmanager
def feature_store(paths: Sequence[ImageFile], camera: Camera) -> Iterator[FeatureStore]:
    """A store in a temporary folder."""
    with tempfile.TemporaryDirectory(prefix="furrowmap-") as folder:
        yield FeatureStore(Path(folder), paths, camera)


def _put(image: ImageFile, name: Path) -> None:
    """Make a link to a file, or a copy where the system allows no links; write an image of a recording."""
    if isinstance(image, StoredImage):
        write_image(image, name)
        return
    try:
        name.symlink_to(image.resolve())
    except OSError:
        shutil.copyfile(image, name)


def _places_and_sigmas(keypoints: NDArray[np.float32]) -> FloatArray:
    """(k, 3) of COLMAP's keypoints: a place and a 2 × 2 shape each."""
    out = np.empty((len(keypoints), 3))
    if len(keypoints):
        out[:, :2] = keypoints[:, :2] - COLMAP_MIDDLE
        out[:, 2] = OF_SCALE * np.maximum(np.hypot(keypoints[:, 2], keypoints[:, 4]), 1.0)
    return out
