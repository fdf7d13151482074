"""Georeferenced point clouds, surfaces and worked ground from a vehicle's LiDAR and GNSS.

Every workflow of the command line is a function here, for notebooks and other software. Lengths are in metres, angles
in degrees, times in seconds of UTC since 1970; names end with the unit. The names in ``__all__`` keep their meaning
within a major version (https://semver.org); everything else may change with any version.

Examples:
    >>> import furrowmap
    >>> result = furrowmap.run("session.toml", "result")
    >>> result.passes[["start", "end", "area_m2"]]
"""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from importlib.metadata import version

    from furrowmap.core.accuracy.check import Check as Check
    from furrowmap.core.accuracy.evaluation import Evaluation as Evaluation
    from furrowmap.core.accuracy.paired_points import PairedPoints as PairedPoints
    from furrowmap.core.images.board import Board as Board
    from furrowmap.core.pointclouds.cleaning_steps import Cleaning as Cleaning
    from furrowmap.core.readers.reader import Inspection as Inspection
    from furrowmap.core.runtime.errors import FurrowmapError as FurrowmapError
    from furrowmap.core.runtime.errors import InputError as InputError
    from furrowmap.core.runtime.errors import Notice as Notice
    from furrowmap.core.runtime.errors import RefusedError as RefusedError
    from furrowmap.core.runtime.errors import UsageError as UsageError
    from furrowmap.core.runtime.settings import allowing as allowing
    from furrowmap.core.runtime.settings import using_threads as using_threads
    from furrowmap.core.session.examination import Examined as Examined
    from furrowmap.core.session.examination import time_matches as time_matches
    from furrowmap.core.session.frames import Frame as Frame
    from furrowmap.core.session.frames import FrameTree as FrameTree
    from furrowmap.core.session.site_coordinates import SiteCoordinates as SiteCoordinates
    from furrowmap.core.session.site_coordinates import site_coordinates as site_coordinates
    from furrowmap.core.simulator.simulate import Simulated as Simulated
    from furrowmap.core.values.plot_grid import PlotGrid as PlotGrid
    from furrowmap.core.values.scan import Scan as Scan
    from furrowmap.exporters.farm.edit import KnownSession as KnownSession
    from furrowmap.exporters.farm.mosaic import Mosaic as Mosaic
    from furrowmap.exporters.farm.traffic import Wheels as Wheels
    from furrowmap.exporters.reports.evaluation_figures import evaluation_figures as evaluation_figures
    from furrowmap.recordings import inspect as inspect
    from furrowmap.recordings import open_recording as open_recording
    from furrowmap.recordings import range_image as range_image
    from furrowmap.results import POINT as POINT
    from furrowmap.results import Points as Points
    from furrowmap.results import Raster as Raster
    from furrowmap.results import Result as Result
    from furrowmap.results import open_points as open_points
    from furrowmap.results import open_result as open_result
    from furrowmap.settings import BatchSettings as BatchSettings
    from furrowmap.settings import CanopySettings as CanopySettings
    from furrowmap.settings import CheckSettings as CheckSettings
    from furrowmap.settings import CleanSettings as CleanSettings
    from furrowmap.settings import EvaluationSettings as EvaluationSettings
    from furrowmap.settings import FeatureSettings as FeatureSettings
    from furrowmap.settings import GrowthSettings as GrowthSettings
    from furrowmap.settings import MosaicSettings as MosaicSettings
    from furrowmap.settings import ParcelSettings as ParcelSettings
    from furrowmap.settings import ResponseSettings as ResponseSettings
    from furrowmap.settings import SeasonSettings as SeasonSettings
    from furrowmap.settings import SolveSettings as SolveSettings
    from furrowmap.settings import SurfaceSettings as SurfaceSettings
    from furrowmap.settings import TieSettings as TieSettings
    from furrowmap.settings import TrafficSettings as TrafficSettings
    from furrowmap.workflows.batch.batch import Batch as Batch
    from furrowmap.workflows.batch.batch import batch as batch
    from furrowmap.workflows.calibrate.calibrate import Calibration as Calibration
    from furrowmap.workflows.calibrate.calibrate import calibrate as calibrate
    from furrowmap.workflows.calibrate.mount import MountCalibration as MountCalibration
    from furrowmap.workflows.calibrate.mount import calibrate_mount as calibrate_mount
    from furrowmap.workflows.clouds.check import check as check
    from furrowmap.workflows.clouds.check import check_pairs as check_pairs
    from furrowmap.workflows.clouds.clean import clean as clean
    from furrowmap.workflows.clouds.colour import colour as colour
    from furrowmap.workflows.clouds.features import features as features
    from furrowmap.workflows.clouds.surface import surface as surface
    from furrowmap.workflows.crops.canopy import canopy as canopy
    from furrowmap.workflows.crops.growth import growth as growth
    from furrowmap.workflows.crops.parcels import parcels as parcels
    from furrowmap.workflows.crops.plots import Place as Place
    from furrowmap.workflows.crops.plots import Plots as Plots
    from furrowmap.workflows.crops.plots import plots as plots
    from furrowmap.workflows.crops.response import response as response
    from furrowmap.workflows.farm.farm import FarmMapChange as FarmMapChange
    from furrowmap.workflows.farm.farm import add_to_farm_map as add_to_farm_map
    from furrowmap.workflows.farm.farm import farm_map_sessions as farm_map_sessions
    from furrowmap.workflows.farm.farm import remove_from_farm_map as remove_from_farm_map
    from furrowmap.workflows.farm.fields import Fields as Fields
    from furrowmap.workflows.farm.fields import fields as fields
    from furrowmap.workflows.farm.memory import FarmMemory as FarmMemory
    from furrowmap.workflows.farm.memory import FieldHistory as FieldHistory
    from furrowmap.workflows.farm.memory import TrafficRaster as TrafficRaster
    from furrowmap.workflows.farm.memory import farm_memory as farm_memory
    from furrowmap.workflows.farm.memory import farm_traffic as farm_traffic
    from furrowmap.workflows.farm.memory import field_history as field_history
    from furrowmap.workflows.farm.mosaic import mosaic as mosaic
    from furrowmap.workflows.gnss.evaluate import evaluate_gnss as evaluate_gnss
    from furrowmap.workflows.gnss.evaluate import evaluation_table as evaluation_table
    from furrowmap.workflows.gnss.solve import SolvedPositions as SolvedPositions
    from furrowmap.workflows.gnss.solve import solve_gnss as solve_gnss
    from furrowmap.workflows.live.live import LiveSummary as LiveSummary
    from furrowmap.workflows.live.live import live as live
    from furrowmap.workflows.record.record import Recorded as Recorded
    from furrowmap.workflows.record.record import record as record
    from furrowmap.workflows.run.preview import preview as preview
    from furrowmap.workflows.run.session_run import run as run
    from furrowmap.workflows.season.season import Season as Season
    from furrowmap.workflows.season.season import season as season
    from furrowmap.workflows.session.frames import frames as frames
    from furrowmap.workflows.session.init import ProposedSession as ProposedSession
    from furrowmap.workflows.session.init import propose_session as propose_session
    from furrowmap.workflows.session.machines import KnownMachine as KnownMachine
    from furrowmap.workflows.session.machines import known_machines as known_machines
    from furrowmap.workflows.session.machines import save_machine as save_machine
    from furrowmap.workflows.session.simulate import simulate as simulate
    from furrowmap.workflows.share.export import Exported as Exported
    from furrowmap.workflows.share.export import export as export
    from furrowmap.workflows.share.share import Shared as Shared
    from furrowmap.workflows.share.share import share as share
    from furrowmap.workflows.share.share import write_report_page as write_report_page
    from furrowmap.workflows.tie.tie import tie as tie

    __version__ = version("furrowmap")

# The imports above, which type checkers read, are the only list of the public names. Each is imported on its first use:
# `import furrowmap` takes no time.
_SOURCE: Final = Path(__file__).read_text(encoding="utf-8")
_NAMED: Final = re.findall(r"^    from (furrowmap\.\S+) import \w+ as (\w+)$", _SOURCE, re.MULTILINE)
_MODULES: Final = {name: module for module, name in _NAMED}

__all__ = ["__version__", *_MODULES]


def __getattr__(name: str) -> Any:
    """A public name, imported on first use."""
    if name == "__version__":
        from importlib.metadata import version

        value: Any = version("furrowmap")
    elif name in _MODULES:
        from furrowmap.process import importing, prepare_process

        prepare_process()
        with importing():
            value = getattr(import_module(_MODULES[name]), name)
    else:
        raise AttributeError(f"module 'furrowmap' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
