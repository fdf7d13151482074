"""Ground of hand-labelled samples: furrowmap beside the cloth simulation filter, in the same run.

    python benchmarks/ground.py [DIR]

DIR holds samples of the ISPRS filter test (G. Sithole, G. Vosselman, 2004, Experimental comparison of filter algorithms
for bare-earth extraction from airborne laser scanning point clouds, ISPRS Journal of Photogrammetry and Remote Sensing
59, 85-101) as files of the Point Cloud Library: `sampNN.pcd.gz`, and `sampNN-ground.pcd.gz` with the points that are
ground. Kappa is Cohen's agreement beyond chance; type I errors are ground that is lost, type II objects that are kept.
The cloth, by its authors' library where `CSF` is installed, has their settings for cities on flat ground or on slopes:
0.5 m, threshold 0.5 m, rigidness 3 or 2, with their smoothing of slopes for the latter.
"""

import gzip
import os
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import laspy
import numpy as np
from numpy.typing import NDArray

import furrowmap
from furrowmap.core.pointclouds.cleaning_steps import Cleaning
from furrowmap.settings import CleanSettings

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

SAMPLES = Path(__file__).resolve().parents[1] / "../shared/data/ground_isprs"
LONG_MATCH = 7


def decompressed(packed: bytes, size: int) -> bytes:
    """Bytes of LZF blocks (Marc Lehmann's LibLZF)."""
    out = bytearray()
    at = 0
    while at < len(packed):
        control = packed[at]
        at += 1
        if control < 32:
            out += packed[at : at + control + 1]
            at += control + 1
            continue
        length = control >> 5
        if length == LONG_MATCH:
            length += packed[at]
            at += 1
        start = len(out) - ((control & 31) << 8) - packed[at] - 1
        at += 1
        for k in range(length + 2):
            out.append(out[start + k])
    if len(out) != size:
        raise ValueError(f"{len(out)} bytes instead of {size}")
    return bytes(out)


def points_of(path: Path) -> NDArray[np.float32]:
    """Points (n, 3) of a PCD file with three floats a point, compressed column by column."""
    content = gzip.decompress(path.read_bytes())
    head, _, body = content.partition(b"DATA binary_compressed\n")
    if not body or b"FIELDS x y z\nSIZE 4 4 4" not in head:
        raise ValueError(f"{path}: not a compressed file of x, y and z")
    packed, size = np.frombuffer(body, "<u4", 2).tolist()
    columns = np.frombuffer(decompressed(body[8 : 8 + packed], size), "<f4").reshape(3, -1)
    return np.ascontiguousarray(columns.T)


def sample(path: Path) -> tuple[FloatArray, BoolArray]:
    """Points (n, 3) of a sample and which are ground; several may lie in one place."""
    points = points_of(path)
    labelled = Counter(row.tobytes() for row in points_of(path.with_name(path.name.replace(".pcd", "-ground.pcd"))))
    truth = np.zeros(len(points), bool)
    for k, row in enumerate(points):
        key = row.tobytes()
        if labelled[key] > 0:
            labelled[key] -= 1
            truth[k] = True
    return points.astype(np.float64), truth


def agreement(truth: BoolArray, found: BoolArray) -> tuple[float, float, float, float]:
    """Kappa, type I, type II and total error in per cent."""
    lost = float((truth & ~found).mean())
    kept = float((found & ~truth).mean())
    ground = float(truth.mean())
    taken = float(found.mean())
    chance = ground * taken + (1.0 - ground) * (1.0 - taken)
    kappa = (1.0 - lost - kept - chance) / (1.0 - chance)
    return 100.0 * kappa, 100.0 * lost / ground, 100.0 * kept / (1.0 - ground), 100.0 * (lost + kept)


def cloth(xyz_m: FloatArray, *, rigidness: int, smooth: bool) -> BoolArray:
    """Ground by the library of the cloth simulation filter."""
    import CSF

    filter_ = CSF.CSF()
    filter_.params.bSloopSmooth = smooth
    filter_.params.cloth_resolution = 0.5
    filter_.params.class_threshold = 0.5
    filter_.params.rigidness = rigidness
    filter_.setPointCloud(xyz_m - xyz_m.mean(axis=0))
    found = CSF.VecInt()
    rest = CSF.VecInt()
    kept = os.dup(1)
    try:
        os.dup2(2, 1)  # the library prints
        filter_.do_filtering(found, rest, exportCloth=False)
    finally:
        os.dup2(kept, 1)
        os.close(kept)
    ground = np.zeros(len(xyz_m), bool)
    ground[np.array(found, np.intp)] = True
    return ground


def by_command(xyz_m: FloatArray) -> BoolArray:
    """Which points (n, 3) `furrowmap cloud --ground smrf` calls ground.

    Their order changes: the number of each stands in its point source ID and its intensity.
    """
    with TemporaryDirectory() as folder:
        header = laspy.LasHeader(version="1.4", point_format=6)
        header.scales = np.full(3, 1e-3)
        header.offsets = np.floor(xyz_m.min(axis=0))
        cloud = laspy.LasData(header)
        cloud.xyz = xyz_m
        number = np.arange(len(xyz_m))
        cloud.point_source_id = number & 0xFFFF
        cloud.intensity = number >> 16
        cloud.write(f"{folder}/sample.las")
        settings = CleanSettings(Cleaning(ground="smrf"), crs="EPSG:32632")
        furrowmap.clean([f"{folder}/sample.las"], f"{folder}/sample.copc.laz", settings)
        written = laspy.read(f"{folder}/sample.copc.laz")
    ground = np.zeros(len(xyz_m), bool)
    ground[(np.asarray(written.intensity, np.int64) << 16) + written.point_source_id] = written.classification == 2
    return ground


def main() -> None:
    """Print a table of the samples."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else SAMPLES
    samples = {path.name[4:6]: sample(path) for path in sorted(folder.glob("samp??.pcd.gz"))}
    if not samples:
        print(f"no samples in {folder}")
        return
    methods: dict[str, Callable[[FloatArray], BoolArray]] = {"furrowmap": by_command}
    os.environ.setdefault(
        "OMP_NUM_THREADS", "1"
    )  # its threads wait in loops: a hundred times as long on a busy machine
    try:
        import CSF  # noqa: F401
    except ImportError:
        print("the cloth simulation filter is not installed")
    else:
        methods["cloth, flat"] = lambda xyz_m: cloth(xyz_m, rigidness=3, smooth=False)
        methods["cloth, slopes"] = lambda xyz_m: cloth(xyz_m, rigidness=2, smooth=True)
    by_command(next(iter(samples.values()))[0])  # compile
    for name, method in methods.items():
        print(f"{name:14} {'kappa':>7} {'type I':>7} {'type II':>7} {'total':>7}  %")
        begin = time.perf_counter()
        figures = []
        for number, (xyz_m, truth) in samples.items():
            figures.append(agreement(truth, method(xyz_m)))
            print(f"  sample {number:5} " + " ".join(f"{value:7.1f}" for value in figures[-1]), flush=True)
        spent_s = time.perf_counter() - begin
        print(
            "  mean         " + " ".join(f"{value:7.1f}" for value in np.mean(figures, axis=0)) + f"  {spent_s:.0f} s"
        )


if __name__ == "__main__":
    main()
