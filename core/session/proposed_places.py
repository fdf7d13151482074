"""Places of sensors and tool in a proposed session: from the machine's profile, or as comments to fill in."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from furrowmap.core.runtime.errors import Notice, printable
from furrowmap.core.session.flight import LOOKS, FlownMounting
from furrowmap.core.session.machine import stated, toml_value
from furrowmap.core.values.machine import NOT_SHOWN_DEG, Machine
from furrowmap.core.values.margins import margin

_ON_WHEELS: Final = "on the ground below the middle of the rear axle"
_MOUNTING: Final = """\
# Mounting of the scanner in the vehicle frame: origin {}; x forward,
# y left, z up; metres and degrees. R = Rz(yaw) Ry(pitch) Rx(roll) rotates sensor coordinates to the vehicle frame.
# Measure it, and remove the hash signs.
# xyz_m = [-0.55, 0.0, 2.35]
# rpy_deg = [0.0, 40.0, 180.0]
"""
_IMU: Final = """\
# Place of the IMU in the vehicle frame, roll, pitch, yaw of its axes there, and its model or class ("consumer",
# "industrial", "tactical"). Measure them, and remove the hash signs.
# xyz_m = [-0.04, -0.01, -0.29]
# rpy_deg = [180.0, 0.0, 0.0]
# class = "industrial"
"""
_ANTENNA: Final = """\
# Lever arm: phase centre of the GNSS antenna in the vehicle frame. Measure it, and remove the hash signs.
# [antenna]
# xyz_m = [1.85, 0.0, 1.62]
"""
_IMPLEMENT: Final = """\
# Working width of the implement, and the middle of its working line in the vehicle frame; needed for worked ground.
# [implement]
# kind = "rotary tiller"
# width_m = 1.70
# xy_m = [-1.45, 0.0]
# working_depth_m = 0.12
"""
_ANTENNA_IS_ORIGIN: Final = """\
# The origin of the vehicle frame may be any point; here it is the phase centre of the GNSS antenna. x points forward,
# y left, z up; metres and degrees.
[antenna]
xyz_m = [0.0, 0.0, 0.0]
"""
_FROM_ANTENNA: Final = """\
# Place of the {}, seen from the antenna: forward, left, up. Measure how far it is below (a negative number), replace
# the zeros where it is not straight below, and remove the hash sign.
# xyz_m = [0.0, 0.0, FILL-IN]
"""
_FLOWN_LIDAR: Final = """\
# Roll, pitch, yaw of its axes in the vehicle frame, R = Rz(yaw) Ry(pitch) Rx(roll), so that the ground below is level:
# for a {} axis that points forward, or else left, backward or right. A run refines them where strips overlap.
"""
_FLOWN_IMU: Final = """\
rpy_deg = {}   # by gravity, with its x axis forward
# class = "industrial"   # or "consumer", "tactical", or its model
"""


def antenna_table(machine: Machine, *, flies: bool) -> str:
    """The table of the antenna."""
    if machine.antenna is None:
        return _ANTENNA_IS_ORIGIN if flies else _ANTENNA
    head = "# Lever arm: phase centre of the GNSS antenna in the vehicle frame.\n[antenna]\n"
    return head + _lines(machine.antenna, "xyz_m")


def lidar_lines(machine: Machine, flight: FlownMounting | None, *, flies: bool) -> str:
    """The place of the scanner in its table."""
    if machine.lidar is None:
        mounting = _MOUNTING.format("in the antenna" if flies else _ON_WHEELS)
        return mounting if flight is None else _flown_lidar_lines(flight)
    text = "# Mounting of the scanner in the vehicle frame.\n" + _lines(machine.lidar, "xyz_m", "rpy_deg")
    if machine.calibrated is None:
        return text
    known = machine.calibrated.rpy_sigma_deg
    sigma = ", ".join("not shown" if value >= NOT_SHOWN_DEG else margin(value) for value in known)
    return f"{text}# Angles calibrated with the recording of {machine.calibrated.date}: {sigma} degrees (95 %).\n"


def _flown_lidar_lines(flight: FlownMounting) -> str:
    angles = [f"rpy_deg = {toml_value(flight.lidar_rpy_deg(look))}   # {look}" for look in LOOKS]
    words = _FROM_ANTENNA.format("scanner") + _FLOWN_LIDAR.format(flight.looking_axis)
    return words + "\n# ".join(angles) + "\n"


def imu_lines(machine: Machine, flight: FlownMounting | None) -> str:
    """The place of the IMU in its table."""
    if machine.imu is not None:
        return _lines(machine.imu, "xyz_m", "rpy_deg", "kind")
    if flight is None:
        return _IMU
    return _FROM_ANTENNA.format("IMU") + _FLOWN_IMU.format(toml_value(flight.imu_rpy_deg))


def implement_table(machine: Machine, more: str = "") -> str:
    """The table of the implement, or those of several; `more` are further lines for the one that moves soil."""
    if machine.implement is None:
        return _IMPLEMENT
    head = "# Working width of the implement, and the middle of its working line in the vehicle frame.\n"
    header = "[[implement]]\n" if machine.further_implements else "[implement]\n"
    keys = ("name", "kind", "width_m", "xy_m", "working_depth_m", "lift_m", "learned", "moves_soil")
    tables = [header + _lines(tool, *keys) for tool in machine.implements]
    return head + "\n".join([tables[0] + more, *tables[1:]])


def camera_comment(machine: Machine) -> Sequence[str]:
    """The place of the camera, as a comment: the machine does not tell whether it took images."""
    if machine.camera is None:
        return []
    lines = _lines(machine.camera, "xyz_m", "rpy_deg").splitlines()
    return ["\n".join(["# [camera]", '# files = ["images/*.jpg"]', *(f"# {line}" for line in lines), ""])]


def head_words(machine: Machine) -> str:
    """A comment that names the machine."""
    return f"# Places of sensors and tool: machine {printable(machine.name)}.\n" if machine.name else ""


def places_missing(
    machine: Machine,
    flight: FlownMounting | None,
    *,
    scans: bool,
    states: bool,
    poses: bool,
    inertial: bool,
    flies: bool,
) -> Sequence[Notice]:
    """Places that neither the recordings nor the machine's profile show.

    Args:
        flight: what the recordings show of the mounting.
        scans: whether a scanner, or a flight, was recorded.
        flies: whether the vehicle flies: it has no implement, and its antenna is the origin.
    """
    mounted = machine.lidar is not None and None not in (machine.lidar.xyz_m, machine.lidar.rpy_deg)
    place = ".place" if flight is not None else ""
    found = []
    if (scans or not states) and not mounted:
        found.append(Notice(f"no-mounting{place}"))
    if not poses and machine.antenna is None and not flies:
        found.append(Notice("no-antenna.missing"))
    if machine.implement is None and not flies:
        found.append(Notice("no-implement.place" if states else "no-implement.missing"))
    return [*found, Notice(f"no-imu-mounting{place}")] if inertial and machine.imu is None else found


def _lines(part: Any, *names: str) -> str:
    """The values of a part that are known, a line each; the IMU's kind is called class."""
    known = {
        "class" if name == "kind" and not hasattr(part, "width_m") else name: getattr(part, name) for name in names
    }
    return "".join(f"{key} = {toml_value(value)}\n" for key, value in known.items() if stated(value))
