"""The GNSS receiver: its errors, and its sentences (NMEA 0183)."""

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.simulator.machine_motion import SimulatedMotion
from furrowmap.core.simulator.noise import FloatArray, gauss_markov, random_for
from furrowmap.core.simulator.scenario import Receiver, Scenario, Vector3
from furrowmap.core.simulator.site import SimulatedSite

FIXED_QUALITY: Final = 4
FLOAT: Final = 5
KNOT_MPS: Final = 1852.0 / 3600.0
_FLOAT_SIGMA_M: Final = (0.11, 0.14)
"""Increase of the reported horizontal and vertical standard deviations while float."""
_SPEED_SIGMA_MPS: Final = 0.010
_COURSE_FROM_MPS: Final = 0.10
"""Below this speed receivers leave the course empty."""


@dataclass(frozen=True)
class Fixes:
    """The positions of a receiver by epoch.

    Attributes:
        t_s: (n,) local time, at whole fractions of UTC seconds.
        enh_m: (n, 3) antenna with its errors, local.
        quality: (n,) 4 fixed, 5 float.
        sigma_m: (n, 2) horizontal a axis, and vertical.
    """

    t_s: FloatArray
    enh_m: FloatArray
    error_m: FloatArray
    velocity_mps: FloatArray
    quality: NDArray[np.int64]
    sigma_m: FloatArray


