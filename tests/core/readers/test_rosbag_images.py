"""Images in bags: what was recorded comes out, with its time and its camera."""

from __future__ import annotations

import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from furrowmap.core.readers.image_pixels import image_size, read_pixels
from furrowmap.core.readers.reader import Reader, ReadOptions
from furrowmap.core.readers.rosbag.bags import RosBag1, RosBag2
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.session.opened import open_session
from tests.core.readers.image_bags import HEIGHT, WIDTH, compressed, filmed, gradient, image
from tests.core.readers.small_bags import ROS1, ROS2, T0_NS, nav_sat_fix, write_bag1, write_bag2

T0_S = T0_NS * 1e-9
TOPIC = "/camera/image_raw"
LEVELS = {"yu": 2, "uy": 2, "jpeg": 6, "bayer": 1}
"""How far colours may be off: JPEG is lossy, a mosaic has each of them at some pixels only."""


def bag(folder: Path, recorded: Any, ros: int = 2, **options: Any) -> Any:
    if ros == 1:
        return RosBag1([write_bag1(folder / "a.bag", recorded)], ReadOptions(**options))
    return RosBag2([write_bag2(folder / "a", recorded)], ReadOptions(**options))


def codes(reader: Reader) -> list[str]:
    return [notice.code for notice in reader.notices]


@pytest.mark.parametrize("ros", [1, 2])
@pytest.mark.parametrize(
    "encoding",
    [
        *("rgb8", "bgr8", "rgba8", "bgra8", "mono8", "mono16", "jpeg", "png"),
        *("8UC3", "8UC1", "16UC1", "yuv422", "uyvy", "yuv422_yuy2", "yuyv"),
        *("bayer_rggb8", "bayer_bggr8", "bayer_gbrg8", "bayer_grbg8"),
    ],
)
def test_images__are_what_was_recorded(tmp_path: Path, encoding: str, ros: int) -> None:
    reader = bag(tmp_path, filmed(encoding, store=ROS1 if ros == 1 else ROS2), ros)
    images = reader.images()
    assert images.t_s - T0_S == pytest.approx(0.1 * np.arange(4), abs=1e-6)
    assert images.paths[1].name.startswith("camera_image_raw_1780000000.100000.")
    tolerance = next((levels for name, levels in LEVELS.items() if encoding.startswith(name)), 0)
    for k, stored in enumerate(images.paths):
        truth = gradient(k).astype(int)
        if encoding.startswith(("mono", "8UC1", "16UC1", "yu", "uy")):
            truth = np.repeat(truth[:, :, :1], 3, axis=2)
        assert image_size(stored) == (WIDTH, HEIGHT)
        # At the border a mosaic has no neighbours to interpolate between.
        off = np.abs(read_pixels(stored, 1).astype(int) - truth)[2:-2, 2:-2]
        assert int(off.max()) <= tolerance
        assert read_pixels(stored, 2).shape == (HEIGHT // 2, WIDTH // 2, 3)
    assert reader.notices == []


def test_inspect__names_the_images_and_their_camera(tmp_path: Path) -> None:
    reader = bag(tmp_path, filmed("bgr8"))
    found = reader.inspect()
    facts = found.facts["images"]
    assert (facts["topic"], facts["images"], facts["encoding"], facts["size"]) == (TOPIC, 4, "bgr8", "24 × 16")
    assert facts["intrinsics"]["fy"] == 31.0
    clock = found.clocks[-1]
    assert (clock.first_s, clock.last_s) == pytest.approx((T0_S, T0_S + 0.3), abs=1e-6)
    assert "received 0.004 s later" in clock.note
    # Another topic of the same images, without intrinsics beside it but with the only ones of the bag.
    both = [
        *filmed("rgb8"),
        *((t, at + 1, m) for t, at, m in filmed("png", 2, topic="/other/x/compressed") if "x" in t),
    ]
    other = bag(tmp_path / "2", both).inspect()
    assert other.facts["images"]["topic"] == TOPIC
    assert "bag-topic-chosen" in {notice.code for notice in other.notices}


def test_camera__is_that_of_the_topic(tmp_path: Path) -> None:
    camera = bag(tmp_path, filmed("jpeg", topic="/camera/image_raw/compressed")).camera()
    assert (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy) == (24, 16, 30.0, 31.0, 11.5, 7.5)
    assert camera.distortion.tolist() == [-0.1, 0.02, 0.001, -0.002, 0.003]
    rectified = bag(tmp_path / "2", filmed("rgb8", topic="/camera/image_rect_color")).camera()
    assert (rectified.fx, rectified.cy, rectified.distortion.any()) == (28.0, 8.0, False)


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"k": np.zeros(9)}, "not calibrated"),
        ({"distortion_model": "equidistant"}, "'equidistant'"),
        ({"distortion_model": "rational_polynomial", "d": np.full(8, 0.01)}, "none with k1, k2, p1, p2 and k3"),
        ({"x_offset": 4}, "region of interest"),
    ],
)
def test_camera_that_does_not_serve__is_refused(tmp_path: Path, changed: dict[str, Any], why: str) -> None:
    reader = bag(tmp_path, filmed("rgb8", **changed))
    with pytest.raises(InputError, match=why) as refused:
        reader.camera()
    assert refused.value.code == "no-intrinsics"
    assert reader.inspect().facts["images"]["intrinsics"] == "none"


