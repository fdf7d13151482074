"""A machine: where antenna, scanner, tool and further sensors sit on a vehicle, measured once for all its sessions."""

import datetime as dt
from typing import Annotated, Final

from msgspec import Meta

from furrowmap.core.values.session import MAX_IMPLEMENT_WIDTH_M, Antenna, Lidar, TomlTable, Vector3

MACHINE_SCHEMA: Final = 1
NOT_SHOWN_DEG: Final = 180.0
"""Standard deviation of an angle that a recording does not show."""


class MachineImu(TomlTable, frozen=True, rename={"kind": "class"}):
    """`[imu]`: place, axes and class (`kind`) of the IMU, as in a session."""

    xyz_m: Vector3
    rpy_deg: Vector3
    kind: str | None = None


class MachineCamera(TomlTable, frozen=True):
    """`[camera]`: place and direction of the camera, as in a session."""

    xyz_m: Vector3
    rpy_deg: Vector3


class MachineImplement(TomlTable, frozen=True):
    """`[implement]`: the implement, as in a session.

    Attributes:
        learned: the `implement.npz` of an earlier result: a file beside the profile.
        name: of one of several.
        moves_soil: of several, the one whose passes change the soil; default: the rearmost.
    """

    width_m: Annotated[float, Meta(gt=0.0, le=MAX_IMPLEMENT_WIDTH_M)]
    xy_m: tuple[float, float]
    kind: str = ""
    working_depth_m: float | None = None
    lift_m: Annotated[float, Meta(ge=0.1, le=1.2)] | None = None
    learned: str | None = None
    name: str = ""
    moves_soil: bool = False


class MachineRecord(TomlTable, frozen=True):
    """`[record]`: what `furrowmap record` records on this machine.

    Attributes:
        ports: UDP ports that the scanner sends to; by default the usual ones of all makers.
        gnss: sources of GNSS receivers, such as "/dev/ttyACM0:115200" or "tcp://192.168.1.30:5017".
    """

    ports: tuple[int, ...] = ()
    gnss: tuple[str, ...] = ()


class Calibrated(TomlTable, frozen=True):
    """`[calibrated]`: where the angles of the scanner are from, if a recording showed them.

    Attributes:
        date: UTC day of the recording.
        rpy_sigma_deg: standard deviations about the vehicle's axes; NOT_SHOWN_DEG for an angle that was not shown.
    """

    date: dt.date
    rpy_sigma_deg: Vector3
    session: str = ""


class Machine(TomlTable, frozen=True):
    """The content of a machine's profile.

    Attributes:
        antenna, lidar, imu, camera, implement: as in a session; None for none, or not measured.
        calibrated: where the angles in `lidar` are from; None where they were measured.
        further_implements: the others of several `[[implement]]`.
        record: what is recorded on it; None where that is not stated.
        further_lidars: the others of several `[[lidar]]`.
    """

    furrowmap_machine: int = MACHINE_SCHEMA
    name: str = ""
    antenna: Antenna | None = None
    lidar: Lidar | None = None
    imu: MachineImu | None = None
    camera: MachineCamera | None = None
    implement: MachineImplement | None = None
    calibrated: Calibrated | None = None
    further_implements: tuple[MachineImplement, ...] = ()
    record: MachineRecord | None = None
    further_lidars: tuple[Lidar, ...] = ()

    @property
    def implements(self) -> tuple[MachineImplement, ...]:
        """All implements, the one that moves soil first."""
        return (self.implement, *self.further_implements) if self.implement is not None else ()