def receive(
    receiver: Receiver,
    antenna_m: Vector3,
    site: SimulatedSite,
    motion: SimulatedMotion,
    end_s: float,
    seed: int,
    name: str,
) -> Fixes:
    """The positions that `receiver` gives from t0 to `end_s`; `name` seeds its random numbers."""
    step_us = 1_000_000 // receiver.rate_hz
    first_us = -(-site.t0_us // step_us) * step_us - site.t0_us
    t_s = np.asarray(np.arange(first_us, math.floor(end_s * 1e6) + 1, step_us) * 1e-6, np.float64)
    n = len(t_s)
    true = motion.of_point(t_s, antenna_m)
    rng = random_for(seed, name)
    step_s = step_us * 1e-6
    columns = [
        gauss_markov(rng, n, step_s, receiver.gm_m, receiver.tau_s) + receiver.white_m * rng.standard_normal(n)
        for _ in range(2)
    ]
    height = gauss_markov(rng, n, step_s, receiver.gm_h_m, receiver.tau_h_s)
    columns.append(height + receiver.white_h_m * rng.standard_normal(n) + receiver.bias_h_m * rng.standard_normal())
    error = np.stack(columns, axis=-1)
    quality = np.full(n, FIXED_QUALITY)
    sigma = np.empty((n, 2))
    sigma[:] = (
        math.hypot(receiver.white_m, receiver.gm_m),
        math.hypot(receiver.white_h_m, receiver.gm_h_m, receiver.bias_h_m),
    )
    for begin_s, stop_s in receiver.float_s:
        now = (t_s >= begin_s) & (t_s < stop_s)
        quality[now] = FLOAT
        towards = rng.uniform(0.0, 2.0 * math.pi)
        off = receiver.float_error_m
        error[now] += (off * math.cos(towards), off * math.sin(towards), 0.5 * off * float(rng.standard_normal()))
        sigma[now] = np.hypot(sigma[now], _FLOAT_SIGMA_M)
    ahead, behind = (motion.of_point(np.clip(t_s + d, motion.t_s[0], motion.t_s[-1]), antenna_m) for d in (0.02, -0.02))
    velocity = (ahead - behind)[:, :2] / 0.04 + _SPEED_SIGMA_MPS * rng.standard_normal((n, 2))
    kept = np.ones(n, bool)
    for begin_s, stop_s in receiver.outage_s:
        kept &= (t_s < begin_s) | (t_s >= stop_s)
    enh = true + error
    return Fixes(t_s[kept], enh[kept], error[kept], velocity[kept], quality[kept], sigma[kept])


def sentences(fixes: Fixes, site: SimulatedSite, station: str) -> str:
    """GGA, RMC, GST and VTG of every epoch; `station` is that of the corrections."""
    lon, lat = site.geographic(fixes.enh_m[:, 0], fixes.enh_m[:, 1])
    course = _true_course(fixes.enh_m, fixes.velocity_mps, site)
    lines = []
    for i, t_s in enumerate(fixes.t_s):
        now = site.utc(float(t_s))
        time = f"{now:%H%M%S}.{now.microsecond // 10000:02d}"
        where = f"{degrees_minutes(float(lat[i]), 2, 8, 'NS')},{degrees_minutes(float(lon[i]), 3, 8, 'EW')}"
        fixed = fixes.quality[i] == FIXED_QUALITY
        used = 14 + round(2.0 * math.sin(0.05 * float(t_s))) if fixed else 10
        altitude = float(fixes.enh_m[i, 2]) + site.h0_m - site.geoid_m
        lines.append(
            f"GNGGA,{time},{where},{fixes.quality[i]},{used},{'0.8' if fixed else '1.4'},{altitude:.4f},M,"
            f"{site.geoid_m:.4f},M,{1.0 + 0.1 * (i % 10):.1f},{station}"
        )
        speed = float(np.hypot(*fixes.velocity_mps[i]))
        way = f"{course[i]:.2f}" if speed >= _COURSE_FROM_MPS else ""
        knots = speed / KNOT_MPS
        mode = "R" if fixed else "F"
        lines.append(f"GNRMC,{time},A,{where},{knots:.3f},{way},{now:%d%m%y},,,{mode},V")
        across, up = fixes.sigma_m[i]
        lines.append(f"GNGST,{time},{across:.3f},{across:.4f},{across:.4f},0.0,{across:.4f},{across:.4f},{up:.4f}")
        lines.append(f"GNVTG,{way},T,,M,{knots:.3f},N,{speed * 3.6:.3f},K,{mode}")
    return "".join(sentence(line) for line in lines)


def gprmc(motion: SimulatedMotion, antenna_m: Vector3, site: SimulatedSite, t_s: float, clock_offset_s: float) -> str:
    """The GPRMC of the receiver at the sensor, for the last full second of its clock."""
    whole_s = math.floor(site.t0_s + t_s + clock_offset_s) - site.t0_s - clock_offset_s
    around = np.clip(np.array([whole_s - 0.1, whole_s, whole_s + 0.1]), motion.t_s[0], motion.t_s[-1])
    enh = motion.of_point(around, antenna_m)
    velocity = (enh[2:] - enh[:1])[:, :2] / max(float(around[2] - around[0]), 1e-3)
    lon, lat = (float(a[0]) for a in site.geographic(enh[1:2, 0], enh[1:2, 1]))
    course = float(_true_course(enh[1:2], velocity, site)[0])
    now = site.utc(whole_s + clock_offset_s)
    return sentence(
        f"GPRMC,{now:%H%M%S},A,{degrees_minutes(lat, 2, 4, 'NS')},{degrees_minutes(lon, 3, 4, 'EW')},"
        f"{float(np.hypot(*velocity[0])) / KNOT_MPS:05.1f},{course:05.1f},{now:%d%m%y},,,D"
    )


def sentence(body: str) -> str:
    """`body` with its dollar sign, checksum and line end."""
    checksum = 0
    for byte in body.encode("ascii"):
        checksum ^= byte
    return f"${body}*{checksum:02X}\r\n"


def degrees_minutes(degrees: float, width: int, decimals: int, letters: str) -> str:
    """An angle in NMEA format: whole degrees of `width` digits, minutes, and the hemisphere."""
    unit = 10**decimals
    total = round(abs(degrees) * 60 * unit)
    whole, minutes = divmod(total, 60 * unit)
    return f"{whole:0{width}d}{minutes // unit:02d}.{minutes % unit:0{decimals}d},{letters[degrees < 0]}"


def report(fixes: Fixes) -> dict[str, Any]:
    """Its errors, for figures.json."""
    return {
        "epochs": len(fixes.t_s),
        "mean_error_m": [round(float(v), 4) for v in fixes.error_m.mean(axis=0)] if len(fixes.t_s) else [],
        "std_error_m": [round(float(v), 4) for v in fixes.error_m.std(axis=0)] if len(fixes.t_s) else [],
    }


def receivers(
    scenario: Scenario, site: SimulatedSite, motion: SimulatedMotion, end_s: float
) -> dict[str, tuple[Fixes, str]]:
    """The receivers of a scenario by file: positions, and station of the corrections."""
    return {
        name: (receive(receiver, scenario.antenna.xyz_m, site, motion, end_s, scenario.seed, name), station)
        for name, receiver, station in (
            ("gnss.nmea", scenario.gnss.clas, "0199"),
            ("reference.nmea", scenario.gnss.rtk, "0001"),
        )
    }


def _true_course(enh_m: FloatArray, velocity_mps: FloatArray, site: SimulatedSite) -> FloatArray:
    grid = np.degrees(np.arctan2(velocity_mps[:, 0], velocity_mps[:, 1]))
    course: FloatArray = (grid + site.convergence_deg(enh_m[:, 0], enh_m[:, 1])) % 360.0
    return np.where(course >= 359.995, 0.0, course)
