"""The frames of a session as a tree, as REP-103 and REP-105 name and order them."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.session import Session

EARTH: Final = "earth"
MAP: Final = "map"
BASE: Final = "base_link"
"""Names of REP-105; base_link is the vehicle frame."""
_DIRECTIONS: Final = {
    "forward": (1.0, 0.0, 0.0),
    "backward": (-1.0, 0.0, 0.0),
    "left": (0.0, 1.0, 0.0),
    "right": (0.0, -1.0, 0.0),
    "up": (0.0, 0.0, 1.0),
    "down": (0.0, 0.0, -1.0),
}
"""Directions in the vehicle frame."""
EXACT_DEG: Final = 0.05


@dataclass(frozen=True)
class Frame:
    """A coordinate frame, and how it lies in the one above it.

    Attributes:
        parent: name of the frame above; "" for the first.
        pose: of its origin and axes in the parent; None where it changes with time, or is no rigid motion.
        has_axes: whether it has axes; an antenna is a point.
    """

    name: str
    parent: str
    pose: Mounting | None
    words: str
    has_axes: bool = True


@dataclass(frozen=True)
class FrameTree:
    """The frames of a session, each after its parent."""

    frames: tuple[Frame, ...]

    def __getitem__(self, name: str) -> Frame:
        """The frame of a name. Raises KeyError if there is none."""
        found = next((frame for frame in self.frames if frame.name == name), None)
        if found is None:
            raise KeyError(f"no frame {name!r}; there are {', '.join(frame.name for frame in self.frames)}")
        return found

    def between(self, source: str, target: str) -> Mounting:
        """Axes of one frame in another. Raises KeyError without such a frame, ValueError if one between moves."""
        relative = np.linalg.inv(self._in_root(target)) @ self._in_root(source)
        x, y, z = relative[:3, 3].tolist()
        return Mounting.from_rotation((x, y, z), relative[:3, :3])

    def _in_root(self, name: str) -> FloatArray:
        """(4, 4) from a frame to the vehicle frame."""
        whole = np.eye(4)
        frame = self[name]
        while frame.name != BASE:
            if frame.pose is None:
                raise ValueError(f"{frame.name} moves against {BASE}, or lies above it: a transform needs a time")
            step = np.eye(4)
            step[:3, :3] = frame.pose.rotation
            step[:3, 3] = frame.pose.xyz_m
            whole = step @ whole
            frame = self[frame.parent]
        return whole

    @property
    def text(self) -> str:
        """The tree with translations and rotations, a line for each frame."""
        return "\n".join(self._lines("", ""))

    def plain(self) -> dict[str, Any]:
        """For JSON: each frame with its parent, translation, angles and quaternion (x, y, z, w, as in ROS)."""
        out = []
        for frame in self.frames:
            pose = frame.pose
            turned = frame.pose if frame.has_axes else None
            out.append(
                {
                    "name": frame.name,
                    "parent": frame.parent or None,
                    "description": frame.words,
                    "xyz_m": list(pose.xyz_m) if pose else None,
                    "rpy_deg": list(turned.rpy_deg) if turned else None,
                    "quaternion_xyzw": Rotation.from_matrix(turned.rotation).as_quat().tolist() if turned else None,
                }
            )
        return {"frames": out}

    def _lines(self, parent: str, before: str) -> list[str]:
        children = [frame for frame in self.frames if frame.parent == parent]
        lines = []
        for k, frame in enumerate(children):
            is_last = k == len(children) - 1
            joint, below = ("", "") if not parent else ("└─ ", "   ") if is_last else ("├─ ", "│  ")
            lines.append(f"{before}{joint}{frame.name}: {'; '.join(filter(None, (frame.words, pose_words(frame))))}")
            lines += self._lines(frame.name, before + below)
        return lines


def frame_tree(session: Session, frame: MapFrame) -> FrameTree:
    """The frames of a session."""
    source = (
        "[trajectory]"
        if session.trajectory is not None
        else "positions"
        + (" and IMU" if session.imu is not None else " and attitude logs" if session.attitude is not None else "")
    )
    place = "the middle of the rear axle, on the ground" if session.implement is not None else "the vehicle's origin"
    frames = [
        Frame(EARTH, "", None, "longitude, latitude and ellipsoidal height of the positions"),
        Frame(MAP, EARTH, None, f"{frame.name}, {frame.heights.name} heights; x east, y north, z up"),
        Frame(BASE, MAP, None, f"{place}; x forward, y left, z up; moves as {source} show"),
    ]
    if session.trajectory is None:
        stated = session.antenna is not None
        place_m = session.antenna.xyz_m if session.antenna is not None else (0.0, 0.0, 0.0)
        words = "phase centre of the GNSS antenna" + ("" if stated else ", not stated")
        frames.append(Frame("gnss_link", BASE, Mounting(place_m), words, has_axes=False))
    if session.imu is not None:
        pose = Mounting(session.imu.xyz_m, session.imu.rpy_deg)
        frames.append(Frame("imu_link", BASE, pose, f"IMU ({session.imu.kind})"))
    if session.attitude is not None:
        devices = {"ahrs_link": session.attitude.roll_pitch_rpy_deg, "compass_link": session.attitude.heading_rpy_deg}
        purpose = {"ahrs_link": "device of roll and pitch", "compass_link": "device of the heading"}
        frames += [Frame(name, BASE, Mounting(rpy_deg=rpy), purpose[name]) for name, rpy in devices.items()]
    if session.recording.lidar:
        model = f" ({session.lidar.model})" if session.lidar.model else ""
        frames.append(Frame("lidar_link", BASE, session.lidar.mounting, f"scanner{model}"))
    if session.camera is not None:
        words = "camera: x right in the image, y down, z along the view"
        frames.append(Frame("camera_optical_frame", BASE, session.camera.mounting, words))
    if session.implement is not None:
        x, y = session.implement.xy_m
        words = f"middle of the working line, {session.implement.width_m:g} m wide"
        frames.append(Frame("implement_link", BASE, Mounting((x, y, 0.0)), words, has_axes=False))
    return FrameTree(tuple(frames))


def pose_words(frame: Frame) -> str:
    """Translation, angles and directions of the axes of a frame; empty where it has none."""
    if frame.pose is None:
        return ""
    place = f"xyz {_numbers(frame.pose.xyz_m, 3)} m"
    if not frame.has_axes:
        return place
    axes = ", ".join(f"{axis} {direction_words(frame.pose.rotation[:, k])}" for k, axis in enumerate("xyz"))
    return f"{place}, rpy {_numbers(frame.pose.rpy_deg, 2)}° ({axes})"


def direction_words(direction: FloatArray) -> str:
    """A direction (3,) in the vehicle frame in words, such as "down" or "34° from down towards forward"."""
    shares = {name: float(direction @ np.array(axis)) for name, axis in _DIRECTIONS.items()}
    first, second = sorted(shares, key=lambda name: -shares[name])[:2]
    off_deg = float(np.degrees(np.arccos(np.clip(shares[first], -1.0, 1.0))))
    return first if off_deg < EXACT_DEG else f"{off_deg:.1f}° from {first} towards {second}"


def _numbers(values: tuple[float, float, float], digits: int) -> str:
    return " ".join(f"{value + 0.0:.{digits}f}" for value in values)
