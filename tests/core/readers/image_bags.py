"""Messages of cameras for small bags."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tests.core.readers.small_bags import ROS2, T0_NS, Recorded, header

RGB = NDArray[np.uint8]
WIDTH, HEIGHT = 24, 16


def gradient(k: int = 0) -> RGB:
    """An image (16, 24, 3) whose channels are planes, so that interpolation between neighbours is exact."""
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    return np.stack([40 + 4 * u + k, 200 - 6 * v, 60 + 2 * u + 2 * v], axis=2).astype(np.uint8)


def mosaic(rgb: RGB, pattern: str) -> RGB:
    """What a sensor with a Bayer filter gives: `pattern` names the first two pixels of the first and second row."""
    out = np.zeros(rgb.shape[:2], np.uint8)
    for k, letter in enumerate(pattern):
        at = slice(k // 2, None, 2), slice(k % 2, None, 2)
        out[at] = rgb[(*at, "rgb".index(letter))]
    return out


def raw_bytes(rgb: RGB, encoding: str) -> RGB:
    """Rows (height, bytes) of an image in an encoding."""
    grey = rgb[:, :, 0]
    opaque = np.full((*grey.shape, 1), 255, np.uint8)
    made: dict[str, RGB] = {
        "rgb8": rgb,
        "bgr8": rgb[:, :, ::-1],
        "rgba8": np.concatenate([rgb, opaque], axis=2),
        "bgra8": np.concatenate([rgb[:, :, ::-1], opaque], axis=2),
        "mono8": grey,
        "mono16": np.stack([np.zeros_like(grey) + 7, grey], axis=2),
    }
    made |= {"8UC3": made["bgr8"], "8UC1": made["mono8"], "16UC1": made["mono16"]}  # as OpenCV names them
    luma, none = np.round(16.0 + grey * (219.0 / 255.0)).astype(np.uint8), np.full_like(grey, 128)  # ITU-R BT.601
    made |= dict.fromkeys(("yuv422", "uyvy"), np.stack([none, luma], axis=2))
    made |= dict.fromkeys(("yuv422_yuy2", "yuyv"), np.stack([luma, none], axis=2))
    if encoding.startswith("bayer_"):
        made[encoding] = mosaic(rgb, encoding[6:10])
    return np.ascontiguousarray(made[encoding]).reshape(len(rgb), -1)


def image(stamp_ns: int, rgb: RGB, encoding: str = "rgb8", store: Any = ROS2, pad: int = 3) -> Any:
    """An Image with `pad` unused bytes at the end of each row."""
    rows = np.pad(raw_bytes(rgb, encoding), ((0, 0), (0, pad)))
    return store.types["sensor_msgs/msg/Image"](
        header=header(stamp_ns, store),
        height=rgb.shape[0],
        width=rgb.shape[1],
        encoding=encoding,
        is_bigendian=0,
        step=rows.shape[1],
        data=rows.ravel(),
    )


def compressed(stamp_ns: int, data: bytes, kind: str, store: Any = ROS2) -> Any:
    """A CompressedImage of a file's bytes."""
    return store.types["sensor_msgs/msg/CompressedImage"](
        header=header(stamp_ns, store), format=f"rgb8; {kind} compressed bgr8", data=np.frombuffer(data, np.uint8)
    )


def packed(rgb: RGB, kind: str) -> bytes:
    """The image as a JPEG or PNG file."""
    out = io.BytesIO()
    Image.fromarray(rgb).save(out, kind, **({"quality": 95, "subsampling": 0} if kind == "JPEG" else {}))
    return out.getvalue()


def camera_info(stamp_ns: int, store: Any = ROS2, **changed: Any) -> Any:
    """A CameraInfo of a camera of 24 × 16 pixels; its matrix P has other numbers than K."""
    k = np.array([30.0, 0.0, 11.5, 0.0, 31.0, 7.5, 0.0, 0.0, 1.0])
    p = np.array([28.0, 0.0, 12.0, 0.0, 0.0, 29.0, 8.0, 0.0, 0.0, 0.0, 1.0, 0.0])
    names = {"k": k, "d": np.array([-0.1, 0.02, 0.001, -0.002, 0.003]), "r": np.eye(3).ravel(), "p": p}
    kind = store.types["sensor_msgs/msg/CameraInfo"]
    names = {**names, **{name: value for name, value in changed.items() if name in names}}
    cased = names if store is ROS2 else {name.upper(): value for name, value in names.items()}
    roi = store.types["sensor_msgs/msg/RegionOfInterest"](
        x_offset=changed.get("x_offset", 0), y_offset=0, height=0, width=0, do_rectify=False
    )
    return kind(
        header=header(stamp_ns, store),
        height=HEIGHT,
        width=WIDTH,
        distortion_model=changed.get("distortion_model", "plumb_bob"),
        **cased,
        binning_x=0,
        binning_y=0,
        roi=roi,
    )


def filmed(
    encoding: str, count: int = 4, store: Any = ROS2, topic: str = "/camera/image_raw", **changed: Any
) -> list[Recorded]:
    """Images every 0.1 s, received 4 ms later, each different, with CameraInfo beside them."""
    recorded: list[Recorded] = []
    for k in range(count):
        at_ns = T0_NS + 100_000_000 * k
        if encoding in ("jpeg", "png"):
            message = compressed(at_ns, packed(gradient(k), encoding.upper()), encoding, store)
        else:
            message = image(at_ns, gradient(k), encoding, store)
        recorded.append((topic, at_ns + 4_000_000, message))
        recorded.append(("/camera/camera_info", at_ns + 4_000_001, camera_info(at_ns, store, **changed)))
    return recorded
