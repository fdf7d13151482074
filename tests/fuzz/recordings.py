"""Clouds, captures and bags."""

from __future__ import annotations

import gzip
import io
import lzma
import sys
from pathlib import Path
from zlib import crc32

import laspy
import numpy as np
import rasterio
from pyproj import CRS

from furrowmap.exporters.cloud.copc_file import CopcFormat
from furrowmap.exporters.cloud.point_batches import PointBatch
from furrowmap.exporters.cloud.writer import CopcWriter
from furrowmap.exporters.farm.surface_file import surface_file
from furrowmap.results import read_raster
from tests.core.readers import hesai_packets
from tests.core.readers.las.e57_files import PAGE, POSE, e57, paged, some_rows
from tests.core.readers.las.test_tables import COMPRESSED, ROWS, pcd, ply
from tests.core.readers.osf_files import osf_of
from tests.core.readers.small_bags import ROS1, T0_NS, livox_cloud, mixed, write_bag1, write_bag2
from tests.core.readers.test_ouster import in_fragments, recorded
from tests.core.readers.test_pcap_framing import PcapNg
from tests.core.readers.velodyne_packets import DUAL, HDL32E, frames, position_packet, rmc, turning, write_pcap
from tests.fuzz.mutations import Files
from tests.fuzz.reading import EACH_WAY, OF_THE_FOLDER, inspect_recording, read_cloud
from tests.fuzz.trials import Entry

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

T0_S = 1_781_141_020.0


def las(number: int, points: int, *, compressed: bool, seed: int = 1) -> bytes:
    """A small field of a point format, with an extra dimension and a CRS."""
    chance = np.random.default_rng(seed)
    header = laspy.LasHeader(version="1.4" if number >= 6 else "1.2", point_format=number)
    header.scales, header.offsets = np.full(3, 0.001), np.array([500_000.0, 5_000_000.0, 100.0])
    if number >= 6:
        header.add_extra_dim(laspy.ExtraBytesParams("scan", "uint16"))
        header.add_crs(CRS("EPSG:32654"))
    cloud = laspy.LasData(header)
    cloud.x = 500_000.0 + np.sort(chance.uniform(0, 30, points))
    cloud.y = 5_000_000.0 + chance.uniform(0, 30, points)
    cloud.z = 100.0 + 0.02 * chance.standard_normal(points)
    if "gps_time" in cloud.point_format.dimension_names:
        cloud.gps_time = 3e8 + np.cumsum(chance.choice([0.0, 1e-5, 5e-5, 0.1], points))
    cloud.intensity = chance.integers(0, 255, points)
    cloud.return_number = cloud.number_of_returns = np.ones(points, np.uint8)
    cloud.classification = np.full(points, 2, np.uint8)
    out = io.BytesIO()
    cloud.write(out, do_compress=compressed)
    return out.getvalue()


def las_seeds(folder: Path) -> list[Files]:
    return [{"cloud.las": las(number, 40, compressed=False)} for number in (0, 1, 3, 6, 7)]


def laz_seeds(folder: Path) -> list[Files]:
    return [{"cloud.laz": las(number, points, compressed=True)} for number in (1, 3, 6, 7, 8) for points in (30, 600)]


def copc_seeds(folder: Path) -> list[Files]:
    chance = np.random.default_rng(2)
    xyz_m = np.column_stack([chance.uniform(0, 30, (1500, 2)), chance.normal(0, 0.02, 1500)])
    kind = CopcFormat(CRS("EPSG:6677").to_wkt("WKT1_GDAL"), (16_600.0, 96_500.0, 270.0))
    path = folder / "cloud.copc.laz"
    with CopcWriter(path, kind, node_points=300) as writer:
        writer.append(PointBatch(xyz_m, T0_S + np.sort(chance.uniform(0, 60, 1500))))
        writer.close()
    return [{path.name: path.read_bytes()}]


def capture_seeds(folder: Path) -> list[Files]:
    stamps = [position_packet(1000.0, rmc())]
    recordings = {
        "single": [*stamps, *turning(30)],
        "dual": turning(24, mode=DUAL),
        "hdl": turning(24, product=HDL32E),
        "xt32": [*hesai_packets.turning("PandarXT-32", 24), hesai_packets.gps_packet(1000.0, rmc())],
        "p40": hesai_packets.turning("Pandar40P", 24, returns=2),
    }
    made = [write_pcap(folder / f"{name}.pcap", frames(packets)) for name, packets in recordings.items()]
    ng = PcapNg()
    blocks = [ng.packet(1_750_000_000_000_000 + 1327 * i, data) for i, (_, data) in enumerate(frames(turning(24)))]
    return [
        *({"recording.pcap": path.read_bytes()} for path in made),
        {"xt32.pcap": made[3].read_bytes(), "angles.csv": hesai_packets.calibration(15.0 - np.arange(32.0)).encode()},
        {"recording.pcapng": ng.section() + ng.interface() + b"".join(blocks)},
    ]