def test_bag_without_intrinsics__says_so(tmp_path: Path) -> None:
    reader = bag(tmp_path, [row for row in filmed("rgb8") if row[0] == TOPIC])
    with pytest.raises(InputError, match="no CameraInfo messages"):
        reader.camera()


def test_images__are_thinned_and_damaged_ones_counted(tmp_path: Path) -> None:
    recorded = [row for row in filmed("rgb8", 12) if row[0] == TOPIC]
    cut = image(T0_NS + 1_200_000_000, gradient())
    cut.data = cut.data[:100]
    reader = bag(tmp_path, [*recorded, (TOPIC, recorded[-1][1] + 100_000_000, cut)], glance_s=0.3)
    images = reader.images()
    assert images.t_s - T0_S == pytest.approx([0.0, 0.3, 0.6, 0.9], abs=1e-6)
    assert codes(reader) == ["bag-messages-damaged", "images-left-out"]
    assert "16 rows of 75 bytes are stated, there are 100 bytes" in reader.notices[0].text


@pytest.mark.parametrize(
    ("message", "why"),
    [
        (image(T0_NS, gradient(), "rgb8"), "'32FC1' is not supported"),
        (compressed(T0_NS, b"RIFF....WEBP", "webp"), "supported: JPEG, PNG"),
    ],
)
def test_encoding_that_is_not_read__is_named(tmp_path: Path, message: Any, why: str) -> None:
    if hasattr(message, "encoding"):
        message.encoding = "32FC1"
    with pytest.raises(InputError, match=why) as refused:
        bag(tmp_path, [(TOPIC, T0_NS, message)]).images()
    assert refused.value.code == "bag-undecodable"


def test_memory__holds_one_image_not_all(tmp_path: Path) -> None:
    large = np.zeros((300, 400, 3), np.uint8)
    reader = bag(
        tmp_path, [(TOPIC, T0_NS + 10**8 * k, image(T0_NS + 10**8 * k, large, pad=0)) for k in range(20)], ros=2
    )
    tracemalloc.start()
    images = reader.images()
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(images) == 20
    assert peak < 12 * large.nbytes


def session(folder: Path, camera: str) -> Path:
    write_bag2(folder / "drive", [*filmed("jpeg"), ("/fix", T0_NS + 10**9, nav_sat_fix(T0_NS))])
    path = folder / "session.toml"
    files = "" if "files" in camera else 'files = ["drive"]\n'
    head = 'furrowmap = 1\n[recording]\nlidar = ["drive"]\ngnss = ["drive"]\n[crs]\nmap = "EPSG:6677"\n'
    path.write_text(f"{head}[camera]\n{files}{camera}", encoding="utf-8")
    return path


def test_session__has_images_and_camera_of_a_topic(tmp_path: Path) -> None:
    text = (
        f'topic = "{TOPIC}"\nevery_s = 0.2\nminus_gnss_s = 2.0\nrpy_deg = [180.0, 0.0, -90.0]\nshutter_delay_s = 0.01\n'
    )
    opened = open_session(session(tmp_path, text))
    images, notices = opened.images()
    assert images.t_s - T0_S == pytest.approx([-2.0, -1.8], abs=1e-6)
    assert opened.images()[0].paths == images.paths
    assert [notice.code for notice in notices] == ["images-left-out"]
    camera = opened.camera()
    assert (camera.fx, camera.rpy_deg, camera.shutter_delay_s) == (30.0, (180.0, 0.0, -90.0), 0.01)
    assert opened.inputs.all == ((tmp_path / "drive").resolve(),)
    stated = session(
        tmp_path / "2", f'topic = "{TOPIC}"\nwidth = 24\nheight = 16\nfx = 33.0\nfy = 33.0\ncx = 12.0\ncy = 8.0\n'
    )
    assert open_session(stated).camera().fx == 33.0


