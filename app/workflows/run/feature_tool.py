"""Planes, lines and plants in the cloud of a run."""

from contextlib import closing
from pathlib import Path
from time import perf_counter

from furrowmap.core.features.cloud_features import FoundFeatures, classify_features, measure_density
from furrowmap.core.pointclouds.cleaning_steps import Cleaning
from furrowmap.core.pointclouds.joined_clouds import open_clouds
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.values.session import FeatureSearch
from furrowmap.exporters.files.result_folder import CLOUD
from furrowmap.workflows.clouds.features import found_layers, sparse_notices
from furrowmap.workflows.clouds.inputs import box_to_use
from furrowmap.workflows.run.tools import CloudMade, RunTool, ToolFindings


class FeatureTool(RunTool):
    """Looks for what `[features]` of a session asks for."""

    def __init__(self, stated: FeatureSearch) -> None:
        self._stated = stated

    def finish(self, made: CloudMade) -> ToolFindings:
        """The features of the written cloud."""
        return run_features(self.folder / CLOUD, self._stated, made.progress) if made.cloud.points else ToolFindings()


def run_features(cloud: Path, stated: FeatureSearch, progress: Progress) -> ToolFindings:
    """Find the features of a run's finished cloud, with its ground and, from images, its colours."""
    begin = perf_counter()
    clouds = open_clouds([cloud], None, None)
    box, far = box_to_use(clouds, None, None, progress)
    fitting_m, classified = measure_density(clouds, box, progress)
    ground = stated.ground or ("class" if classified else "smrf")
    cell_m = stated.voxel_m or fitting_m
    found = FoundFeatures()
    cleaning = Cleaning(box, ground="none" if ground == "class" else ground)
    with closing(classify_features(clouds, cleaning, cell_m, cloud.parent, found, progress=progress)) as points:
        for _ in points:
            pass
    layers, figures = found_layers(found)
    account = {"parameters": {"ground": ground, "voxel_m": cell_m}, "figures": figures}
    return ToolFindings(
        {"features": account},
        (*far, *sparse_notices(fitting_m)),
        layers,
        {"features": figures},
        seconds={"features": perf_counter() - begin},
    )