def ouster_seeds(folder: Path) -> list[Files]:
    seeds = []
    for mode in ("strongest", "dual"):
        path = recorded(folder, 0.1, return_mode=mode)
        data, said = path.read_bytes(), {"drive.json": path.with_suffix(".json").read_bytes()}
        seeds += [{path.name: data} | said, {path.name: data[:24] + b"".join(in_fragments(data))} | said]
    return seeds


def osf_seeds(folder: Path) -> list[Files]:
    capture = recorded(folder, 1.1, return_mode="dual")
    return [{"drive.osf": osf_of([capture], encoding=encoding)} for encoding in ("zpng", "png")]


def mend_osf(data: bytes) -> bytes:
    """With right checksums, as far as the lengths of parts lead from one to the next."""
    out, at = bytearray(data), 0
    while at + 8 < len(out) and (end := at + 4 + int.from_bytes(out[at : at + 4], "little")) + 4 <= len(out):
        out[end : end + 4] = crc32(out[at:end]).to_bytes(4, "little")
        at = end + 4
    return bytes(out)


def mend_e57(data: bytes) -> bytes:
    return paged(b"".join(data[k : k + PAGE - 4] for k in range(0, len(data), PAGE)))


def packed_seeds(folder: Path) -> list[Files]:
    plain = next(iter(capture_seeds(folder)[0].values()))
    return [
        {"recording.pcap.gz": gzip.compress(plain, mtime=0)},
        {"recording.pcap.xz": lzma.compress(plain)},
        {"recording.pcap.zst": zstd.compress(plain)},
    ]


def bag1_seeds(folder: Path) -> list[Files]:
    kinds = {"plain": None, "lz4": "LZ4", "bz2": "BZ2"}
    recorded = mixed(ROS1, clouds=2, points=32)
    line = np.zeros(
        40, [("offset_time", "u4"), *((axis, "f4") for axis in "xyz"), ("r", "u1"), ("tag", "u1"), ("n", "u1")]
    )
    line["offset_time"], line["x"] = np.linspace(0, 9e7, 40), 5.0
    livox = [("/livox/lidar", T0_NS + i * 10**8, livox_cloud(T0_NS + i * 10**8, line, ROS1)) for i in range(2)]
    positions = [each for each in recorded if each[2].__msgtype__.endswith("NavSatFix")]
    return [
        {"recording.bag": write_bag1(folder / f"{name}.bag", recorded, packed).read_bytes()}
        for name, packed in kinds.items()
    ] + [{"recording.bag": write_bag1(folder / "livox.bag", [*livox, *positions]).read_bytes()}]


def bag2_seeds(folder: Path) -> list[Files]:
    """Folders of ROS 2 bags; the first file is what is opened."""
    recorded = mixed(clouds=2, points=32)
    seeds = []
    for plugin, mode in (("MCAP", "NONE"), ("MCAP", "STORAGE"), ("SQLITE3", "NONE"), ("SQLITE3", "MESSAGE")):
        bag = write_bag2(folder / f"{plugin}{mode}".lower(), recorded, plugin, mode)
        data = {path.name: path.read_bytes() for path in sorted(bag.iterdir())}
        seeds.append(data)
    return seeds


def raster_seeds(folder: Path) -> list[Files]:
    seeds = []
    tiled = {"compress": "deflate", "tiled": True, "blockxsize": 16, "blockysize": 16}
    for name, options in {"plain": {}, "tiled": tiled}.items():
        path = folder / f"{name}.tif"
        profile = {"driver": "GTiff", "width": 40, "height": 30, "count": 2, "dtype": "float32", "crs": "EPSG:6677"}
        transform = rasterio.Affine(0.5, 0, 1000, 0, -0.5, 2000)
        with rasterio.open(path, "w", **profile, transform=transform, nodata=-9999.0, **options) as raster:
            raster.write(np.random.default_rng(1).random((2, 30, 40), np.float32))
        seeds.append({"surface.tif": path.read_bytes()})
    return seeds


def read_surface(path: Path) -> None:
    surface_file(path)
    read_raster(path)


RECORDINGS = (
    Entry("geotiff", raster_seeds, read_surface),
    Entry("las", las_seeds, (inspect_recording, read_cloud), trials=200),
    Entry("laz", laz_seeds, (inspect_recording, read_cloud), trials=200),
    Entry("copc", copc_seeds, (inspect_recording, read_cloud)),
    Entry(
        "pcd-ply",
        lambda _: [{"points": data} for data in (ply(ROWS), pcd(ROWS), COMPRESSED)],
        (inspect_recording, read_cloud),
    ),
    Entry("e57", lambda _: [{"scan.e57": e57(some_rows(150), pose=POSE)}], (inspect_recording, read_cloud), mend_e57),
    Entry("capture", capture_seeds, EACH_WAY),
    Entry("ouster", ouster_seeds, EACH_WAY, trials=50),
    Entry("ouster-osf", osf_seeds, EACH_WAY, mend_osf, trials=50),
    Entry("capture-packed", packed_seeds, EACH_WAY),
    Entry("rosbag1", bag1_seeds, EACH_WAY),
    Entry("rosbag2", bag2_seeds, OF_THE_FOLDER),
)
