"""The trajectory of a result in the formats of navigation software."""

from pathlib import Path
from typing import Final

import numpy as np
from pyproj import CRS, Geod, Proj, Transformer

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import RefusedError
from furrowmap.core.values.clock import WEEK_S, utc_to_gps_s
from furrowmap.core.values.rotation import attitude_to_quaternion
from furrowmap.core.values.session import ELLIPSOIDAL
from furrowmap.core.values.trajectory import SIGMA_NAMES
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.result_folder import TRAJECTORY, ResultFolder

SBET: Final = "sbet"
TRAJECTORIES: Final = {SBET: ".sbet", "tum": ".tum", "poses": ".csv"}
"""The suffix of the files of each format."""
_CSV_HEAD: Final = "time_unix_s,e_m,n_m,h_m,lon_deg,lat_deg,roll_deg,pitch_deg,heading_deg"


def write_trajectory(target: Path, to: str, result: ResultFolder) -> None:
    """Write the trajectory of a result in one of :data:`TRAJECTORIES`.

    `sbet`: 17 doubles a record with wander angle 0 and GPS seconds of the week of the first pose; accelerations and
    rates are 0. `tum`: time, position on the map, quaternion (x, y, z, w) from the vehicle's axes (forward, left, up)
    to the map's. `poses`: the columns that `[trajectory]` of a session reads. Raises RefusedError if the format needs
    ellipsoidal heights and the result has others.
    """
    heights = str(result.report["session"]["crs"]["heights"])
    if to == SBET and heights != ELLIPSOIDAL:
        raise RefusedError("sbet-heights", folder=result.folder, heights=heights)
    layer = result.layer(TRAJECTORY)
    layer = layer.where(np.argsort(layer.columns["t_s"], kind="stable"))
    crs = CRS(layer.crs)
    crs = crs.sub_crs_list[0] if crs.is_compound else crs
    t_s = layer.columns["t_s"]
    xyz_m = layer.coordinates
    attitude_deg = np.column_stack([layer.columns[f"{name}_deg"] for name in ("roll", "pitch", "heading")])
    to_degrees = Transformer.from_crs(crs, crs.geodetic_crs or crs, always_xy=True)
    lon_lat_deg = np.column_stack(to_degrees.transform(xyz_m[:, 0], xyz_m[:, 1])).astype(np.float64)
    with atomic_output(target) as unfinished:
        if to == SBET:
            geod = crs.get_geod()
            assert geod is not None
            gps_s = utc_to_gps_s(t_s)
            heading_deg = attitude_deg[:, 2] + Proj(crs).get_factors(*lon_lat_deg.T).meridian_convergence
            records = np.zeros((len(gps_s), 17), "<f8")
            records[:, 0] = gps_s - (gps_s[:1] // WEEK_S) * WEEK_S
            records[:, 1:3] = np.radians(lon_lat_deg[:, ::-1])
            records[:, 3] = xyz_m[:, 2]
            records[:, 4:7] = velocity_mps(t_s, lon_lat_deg, xyz_m[:, 2], geod)
            records[:, 7:9] = np.radians(attitude_deg[:, :2])
            records[:, 9] = np.radians((heading_deg + 180.0) % 360.0 - 180.0)
            unfinished.write_bytes(records.tobytes())
        elif to == "tum":
            quaternion = np.roll(attitude_to_quaternion(*attitude_deg.T), -1, axis=1)
            table = np.column_stack([t_s, xyz_m, quaternion])
            np.savetxt(unfinished, table, fmt="%.6f" + " %.5f" * 3 + " %.9f" * 4)
        else:
            sigmas = [f"sigma_{name}" for name in SIGMA_NAMES]
            columns = (layer.columns[name] for name in sigmas)
            table = np.column_stack([t_s, xyz_m, lon_lat_deg, attitude_deg, *columns])
            form = "%.6f" + ",%.5f" * 3 + ",%.10f" * 2 + ",%.6f" * 9
            head = ",".join([_CSV_HEAD, *sigmas])
            np.savetxt(unfinished, table, fmt=form, header=head, comments="", encoding="ascii")


def velocity_mps(t_s: FloatArray, lon_lat_deg: FloatArray, height_m: FloatArray, geod: Geod) -> FloatArray:
    """Velocity (n, 3) towards true north, east and down, by differences of positions (n, 2) in degrees."""
    if len(t_s) < 2:
        return np.zeros((len(t_s), 3))
    sine2 = np.sin(np.radians(lon_lat_deg[:, 1])) ** 2
    across = geod.a / np.sqrt(1.0 - geod.es * sine2)
    along = across * (1.0 - geod.es) / (1.0 - geod.es * sine2)
    lon, lat = (np.gradient(np.unwrap(np.radians(a)), t_s) for a in lon_lat_deg.T)
    east = (across + height_m) * np.cos(np.radians(lon_lat_deg[:, 1])) * lon
    return np.column_stack([(along + height_m) * lat, east, -np.gradient(height_m, t_s)])