@pytest.mark.parametrize(
    ("camera", "what"),
    [
        ('topic = "/x"\nfiles = []\n', "camera.topic is of bags|names no images"),
        ("every_s = 0.5\nwidth = 2\nheight = 2\nfx = 2.0\nfy = 2.0\ncx = 1.0\ncy = 1.0\n", "camera.every_s thins"),
        ('topic = "/x"\nfx = 33.0\n', "camera.width and camera.height"),
    ],
)
def test_session__with_keys_that_do_not_go_together_is_refused(tmp_path: Path, camera: str, what: str) -> None:
    with pytest.raises(InputError, match=what):
        open_session(session(tmp_path, camera))


def test_session__names_a_topic_that_the_bag_does_not_have(tmp_path: Path) -> None:
    opened = open_session(session(tmp_path, 'topic = "/nothing"\n'))
    with pytest.raises(InputError, match=r"no topic /nothing with images .topics: /camera/image_raw"):
        opened.images()


@pytest.mark.parametrize(("at", "name"), [(0, "fx"), (4, "fy")])
def test_camera__of_a_focal_length_that_is_none_is_refused(at: int, name: str, tmp_path: Path) -> None:
    for focal, serves in ((1e-3, True), (0.0, False), (-30.0, False), (np.nan, False), (np.inf, False)):
        k = np.array([30.0, 0.0, 11.5, 0.0, 31.0, 7.5, 0.0, 0.0, 1.0])
        k[at] = focal
        reader = bag(tmp_path / repr(focal), filmed("rgb8", 1, k=k))
        if serves:
            assert getattr(reader.camera(), name) == focal
        else:
            with pytest.raises(InputError, match="not calibrated"):
                reader.camera()


@pytest.mark.parametrize(
    ("d", "expected"),
    [
        ([], [0.0] * 5),
        ([0.0] * 3, [0.0] * 5),
        ([0.1, 0.2, 0.3], None),
        ([0.1, 0.2, 0.3, 0.4], [0.1, 0.2, 0.3, 0.4, 0.0]),
        ([0.1, 0.2, 0.3, 0.4, 0.5], [0.1, 0.2, 0.3, 0.4, 0.5]),
        ([0.1, 0.2, 0.3, 0.4, 0.5, 0.0, 0.0, 0.0], [0.1, 0.2, 0.3, 0.4, 0.5]),
        ([0.1, 0.2, 0.3, 0.4, 0.5, 1e-9, 0.0, 0.0], None),
    ],
)
@pytest.mark.parametrize("model", ["plumb_bob", "rational_polynomial", "", "equidistant"])
def test_camera__has_k1_k2_p1_p2_k3_or_none_of_them(
    model: str, d: list[float], expected: list[float] | None, tmp_path: Path
) -> None:
    """REP-104: D is k1, k2, t1, t2, k3 and, of the rational model, k4 to k6. Without distortion, no model matters."""
    reader = bag(tmp_path, filmed("rgb8", 1, d=np.array(d), distortion_model=model))
    if expected is None or (model == "equidistant" and any(d)):
        with pytest.raises(InputError, match="distortion model"):
            reader.camera()
    else:
        camera = reader.camera()
        assert [camera.k1, camera.k2, camera.p1, camera.p2, camera.k3] == expected


@pytest.mark.parametrize(("field", "most"), [("binning_x", 1), ("binning_y", 1), ("x_offset", 0), ("y_offset", 0)])
def test_camera__of_a_part_of_the_sensor_is_refused(field: str, most: int, tmp_path: Path) -> None:
    """A binning of 1 is none, as is 0 (CameraInfo.msg)."""
    for value, serves in ((most, True), (most + 1, False)):
        recorded = filmed("rgb8", 1)
        info = recorded[1][2]
        setattr(info.roi if "offset" in field else info, field, value)
        reader = bag(tmp_path / str(value), recorded)
        if serves:
            assert reader.camera().fx == 30.0
        else:
            with pytest.raises(InputError, match="binning or a region of interest"):
                reader.camera()
