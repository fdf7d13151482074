"""Sensor recordings: inspecting and opening them, and laser scans as range images."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers import reader
from furrowmap.core.readers.reader import Reader, ReadOptions
from furrowmap.core.session.examination import Examined
from furrowmap.core.values.scan import Scan


def open_recording(*paths: str | Path, near_s: float | None = None, model: str | None = None) -> Reader:
    """Open the files of one recording: a capture, a bag, a GNSS log, a trajectory, task data.

    The reader gives what its format holds: `scans()`, an iterator of `Scan`; `track()`, the positions of a GNSS
    receiver; `poses()`, a trajectory; `states()`, tool states. `notices` are the warnings so far.

    Args:
        paths: in time order, all of one format.
        near_s: a UTC time of the recording, for clocks that show only a part of it, such as the minutes of an hour.
        model: the scanner's model, such as "VLP-16", where the packets name a wrong one.

    Raises:
        InputError: if a file is missing, damaged or of an unknown format.
    """
    return reader.open_recording([Path(path) for path in paths], ReadOptions(near_s=near_s, model=model))


def range_image(scan: Scan, lasers: int | None = None) -> NDArray[np.float32]:
    """The ranges of one scan as an image.

    Args:
        scan: one revolution.
        lasers: rows of the image; by default up to the highest laser that has a return in this scan.

    Returns:
        (lasers, firings) float32 range in metres, the highest laser in the first row, the first firing in the first
        column; nan where nothing returned. Of several returns of a firing the last one counts.
    """
    rows, columns = (int(index.max()) + 1 if len(scan) else 0 for index in (scan.laser, scan.column))
    image = np.full((lasers or rows, columns), np.nan, np.float32)
    image[scan.laser, scan.column] = np.linalg.norm(scan.xyz_m, axis=1)
    return image[::-1]


def inspect(path: str | Path) -> Examined:
    """Read a file through.

    Returns:
        What the file is and holds (`inspection`), and a reader opened on it.

    Raises:
        InputError: if no reader knows the file, or it cannot be read.
    """
    return Examined.read(Path(path))
