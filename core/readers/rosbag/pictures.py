"""Image and CompressedImage messages to images, and CameraInfo messages to cameras.

Definitions: sensor_msgs, and REP-104 for CameraInfo. The bytes of the messages are copied to a scratch file one by one,
and decoded where their pixels are used.
"""

from __future__ import annotations

import mmap
import re
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.exif import MAX_PIXELS, layout_fault
from furrowmap.core.readers.rosbag.messages import stamp_s
from furrowmap.core.readers.rosbag.storage import BagMessage, Damage
from furrowmap.core.runtime.arrays import scratch_file
from furrowmap.core.values.camera import Camera
from furrowmap.core.values.images import Images, RawLayout, StoredImage

_SUFFIXES: Final = {b"\xff\xd8\xff": ".jpg", b"\x89PNG": ".png"}
"""By the first bytes of the formats of CompressedImage that are read."""
_EARLY_S: Final = 1e-3
"""Frames of a camera may come this much earlier than its rate states."""
_COMPRESSED_TOPIC: Final = re.compile(r"/compressed$")


class ImageLog:
    """Images collected from the messages of one topic.

    Args:
        every_s: images nearer than this to the one before are left out.
        kept: whether their bytes are kept, too.
    """

    def __init__(self, every_s: float, *, kept: bool) -> None:
        self._every_s, self._kept = every_s, kept
        self._file = scratch_file() if kept else None
        self._rows: list[tuple[str, int, int, RawLayout | None]] = []
        self._times: list[tuple[float, float]] = []
        self.encoding, self.size, self.left_out = "", "", 0

    def add(self, content: Any, message: BagMessage) -> None:
        """Add one message; Damage if its encoding is not supported, or its bytes are not such an image."""
        at_s = stamp_s(content, message)
        if self._times and 0.0 <= at_s - self._times[-1][0] < self._every_s - _EARLY_S:
            self.left_out += 1
            return
        data = np.asarray(content.data, np.uint8).tobytes()
        layout, suffix = None, ".raw"
        if hasattr(content, "encoding"):
            step, big_endian = int(content.step), bool(content.is_bigendian)
            layout = RawLayout(int(content.width), int(content.height), step, str(content.encoding), big_endian)
            fault = layout_fault(layout, len(data))
            if fault or layout.width * layout.height > MAX_PIXELS:
                raise Damage(fault or f"it has {layout.width} × {layout.height} pixels")
        else:
            suffix = next((suffix for start, suffix in _SUFFIXES.items() if data.startswith(start)), "")
            stated = str(content.format)
            if not suffix or stated.startswith("bayer") or "Depth" in stated:
                raise Damage(f"the format {stated[:40]!r} is not supported (supported: JPEG, PNG)")
        if not self._times:
            self.encoding = layout.encoding if layout is not None else str(content.format)
            self.size = f"{layout.width} × {layout.height}" if layout is not None else ""
        begin = self._rows[-1][2] if self._rows else 0
        if self._file is not None:
            self._file.write(data)
        name = f"{message.topic.strip('/').replace('/', '_')}_{at_s:.6f}{suffix}"
        self._rows.append((name, begin, begin + len(data), layout))
        self._times.append((at_s, message.received_ns * 1e-9))

    def __len__(self) -> int:
        return len(self._times)

    @property
    def t_s(self) -> NDArray[np.float64]:
        """Stamps (n,), sorted."""
        return np.sort(np.array([stamp for stamp, _ in self._times], np.float64))

    def delay_s(self) -> float:
        """Median of reception minus stamp."""
        return float(np.median([received - stamp for stamp, received in self._times]))

    def images(self) -> Images:
        """All images in the order of their stamps."""
        assert self._file is not None
        self._file.flush()
        with self._file as file:
            mapped = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
        stored = [StoredImage(name, mapped[begin:end], layout) for name, begin, end, layout in self._rows]
        return Images.sorted(stored, np.array([stamp for stamp, _ in self._times], np.float64))


def info_topic(topic: str, infos: Sequence[str]) -> str | None:
    """The topic of a camera's CameraInfo: beside its images (image_transport), else the only one; None without."""
    beside = f"{_COMPRESSED_TOPIC.sub('', topic).rpartition('/')[0]}/camera_info"
    return beside if beside in infos else infos[0] if len(infos) == 1 else None


def camera_of_info(content: Any, topic: str) -> Camera:
    """The camera of a CameraInfo message: K and D, or P for a topic of rectified images.

    Raises:
        ValueError: if the message is of a camera that is not calibrated or not supported.
    """
    k, d, p = (np.asarray(getattr(content, n, getattr(content, n.upper(), None)), np.float64).ravel() for n in "kdp")
    if max(content.binning_x, content.binning_y) > 1 or content.roi.x_offset or content.roi.y_offset:
        raise ValueError("it states binning or a region of interest")
    if "rect" in _COMPRESSED_TOPIC.sub("", topic).rpartition("/")[2]:
        k, d = p[[0, 1, 2, 4, 5, 6, 8, 9, 10]], np.zeros(0)
    if not (np.isfinite(k).all() and k[0] > 0.0 and k[4] > 0.0):
        raise ValueError("its matrix K is 0: the camera is not calibrated")
    known = content.distortion_model in ("plumb_bob", "rational_polynomial", "")
    if d.any() and (not known or np.any(d[5:]) or len(d) < 4):
        raise ValueError(f"its distortion model {content.distortion_model[:30]!r} is none with k1, k2, p1, p2 and k3")
    k1, k2, p1, p2, k3 = (float(value) for value in np.pad(d, (0, 5))[:5])
    fx, fy, cx, cy = (float(k[at]) for at in (0, 4, 2, 5))
    return Camera(int(content.width), int(content.height), fx, fy, cx, cy, k1, k2, k3, p1, p2)
