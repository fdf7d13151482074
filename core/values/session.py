"""The session: what a user states about a recording, in `session.toml`."""

from __future__ import annotations

from typing import Final

import msgspec

from furrowmap.core.values.mounting import Mounting

SCHEMA: Final = 1

REPLACE: Final = "replace"
CHECK: Final = "check"
"""What states from elsewhere are for: they take the place of those that the scans show, or are compared with them."""

AS_RECORDED: Final = "as-recorded"
CURRENT_EPOCH: Final = "current-epoch"
"""What a session may say of its coordinates, besides a frame and epoch."""
ELLIPSOIDAL: Final = "ellipsoidal"
"""What heights are counted from where a session names no geoid."""

Vector3 = tuple[float, float, float]


class _Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of the session file: frozen, and strict about its keys."""


class Recording(_Part, frozen=True):
    """`[recording]`: the files, and how their clocks relate.

    Attributes:
        lidar: files of the laser scanner, in the order of time.
        gnss: files of the GNSS receiver, in the order of time.
        lidar_minus_gnss_s: lidar clock minus GNSS clock, where the clocks differ by a constant.
        date: UTC date (YYYY-MM-DD) of the first position of a log whose sentences carry none.
        task: id or name of the task that is meant, where task data hold several.
    """

    lidar: tuple[str, ...] = ()
    gnss: tuple[str, ...] = ()
    lidar_minus_gnss_s: float = 0.0
    date: str | None = None
    task: str | None = None


class Crs(_Part, frozen=True):
    """`[crs]`: the map frame.

    Attributes:
        map: a projected CRS in metres, in any form that pyproj reads.
        heights: "ellipsoidal", or a geoid model by name.
        coordinates: "as-recorded", "current-epoch", or a frame and epoch such as "itrf2020@2026.4".
        parameters: official parameter file that leads from the current epoch to the map's.
        geoid_grid: file of the geoid's grid, for models that PROJ has no grid of.
    """

    map: str
    heights: str = ELLIPSOIDAL
    coordinates: str = AS_RECORDED
    parameters: str | None = None
    geoid_grid: str | None = None


class Antenna(_Part, frozen=True):
    """`[antenna]`: the GNSS antenna's phase centre in the vehicle frame."""

    xyz_m: Vector3


class Lidar(_Part, frozen=True):
    """`[lidar]`: the laser scanner, and how it is mounted.

    Attributes:
        model: such as "VLP-16"; wins over what the packets say.
        xyz_m: the sensor's origin in the vehicle frame.
        rpy_deg: roll, pitch, yaw of the sensor in the vehicle frame.
    """

    xyz_m: Vector3 = (0.0, 0.0, 0.0)
    rpy_deg: Vector3 = (0.0, 0.0, 0.0)
    model: str | None = None

    @property
    def mounting(self) -> Mounting:
        """The extrinsic of the scanner."""
        return Mounting(self.xyz_m, self.rpy_deg)


class Implement(_Part, frozen=True):
    """`[implement]`: the tool.

    Attributes:
        width_m: working width.
        xy_m: middle of the tool's line in the vehicle frame.
        kind: in the user's words.
        working_depth_m: how deep it works.
        lift_m: how far it is lifted, for a scanner that does not see it at work.
        region_m: from, to along x, from, to along y of the vehicle frame: where the scanner sees it.
        learned: `implement.npz` of an earlier session of the same machine.
        states: files that say when it worked: tables of times, or task data.
        states_use: "replace" what the scans show, or "check" it.
        states_minus_gnss_s: their clock minus that of the positions, where the two differ by a constant.
    """

    width_m: float
    xy_m: tuple[float, float]
    kind: str = ""
    working_depth_m: float | None = None
    lift_m: float | None = None
    region_m: tuple[float, float, float, float] | None = None
    learned: str | None = None
    states: tuple[str, ...] = ()
    states_use: str = REPLACE
    states_minus_gnss_s: float = 0.0


class Field(_Part, frozen=True):
    """`[field]`: the parcel's boundary, a vector file."""

    boundary: str | None = None


class TrajectorySource(_Part, frozen=True):
    """`[trajectory]`: a trajectory from elsewhere, which replaces GNSS and matching.

    Attributes:
        files: CSV or SBET files, in the order of time.
        time: "utc" or "gps" where the file itself does not say.
        week: GPS week of a file whose times are seconds of the week.
    """

    files: tuple[str, ...]
    time: str | None = None
    week: int | None = None


class Run(_Part, frozen=True):
    """`[run]`: choices of the work itself.

    Attributes:
        standing: whether scans taken at a stand are kept in the cloud.
        fixes: the GNSS qualities whose positions are used ("fixed", "float", "dgps", "single", ...); without it fixed
            and float where there is any fixed position, else all.
        threads: how many the work may use; `--threads` on the command line wins.
    """

    standing: bool = True
    fixes: tuple[str, ...] | None = None
    threads: int | None = None


class Session(_Part, frozen=True):
    """What a user states about one recording.

    Attributes:
        furrowmap: version of this schema.
        name: of the session.
        recording, crs, antenna, lidar, implement, field, trajectory, run: the tables.
    """

    furrowmap: int
    recording: Recording
    crs: Crs
    name: str = ""
    antenna: Antenna | None = None
    lidar: Lidar = Lidar()
    implement: Implement | None = None
    field: Field = Field()
    trajectory: TrajectorySource | None = None
    run: Run = Run()
