"""Random outages of GNSS and pauses of the scanner: stated sigmas of the poses against true errors.

A pass, and two with a turn between, are simulated once. Each seed takes positions and scans out of a copy, in one to
three outages and up to three pauses of half a second to fifteen, most of them near each other, and matches the rest. Of
every case the pose with the largest error over sigma is printed, and the notices. The figure of merit is the worst
ratio that no notice goes with.

A drive with an IMU of class consumer on wheels, without its scans, follows: three outages of 15 s of each seed.
"""

from __future__ import annotations

import argparse
import io
import shutil
import sys
import tempfile
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import dpkt
import numpy as np
import tomli_w
from numpy.typing import NDArray
from sessions import simulated
from trajectory_error import Poses, load_simulation

from furrowmap.core.matching.session_match import match_session
from furrowmap.core.runtime.errors import FurrowmapError
from furrowmap.core.session.opened import open_session
from furrowmap.core.trajectory.located import Companions, locate
from furrowmap.process import keep_kernels

FloatArray = NDArray[np.float64]
Span = tuple[float, float]

DRIVES: Final[dict[str, dict[str, object]]] = {
    "pass": {"seed": 11, "drive": {"passes": 1, "pass_m": [24.0], "wander_m": 0.05}},
    "turn": {"seed": 11, "drive": {"passes": 2, "pass_m": [14.0], "wander_m": 0.05}},
}
ON_WHEELS: Final[dict[str, object]] = {
    "seed": 12,
    "drive": {"passes": 5, "pass_m": [26.0]},
    "gnss": {"clas": {"rate_hz": 5}},
    "imu": {
        "kind": "consumer",
        "rate_hz": 100,
        "gyro_noise_deg_s_rthz": 0.01,
        "accel_noise_mg_rthz": 0.3,
        "gyro_bias_deg_s": 0.5,
        "accel_bias_mg": 30.0,
        "gyro_walk_deg_s_rts": 0.002,
        "accel_walk_mg_rts": 0.05,
    },
}
LONG_S: Final = 15.0
MOST_M: Final = 0.15
HELD: Final = (0.7, 1.5)
OUTAGES_S: Final = (0.6, 1.5, 3.0, 6.0, 12.0)
PAUSES_S: Final = (0.3, 0.8, 1.5, 4.0, 8.0)
LARGEST: Final = 5.0
QUANTITIES: Final = ("easting", "northing", "height", "heading")


@dataclass(frozen=True)
class Worst:
    """The pose of a case with the largest error over sigma.

    Attributes:
        ratio: error over sigma.
        quantity: one of QUANTITIES.
        error: in m or degrees.
        sigma: as stated.
        at_s: seconds since the first position of the whole recording.
    """

    ratio: float
    quantity: str
    error: float
    sigma: float
    at_s: float


def main() -> int:
    keep_kernels()
    options = _options()
    unnoticed = 0.0
    for name, keys in DRIVES.items():
        recording = simulated(f"outages_{name}", keys)
        for seed in range(options.first, options.first + options.count):
            outages, pauses = drawn(seed, load_simulation(recording).duration_s)
            said = f"{name} {seed:4}: outages {_listed(outages)}, pauses {_listed(pauses)}"
            try:
                worst, codes = case(recording, outages, pauses)
            except FurrowmapError as error:
                print(f"{said}: refused, {error.code}", flush=True)
                continue
            mark = "!" if worst.ratio > LARGEST else " "
            print(
                f"{said}: {worst.ratio:.1f} {mark} {worst.quantity} {worst.error:.2f} at {worst.sigma:.2f}, "
                f"{worst.at_s:.1f} s; {', '.join(codes) or 'no notices'}",
                flush=True,
            )
            unnoticed = max(unnoticed, worst.ratio * (not codes))
    print(f"\nworst without a notice: {unnoticed:.1f}")
    rms_m, ratio = on_wheels(simulated("outages_on_wheels", ON_WHEELS), range(options.first, options.first + 4))
    print(f"IMU on wheels, outages of {LONG_S:g} s: {rms_m:.3f} m RMS, error over sigma {ratio:.2f}")
    return int(unnoticed > LARGEST or rms_m > MOST_M or not HELD[0] < ratio < HELD[1])


def on_wheels(recording: Path, seeds: Sequence[int]) -> tuple[float, float]:
    """Horizontal error in outages of LONG_S by positions and IMU, and error over sigma, RMS over all seeds."""
    simulation, errors, ratios = load_simulation(recording), [], []
    for seed in seeds:
        first_s = np.random.default_rng(seed).uniform(15.0, 25.0)
        outages = [(begin_s, begin_s + LONG_S) for begin_s in np.arange(first_s, simulation.duration_s - 20.0, 35.0)]
        with tempfile.TemporaryDirectory(dir=recording.parent) as folder:
            copy = Path(folder) / "copy"
            shutil.copytree(recording, copy, ignore=shutil.ignore_patterns("truth", "*.pcap"))
            without_positions(next(copy.glob("*.nmea")), outages)
            keys = tomllib.loads((copy / "session.toml").read_text(encoding="utf-8"))
            keys = {name: keys[name] for name in ("furrowmap", "recording", "crs", "antenna", "imu")}
            del keys["recording"]["lidar"]
            keys["imu"]["on_wheels"] = True
            (copy / "session.toml").write_text(tomli_w.dumps(keys), encoding="utf-8")
            opened = open_session(copy / "session.toml")
            companions = Companions(opened.inertial)
            trajectory = locate(opened.positions(), opened.session, opened.frame, companions).trajectory
        since_s = trajectory.t_s - simulation.positions.t_s[0]
        inside = np.any([(since_s > begin_s) & (since_s < end_s) for begin_s, end_s in outages], axis=0)
        off_m = (trajectory.xyz_m - simulation.truth.at(trajectory.t_s).xyz_m)[inside, :2]
        errors.append(off_m)
        ratios.append(off_m / trajectory.sigma[inside, :2])
    horizontal = float(np.sqrt(2.0 * (np.concatenate(errors) ** 2).mean()))
    return horizontal, float(np.sqrt((np.concatenate(ratios) ** 2).mean()))


