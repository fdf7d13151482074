"""The layer of control points: a point each, with its state and residuals."""

from typing import Final

import numpy as np
import shapely

from furrowmap.core.pipeline.control.control_points import ControlResult
from furrowmap.exporters.vectors.field_layers import Columns, Layer, geometry_array, numbers, texts

CONTROL_LAYER: Final = "control_points"


def control_layer(control: ControlResult) -> Layer:
    """A feature per point, where it was surveyed; residuals are cloud less survey."""
    points = control.points
    columns: Columns = {
        "name": texts(point.name for point in points),
        "target": texts(point.target.kind.value for point in points),
        "state": texts(point.state.value for point in points),
        "why_not": texts(point.why_not.value or None for point in points),
        "visits": np.array([point.visits for point in points], np.int64),
    }
    for k, axis in enumerate("enh"):
        columns[f"before_{axis}_m"] = numbers(point.before_m[k] for point in points)
        columns[f"residual_{axis}_m"] = numbers(point.residual_m[k] for point in points)
        columns[f"sigma_{axis}_m"] = numbers(point.sigma_m[k] for point in points)
        columns[f"normalised_{axis}"] = numbers(point.normalised[k] for point in points)
    shapes = geometry_array([shapely.Point(point.surveyed_m) for point in points])
    return Layer(
        CONTROL_LAYER, "2.5D Point", "Control points and points to check, and the cloud there", shapes, columns
    )
