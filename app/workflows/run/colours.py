"""Colours of a run: its points on their way to what colours the cloud and makes the orthophoto."""

from contextlib import ExitStack
from pathlib import Path
from threading import Lock
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.images.colouring import NO_FRAME, ColourMaker, Colours
from furrowmap.core.images.image_frames import Frames
from furrowmap.core.pointclouds.placed_scans import PLACED_AHEAD, PlacedScan
from furrowmap.core.runtime.background import behind
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.values.clock import las_time_to_utc
from furrowmap.core.values.scan import PointClass
from furrowmap.exporters.cloud.layers import ChunkColumns
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.result_folder import DSM, ORTHOPHOTO
from furrowmap.exporters.rasters.orthophoto_file import write_orthophoto
from furrowmap.exporters.vectors.qgis_styles import write_raster_style

NOT_COLOURED: Final = np.array([PointClass.NOISE, PointClass.VEHICLE, PointClass.IMPLEMENT], np.uint8)
"""Classes without colours: the machine has moved in the next frame."""


class RunColours:
    """Depth maps of the frames in a thread beside the run; then colours for the points of its cloud."""

    def __init__(self, frames: Frames, origin_m: tuple[float, float, float]) -> None:
        self._maker: ColourMaker | None = ColourMaker(frames, origin_m)
        self._working = ExitStack()
        self._origin_m = origin_m
        self._lock = Lock()
        self._counts = np.zeros(3, np.int64)
        self._ortho_m2 = 0.0
        self._colours: Colours | None = None

    def __enter__(self) -> Self:
        assert self._maker is not None
        self._add = self._working.enter_context(behind(self._maker.add, PLACED_AHEAD))
        return self

    def __exit__(self, *error: Any) -> None:
        self._working.__exit__(*error)

    def add(self, placed: PlacedScan) -> None:
        """Take the points of some scans."""
        self._add(placed.xyz_m[placed.kept])

    def add_points(self, xyz_m: NDArray[np.float64], classification: NDArray[np.uint8]) -> None:
        """Take points (n, 3), against the local origin, with their classes (n,)."""
        self._add(xyz_m[~np.isin(classification, NOT_COLOURED)])

    def finish(self, progress: Progress) -> None:
        """Read the images, now that all points are known."""
        assert self._maker is not None
        self._working.close()
        self._colours = self._maker.finish(progress)
        self._maker = None

    def paint(self, points: ChunkColumns, scale_m: float) -> None:
        """Colour points against the local origin, in place; called from several threads."""
        assert self._colours is not None
        assert points.rgb is not None
        wanted = np.flatnonzero(~np.isin(points.classification, NOT_COLOURED))
        xyz = np.column_stack([axis[wanted] * scale_m for axis in (points.x, points.y, points.z)])
        rgb, frame = self._colours.of_points(xyz, las_time_to_utc(points.gps_time[wanted]))
        points.rgb[:, wanted] = rgb
        unseen = int(np.count_nonzero(frame == NO_FRAME))
        with self._lock:
            self._counts += [len(wanted) - unseen, unseen, len(points) - len(wanted)]

    def write_orthophoto(self, folder: Path, origin: Origin, progress: Progress) -> None:
        """Write the orthophoto of the surface in a folder, and its style."""
        assert self._colours is not None
        if not (folder / DSM).exists():
            return
        photo = folder / ORTHOPHOTO
        self._ortho_m2 = write_orthophoto(photo, folder / DSM, self._colours, self._origin_m, origin, progress)
        if not self._ortho_m2:
            photo.unlink()
            return
        write_raster_style(photo, "orthophoto.qml")

    def figures(self) -> tuple[dict[str, Any], list[Notice]]:
        """Figures of the cloud's colours for the report, when it is written, and warnings.

        `points_not_seen` and `points_left_out` are points that no frame sees, and those of the machine and noise;
        `vignetting_corner` is the share of the light that is lost in the corners; `exposure_spread` the standard
        deviation of the logarithms of the frames' exposures.
        """
        assert self._colours is not None
        pixels = self._colours.pixels
        balance = self._colours.balance
        coloured, unseen, left_out = self._counts.tolist()
        notices = [*self._colours.notices]
        if coloured + unseen and not coloured:
            notices.append(Notice("nothing-coloured"))
        figures = {
            "images": int(pixels.usable.sum()),
            "points_coloured": coloured,
            "points_not_seen": unseen,
            "points_left_out": left_out,
            "image_reduction": pixels.reduction,
            "orthophoto_area_m2": round(self._ortho_m2, 1),
            "vignetting_corner": round(balance.corner, 4),
            "exposure_spread": round(float(balance.gain.std()), 4),
        }
        return figures, notices
