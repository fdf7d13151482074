"""Layers of a GNSS evaluation: the track of each service and its errors."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
import shapely

from furrowmap.core.checking.evaluation import Evaluation
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.earth import earth_centred_m, east_north_up, geodetic
from furrowmap.core.values.gnss import Fix
from furrowmap.exporters.vectors.field_layers import Columns, Layer, geometry_array, texts, times


def gnss_layers(evaluations: Mapping[str, Evaluation]) -> list[Layer]:
    """The layers `gnss_errors` (a point for each compared epoch) and `gnss_tracks`, in geographic coordinates."""
    found = list(evaluations.values())
    error = np.concatenate([one.matched.error_m for one in found])
    labels = {int(fix): fix.label for fix in Fix}
    t_s = np.concatenate([one.matched.t_s for one in found])
    columns: Columns = {
        "service": texts([name for name, one in evaluations.items() for _ in range(len(one.matched))]),
        "time": times(t_s),
        "fix": texts([labels[code] for one in found for code in one.fix.tolist()]),
        "x_m": error[:, 0],
        "y_m": error[:, 1],
        "z_m": error[:, 2],
        "error_2d_m": np.hypot(error[:, 0], error[:, 1]),
        "error_3d_m": np.sqrt(np.sum(error**2, axis=1)),
        "outlier": np.concatenate([one.outlier for one in found]),
    }
    places = np.column_stack(
        [np.concatenate([one.lon_deg for one in found]), np.concatenate([one.lat_deg for one in found])]
    )
    text = "Errors of GNSS positions: test minus reference, X towards east, Y towards north, Z up"
    errors = Layer("gnss_errors", "Point", text, geometry_array(shapely.points(places)), columns)
    # A line for each service and, last, one for the reference under the service with the most epochs.
    most = max(evaluations.values(), key=lambda one: len(one.matched))
    lines = [_line(one, one.lon_deg, one.lat_deg) for one in evaluations.values()]
    lines.append(_line(most, *_reference(most)))
    known = [one.tables["all"] for one in evaluations.values()]
    columns = {
        "service": texts([*evaluations, "reference"]),
        "file": texts([*(one.test for one in evaluations.values()), most.reference]),
        "is_reference": np.append(np.zeros(len(evaluations), bool), True),
        "epochs": np.array([*(len(one.matched) for one in evaluations.values()), len(most.matched)], np.int32),
        "rmse_2d_m": np.array([*(table["2D"].rmse_m for table in known), np.nan]),
        "rmse_z_m": np.array([*(table["Z"].rmse_m for table in known), np.nan]),
    }
    words = "Tracks of GNSS services and of their reference"
    return [errors, Layer("gnss_tracks", "MultiLineString", words, geometry_array(lines), columns)]


def _line(found: Evaluation, lon_deg: FloatArray, lat_deg: FloatArray) -> shapely.MultiLineString:
    """The track without lines across gaps."""
    places = np.column_stack([lon_deg, lat_deg])
    parts = [places[a:b] for a, b in pairwise(found.matched.unbroken) if b - a > 1]
    return shapely.MultiLineString(parts)


def _reference(found: Evaluation) -> tuple[FloatArray, FloatArray]:
    """Longitudes and latitudes of the reference: those of the test without its horizontal errors."""
    error = found.matched.error_m.copy()
    error[:, 2] = 0.0
    axes = east_north_up(found.lon_deg, found.lat_deg)
    moved = np.einsum("nij,ni->nj", axes, error)
    lon, lat, _ = geodetic(earth_centred_m(found.lon_deg, found.lat_deg, np.zeros(len(error))) - moved)
    return lon, lat