def drawn(seed: int, lasts_s: float) -> tuple[list[Span], list[Span]]:
    """Outages of the receiver, and pauses of the scanner, in seconds since the first of their records."""
    rng = np.random.default_rng(seed)

    def lasting(begin_s: float, lengths_s: Sequence[float]) -> Span:
        return begin_s, begin_s + float(rng.choice(lengths_s)) * rng.uniform(0.7, 1.3)

    outages = [lasting(rng.uniform(-1.0, lasts_s), OUTAGES_S) for _ in range(rng.integers(1, 4))]
    pauses = []
    for _ in range(rng.integers(0, 4)):
        near = outages[rng.integers(len(outages))] if rng.random() < 0.6 else (0.0, lasts_s)
        pauses.append(lasting(rng.uniform(near[0] - 1.0, near[1]), PAUSES_S))
    return outages, pauses


def case(recording: Path, outages: Sequence[Span], pauses: Sequence[Span]) -> tuple[Worst, list[str]]:
    """The worst pose of a recording without what lies in outages and pauses, and the codes of the notices."""
    with tempfile.TemporaryDirectory(dir=recording.parent) as folder:
        copy = Path(folder) / "copy"
        shutil.copytree(recording, copy, ignore=shutil.ignore_patterns("truth"))
        without_scans(next(copy.glob("*.pcap")), pauses)
        without_positions(next(copy.glob("*.nmea")), outages)
        opened = open_session(copy / "session.toml")
        located = locate(opened.positions(), opened.session, opened.frame)
        lidar = opened.lidar(float(np.mean(located.trajectory.span_s)))
        found = match_session(located, lidar, opened.session)
    trajectory, simulation = found.trajectory, load_simulation(recording)
    ours = Poses(trajectory.t_s, trajectory.xyz_m, np.column_stack(trajectory.attitude_deg()))
    true = simulation.truth.at(ours.t_s)
    turned = (ours.rph_deg[:, 2] - true.rph_deg[:, 2] + 180.0) % 360.0 - 180.0
    error = np.abs(np.column_stack([ours.xyz_m - true.xyz_m, turned]))
    error[(ours.t_s < simulation.truth.t_s[0]) | (ours.t_s > simulation.truth.t_s[-1])] = 0.0
    sigma = trajectory.sigma[:, [0, 1, 2, 5]]
    k, j = np.unravel_index(int(np.argmax(error / sigma)), error.shape)
    at_s = float(ours.t_s[k] - simulation.positions.t_s[0])
    worst = Worst(float(error[k, j] / sigma[k, j]), QUANTITIES[j], float(error[k, j]), float(sigma[k, j]), at_s)
    return worst, sorted({notice.code for notice in found.notices})


def without_scans(capture: Path, pauses: Sequence[Span]) -> None:
    """Take packets out of a capture."""
    records = list(dpkt.pcap.Reader(io.BytesIO(capture.read_bytes())))
    out = io.BytesIO()
    writer = dpkt.pcap.Writer(out)
    for t_s, packet in records:
        if not _within(float(t_s) - float(records[0][0]), pauses):
            writer.writepkt(packet, t_s)
    capture.write_bytes(out.getvalue())


def without_positions(log: Path, outages: Sequence[Span]) -> None:
    """Take sentences with a time out of an NMEA log."""
    kept, first_s = [], np.nan
    for sentence in log.read_bytes().splitlines(keepends=True):
        words = sentence.split(b",")
        if words[0].endswith((b"GGA", b"RMC", b"GST")):
            t_s = 3600.0 * int(words[1][:2]) + 60.0 * int(words[1][2:4]) + float(words[1][4:])
            first_s = t_s if np.isnan(first_s) else first_s
            if _within(t_s - first_s, outages):
                continue
        kept.append(sentence)
    log.write_bytes(b"".join(kept))


def _within(t_s: float, spans_s: Sequence[Span]) -> bool:
    return any(begin_s <= t_s < end_s for begin_s, end_s in spans_s)


def _listed(spans_s: Sequence[Span]) -> str:
    return " ".join(f"{begin_s:.1f}–{end_s:.1f}" for begin_s, end_s in spans_s) or "none"


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first seed (0)")
    parser.add_argument("--count", type=int, default=25, help="seeds of each drive (25)")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
