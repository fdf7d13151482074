"""The trajectory of a result in the formats of navigation software."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS, Geod, Proj, Transformer

from furrowmap.core.runtime.errors import RefusedError
from furrowmap.core.values.clock import WEEK_S, utc_to_gps_s
from furrowmap.core.values.rotation import attitude_to_quaternion
from furrowmap.core.values.session import ELLIPSOIDAL
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.result_folder import TRAJECTORY, ResultFolder

if TYPE_CHECKING:
    import geopandas as gpd

FloatArray = NDArray[np.float64]

SIGMAS: Final = ("sigma_e_m", "sigma_n_m", "sigma_h_m", "sigma_roll_deg", "sigma_pitch_deg", "sigma_heading_deg")
_HEAD: Final = "time_unix_s,e_m,n_m,h_m,lon_deg,lat_deg,roll_deg,pitch_deg,heading_deg"


@dataclass(frozen=True)
class _Poses:
    """The poses of a result.

    Attributes:
        t_s: (n,) UTC.
        xyz_m: (n, 3) in the map frame.
        lon_lat_deg: (n, 2) in the map's own datum.
        convergence_deg: (n,) true heading − grid heading.
        attitude_deg: (n, 3) roll, pitch, grid heading.
        sigma: (n, 6) in the order of :data:`SIGMAS`.
        geod: the ellipsoid.
    """

    t_s: FloatArray
    xyz_m: FloatArray
    lon_lat_deg: FloatArray
    convergence_deg: FloatArray
    attitude_deg: FloatArray
    sigma: FloatArray
    geod: Geod

    @classmethod
    def of(cls, layer: gpd.GeoDataFrame) -> _Poses:
        whole = CRS(layer.crs)
        crs = whole.sub_crs_list[0] if whole.is_compound else whole
        layer = layer.sort_values("t_s")
        xyz = np.column_stack([layer.geometry.x, layer.geometry.y, layer.geometry.z]).astype(np.float64)
        to_degrees = Transformer.from_crs(crs, crs.geodetic_crs or crs, always_xy=True)
        lon, lat = (np.asarray(a, np.float64) for a in to_degrees.transform(xyz[:, 0], xyz[:, 1]))
        convergence = np.asarray(Proj(crs).get_factors(lon, lat).meridian_convergence, np.float64)
        geod = crs.get_geod()
        assert geod is not None
        return cls(
            layer["t_s"].to_numpy(np.float64),
            xyz,
            np.column_stack([lon, lat]),
            convergence,
            layer[["roll_deg", "pitch_deg", "heading_deg"]].to_numpy(np.float64),
            layer[list(SIGMAS)].to_numpy(np.float64),
            geod,
        )

    @property
    def velocity_mps(self) -> FloatArray:
        """(n, 3) towards true north, east and down, by differences of positions."""
        sine2 = np.sin(np.radians(self.lon_lat_deg[:, 1])) ** 2
        across = self.geod.a / np.sqrt(1.0 - self.geod.es * sine2)
        along = across * (1.0 - self.geod.es) / (1.0 - self.geod.es * sine2)
        if len(self.t_s) < 2:
            return np.zeros((len(self.t_s), 3))
        height = self.xyz_m[:, 2]
        lon, lat = (np.gradient(np.unwrap(np.radians(a)), self.t_s) for a in self.lon_lat_deg.T)
        east = (across + height) * np.cos(np.radians(self.lon_lat_deg[:, 1])) * lon
        return np.column_stack([(along + height) * lat, east, -np.gradient(height, self.t_s)])


def write_trajectory(target: Path, to: str, result: ResultFolder) -> None:
    """Write the trajectory of a result in one of :data:`TRAJECTORIES`.

    Raises:
        InputError: if the result has no trajectory.
        RefusedError: if the format needs ellipsoidal heights and the result has others.
        OSError: if the file cannot be written.
    """
    heights = str(result.report["session"]["crs"]["heights"])
    if to == SBET and heights != ELLIPSOIDAL:
        raise RefusedError("sbet-heights", folder=result.folder, heights=heights)
    poses = _Poses.of(result.layer(TRAJECTORY))
    with atomic_output(target) as unfinished:
        TRAJECTORIES[to](unfinished, poses)


def _write_sbet(path: Path, poses: _Poses) -> None:
    """17 doubles a record: wander angle 0, GPS seconds of the week of the first pose; accelerations and rates are 0."""
    gps = utc_to_gps_s(poses.t_s)
    records = np.zeros((len(gps), 17), "<f8")
    records[:, 0] = gps - (gps[:1] // WEEK_S) * WEEK_S
    records[:, 1:3] = np.radians(poses.lon_lat_deg[:, ::-1])
    records[:, 3] = poses.xyz_m[:, 2]
    records[:, 4:7] = poses.velocity_mps
    heading = poses.attitude_deg[:, 2] + poses.convergence_deg
    records[:, 7:9] = np.radians(poses.attitude_deg[:, :2])
    records[:, 9] = np.radians((heading + 180.0) % 360.0 - 180.0)
    path.write_bytes(records.tobytes())


def _write_tum(path: Path, poses: _Poses) -> None:
    """Time, position on the map, quaternion (x, y, z, w) from the vehicle's axes (forward, left, up) to the map's."""
    quaternion = attitude_to_quaternion(*poses.attitude_deg.T)
    table = np.column_stack([poses.t_s, poses.xyz_m, quaternion[:, 1:], quaternion[:, 0]])
    np.savetxt(path, table, fmt="%.6f" + " %.5f" * 3 + " %.9f" * 4)


def _write_csv(path: Path, poses: _Poses) -> None:
    """The columns that `[trajectory]` of a session reads."""
    table = np.column_stack([poses.t_s, poses.xyz_m, poses.lon_lat_deg, poses.attitude_deg, poses.sigma])
    form = "%.6f" + ",%.5f" * 3 + ",%.10f" * 2 + ",%.6f" * 9
    np.savetxt(path, table, fmt=form, header=f"{_HEAD},{','.join(SIGMAS)}", comments="", encoding="ascii")


SBET: Final = "sbet"
TRAJECTORIES: Final[dict[str, Callable[[Path, _Poses], None]]] = {
    SBET: _write_sbet,
    "tum": _write_tum,
    "poses": _write_csv,
}
"""What writes each format."""
SUFFIXES: Final = {SBET: ".sbet", "tum": ".tum", "poses": ".csv"}
"""Of their files."""
