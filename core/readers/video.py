"""Frames of a video with their times."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.plain_reads import open_plain

VIDEO_SUFFIXES: Final = frozenset({".avi", ".m4v", ".mkv", ".mov", ".mp4", ".mts", ".webm"})
_BOXES: Final = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip")
_SIGNATURES: Final = (b"RIFF", b"\x1a\x45\xdf\xa3")


class Video:
    """A video, read once from its beginning by the FFmpeg within OpenCV; its frames are counted by the container.

    InputError if it is none, or of a codec that FFmpeg does not have.
    """

    def __init__(self, path: Path) -> None:
        import cv2

        with open_plain(path) as file:
            head = file.read(377)
        # FFmpeg opens playlists as well, which name other files and addresses
        is_stream = (head[:1] == b"\x47" and head[188:189] == b"\x47") or head[4:5] == head[196:197] == b"\x47"
        if not (head.startswith(_SIGNATURES) or head[4:8] in _BOXES or is_stream):
            raise InputError("video-unreadable", path=path)
        self._film = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
        if not self._film.isOpened():
            raise InputError("video-unreadable", path=path)
        self._film.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)  # intrinsics are of the pixels as they are stored
        self.count = max(int(self._film.get(cv2.CAP_PROP_FRAME_COUNT)), 0)

    def frames(self, every: int) -> Iterator[tuple[float, NDArray[np.uint8]]]:
        """The first frame and each `every`-th after it: seconds since the first, and pixels (height, width, 3), RGB."""
        import cv2

        number = 0
        begin_s = 0.0
        while self._film.grab():
            at_s = 1e-3 * self._film.get(cv2.CAP_PROP_POS_MSEC)
            begin_s = at_s if number == 0 else begin_s
            if number % every == 0:
                known, pixels = self._film.retrieve()
                if known:
                    yield at_s - begin_s, np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB), np.uint8)
            number += 1
