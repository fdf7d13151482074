"""Features of a run: planes, lines and plants in its finished cloud, as layers of its result."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from furrowmap.core.features.cloud_features import Found, density, with_features
from furrowmap.core.pointclouds.cleaning_steps import Cleaning
from furrowmap.core.pointclouds.clouds import box_in, open_clouds
from furrowmap.core.pointclouds.far_points import near_box
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.values.session import FeatureSearch
from furrowmap.exporters.vectors.field_layers import Layer
from furrowmap.workflows.clouds.features import found_layers, sparse_notices


@dataclass(frozen=True)
class RunFeatures:
    """Features found in the cloud of a run.

    Attributes:
        layers: for `field.gpkg`.
        account: parameters and figures, for JSON.
        notices: warnings.
    """

    layers: list[Layer]
    account: dict[str, Any]
    notices: tuple[Notice, ...]


def run_features(cloud: Path, stated: FeatureSearch, progress: Progress) -> RunFeatures:
    """Find the features of a run's finished cloud, with its ground and, from images, its colours.

    Args:
        cloud: of the run; its points keep their classes.
        stated: `[features]` of the session.
        progress: receives the stages.
    """
    clouds = open_clouds([cloud], None, None)
    box, far = box_in(clouds, None, None), tuple[Notice, ...]()
    if box is None:
        box, far = near_box(clouds, progress)
    spacing = density(clouds, box, progress)
    ground = stated.ground or ("class" if spacing.classified else "smrf")
    cell_m = stated.voxel_m or spacing.cell_m
    found = Found()
    cleaning = Cleaning(box, ground="none" if ground == "class" else ground)
    with closing(with_features(clouds, cleaning, cell_m, cloud.parent, found, progress=progress)) as points:
        for _ in points:
            pass
    layers, figures = found_layers(found)
    account = {"parameters": {"ground": ground, "voxel_m": cell_m}, "figures": figures}
    return RunFeatures(layers, account, (*far, *sparse_notices(spacing.cell_m)))
