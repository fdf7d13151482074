"""Features of clouds: ground, planes, lines and plants by shape and colour."""

from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from furrowmap.core.features.classes import Feature
from furrowmap.core.features.cloud_features import VOXEL_RANGE_M, FoundFeatures, classify_features, measure_density
from furrowmap.core.features.objects import join_planes
from furrowmap.core.pointclouds.cleaning_steps import Cleaning
from furrowmap.core.readers.las.cloud import Survey
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.surfaces.ground_filter import require_cloth
from furrowmap.core.values.crs import name_of
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.result_folder import CLOUD, FEATURE_PRODUCTS, FEATURES, FEATURES_REPORT, refuse_occupied
from furrowmap.exporters.files.staging import staged_folder
from furrowmap.exporters.vectors.feature_layers import feature_layers, write_features
from furrowmap.exporters.vectors.field_layers import Layer
from furrowmap.settings import FeatureSettings
from furrowmap.workflows.clouds.clean import write_records
from furrowmap.workflows.clouds.inputs import box_to_use, input_records, open_inputs, write_account


def features(
    clouds: Sequence[str | Path],
    out: str | Path,
    settings: FeatureSettings = FeatureSettings(),
    *,
    overwrite: bool = False,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Classify clouds into ground, horizontal and vertical planes, lines and plants, and write these as layers.

    Args:
        clouds: LAS, LAZ or COPC files, which are used together.
        out: folder for the products, made if it does not exist; all of them are written or none.

    Returns:
        The content of `features.json`: inputs, CRS, parameters, figures, warnings, names of the products.

    Raises:
        InputError: if a cloud cannot be read, the CRS do not fit together, or no point is left.
        RefusedError: if the folder holds features, or the result of a run.
    """
    folder = Path(out)
    refuse_occupied(folder, FEATURE_PRODUCTS, CLOUD, overwrite=overwrite)
    if settings.ground == "csf":
        require_cloth()
    opened = open_inputs(clouds, settings)
    with staged_folder(folder) as staging:
        box, far = box_to_use(opened, settings.box, settings.box_crs, progress)
        fitting_m, classified = measure_density(opened, box, progress)
        method = settings.ground
        if method == "auto":
            method = "class" if classified else "smrf"
        if method == "class" and not classified:
            raise InputError("no-ground-class")
        cell_m = settings.cell_m or fitting_m
        cleaning = Cleaning(box, every=settings.every, ground="none" if method == "class" else method)
        inputs = input_records(opened, progress)
        within = opened.area.path.name if opened.area is not None else None
        parameters = {"box": box, "within": within, "every": settings.every, "ground": method, "voxel_m": cell_m}
        found = FoundFeatures()
        surveys = list[Survey]()
        with closing(classify_features(opened, cleaning, cell_m, staging, found, surveys.append, progress)) as points:
            described = ("points of clouds with the classes of features", inputs, parameters)
            summary, lost = write_records(opened, points, staging / CLOUD, box, described, progress)
        layers, counts = found_layers(found)
        digests = [(record.name, record.sha256) for record in inputs]
        origin = Origin("features of clouds", inputs=digests, parameters=parameters)
        write_features(staging / FEATURES, layers, opened.crs, origin)
        by_kind = {f"points_{kind.label}": int(found.points[kind]) for kind in Feature if kind is not Feature.NONE}
        content = {
            "crs": name_of(opened.crs),
            "parameters": parameters,
            "figures": {"points": summary.points, **by_kind, **counts},
            "points_by_class": {str(number): count for number, count in summary.points_by_class.items()},
        }
        notices = [notice for survey in surveys for notice in survey.notices()]
        warnings = list(dict.fromkeys([*opened.notices, *notices, *far, *lost, *sparse_notices(fitting_m)]))
        return write_account(staging, FEATURES_REPORT, opened, inputs, content, warnings)


def found_layers(found: FoundFeatures) -> tuple[list[Layer], dict[str, int]]:
    """The layers of features, and the numbers of what they hold."""
    joined = join_planes(found.planes)
    lines = found.all_lines(joined)
    plants = found.all_plants()
    planes = [plane for plane in joined if not plane.is_open]
    kinds = [line.kind for line in lines]
    return feature_layers(planes, lines, plants), {
        "planes_horizontal": sum(not plane.vertical for plane in planes),
        "planes_vertical": sum(plane.vertical for plane in planes),
        "poles": kinds.count("pole"),
        "wires": kinds.count("wire"),
        "fences": kinds.count("fence"),
        "ditches": kinds.count("ditch"),
        "plants": len(plants),
    }


def sparse_notices(cell_m: float) -> list[Notice]:
    """A warning where points are too far apart for thin things."""
    if cell_m < VOXEL_RANGE_M[1]:
        return []
    return [Notice("features-sparse", cell_m=cell_m)]
