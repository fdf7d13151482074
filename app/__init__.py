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

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from importlib.metadata import version

    from furrowmap.core.checking.check import Check as Check
    from furrowmap.core.checking.paired_points import PairedPoints as PairedPoints
    from furrowmap.core.crops.plot_grid import PlotGrid as PlotGrid
    from furrowmap.core.evaluation.evaluation import Evaluation as Evaluation
    from furrowmap.core.images.board import Board as Board
    from furrowmap.core.pointclouds.cleaning import Cleaning as Cleaning
    from furrowmap.core.pointclouds.surface_settings import SurfaceSettings as SurfaceSettings
    from furrowmap.core.readers.reader import Inspection as Inspection
    from furrowmap.core.runtime.allowances import allowing as allowing
    from furrowmap.core.runtime.errors import FurrowmapError as FurrowmapError
    from furrowmap.core.runtime.errors import InputError as InputError
    from furrowmap.core.runtime.errors import Notice as Notice
    from furrowmap.core.runtime.errors import RefusedError as RefusedError
    from furrowmap.core.runtime.errors import UsageError as UsageError
    from furrowmap.core.runtime.threads import using_threads as using_threads
    from furrowmap.core.session.examination import Examined as Examined
    from furrowmap.core.session.examination import time_matches as time_matches
    from furrowmap.core.session.frames import Frame as Frame
    from furrowmap.core.session.frames import FrameTree as FrameTree
    from furrowmap.core.session.site_coordinates import SiteCoordinates as SiteCoordinates
    from furrowmap.core.session.site_coordinates import site_coordinates as site_coordinates
    from furrowmap.core.simulator.simulate import Simulated as Simulated
    from furrowmap.core.values.scan import Scan as Scan
    from furrowmap.exporters.farm.edit import KnownSession as KnownSession
    from furrowmap.exporters.farm.mosaic import Mosaic as Mosaic
    from furrowmap.exporters.farm.mosaic import MosaicSettings as MosaicSettings
    from furrowmap.exporters.farm.traffic import Wheels as Wheels
    from furrowmap.exporters.reports.evaluation_figures import evaluation_figures as evaluation_figures
    from furrowmap.points import POINT as POINT
    from furrowmap.points import Points as Points
    from furrowmap.points import open_points as open_points
    from furrowmap.recordings import open_recording as open_recording
    from furrowmap.recordings import range_image as range_image
    from furrowmap.results import Raster as Raster
    from furrowmap.results import Result as Result
    from furrowmap.results import open_result as open_result
    from furrowmap.workflows.batch import Batch as Batch
    from furrowmap.workflows.batch import BatchSettings as BatchSettings
    from furrowmap.workflows.batch import batch as batch
    from furrowmap.workflows.calibrate import Calibration as Calibration
    from furrowmap.workflows.calibrate import calibrate as calibrate
    from furrowmap.workflows.calibrate_mount import MountCalibration as MountCalibration
    from furrowmap.workflows.calibrate_mount import calibrate_mount as calibrate_mount
    from furrowmap.workflows.canopy import CanopySettings as CanopySettings
    from furrowmap.workflows.canopy import canopy as canopy
    from furrowmap.workflows.check import CheckSettings as CheckSettings
    from furrowmap.workflows.check import check as check
    from furrowmap.workflows.check import check_pairs as check_pairs
    from furrowmap.workflows.clean import CleanSettings as CleanSettings
    from furrowmap.workflows.clean import clean as clean
    from furrowmap.workflows.colour import colour as colour
    from furrowmap.workflows.evaluate_gnss import EvaluationSettings as EvaluationSettings
    from furrowmap.workflows.evaluate_gnss import evaluate_gnss as evaluate_gnss
    from furrowmap.workflows.evaluate_gnss import evaluation_table as evaluation_table
    from furrowmap.workflows.export import Exported as Exported
    from furrowmap.workflows.export import export as export
    from furrowmap.workflows.farm import FarmMapChange as FarmMapChange
    from furrowmap.workflows.farm import add_to_farm_map as add_to_farm_map
    from furrowmap.workflows.farm import farm_map_sessions as farm_map_sessions
    from furrowmap.workflows.farm import remove_from_farm_map as remove_from_farm_map
    from furrowmap.workflows.farm_memory import FarmMemory as FarmMemory
    from furrowmap.workflows.farm_memory import FieldHistory as FieldHistory
    from furrowmap.workflows.farm_memory import TrafficRaster as TrafficRaster
    from furrowmap.workflows.farm_memory import TrafficSettings as TrafficSettings
    from furrowmap.workflows.farm_memory import farm_memory as farm_memory
    from furrowmap.workflows.farm_memory import farm_traffic as farm_traffic
    from furrowmap.workflows.farm_memory import field_history as field_history
    from furrowmap.workflows.features import FeatureSettings as FeatureSettings
    from furrowmap.workflows.features import features as features
    from furrowmap.workflows.fields import Fields as Fields
    from furrowmap.workflows.fields import fields as fields
    from furrowmap.workflows.frames import frames as frames
    from furrowmap.workflows.growth import GrowthSettings as GrowthSettings
    from furrowmap.workflows.growth import growth as growth
    from furrowmap.workflows.inspect import inspect as inspect
    from furrowmap.workflows.machines import KnownMachine as KnownMachine
    from furrowmap.workflows.machines import known_machines as known_machines
    from furrowmap.workflows.machines import save_machine as save_machine
    from furrowmap.workflows.mosaic import mosaic as mosaic
    from furrowmap.workflows.parcels import ParcelSettings as ParcelSettings
    from furrowmap.workflows.parcels import parcels as parcels
    from furrowmap.workflows.plots import Place as Place
    from furrowmap.workflows.plots import Plots as Plots
    from furrowmap.workflows.plots import plots as plots
    from furrowmap.workflows.preview import preview as preview
    from furrowmap.workflows.propose import ProposedSession as ProposedSession
    from furrowmap.workflows.propose import propose_session as propose_session
    from furrowmap.workflows.report import write_report_page as write_report_page
    from furrowmap.workflows.response import ResponseSettings as ResponseSettings
    from furrowmap.workflows.response import response as response
    from furrowmap.workflows.run import run as run
    from furrowmap.workflows.season import Season as Season
    from furrowmap.workflows.season import SeasonSettings as SeasonSettings
    from furrowmap.workflows.season import season as season
    from furrowmap.workflows.share import Shared as Shared
    from furrowmap.workflows.share import share as share
    from furrowmap.workflows.simulate import simulate as simulate
    from furrowmap.workflows.solve_gnss import SolvedPositions as SolvedPositions
    from furrowmap.workflows.solve_gnss import SolveSettings as SolveSettings
    from furrowmap.workflows.solve_gnss import solve_gnss as solve_gnss
    from furrowmap.workflows.surface import surface as surface
    from furrowmap.workflows.tie import TieSettings as TieSettings
    from furrowmap.workflows.tie import tie as tie

    __version__ = version("furrowmap")

_HOMES = {
    "Batch": "workflows.batch",
    "BatchSettings": "workflows.batch",
    "Board": "core.images.board",
    "Calibration": "workflows.calibrate",
    "CanopySettings": "workflows.canopy",
    "Check": "core.checking.check",
    "CheckSettings": "workflows.check",
    "CleanSettings": "workflows.clean",
    "Cleaning": "core.pointclouds.cleaning",
    "Evaluation": "core.evaluation.evaluation",
    "EvaluationSettings": "workflows.evaluate_gnss",
    "Examined": "core.session.examination",
    "Exported": "workflows.export",
    "FarmMapChange": "workflows.farm",
    "FarmMemory": "workflows.farm_memory",
    "FeatureSettings": "workflows.features",
    "FieldHistory": "workflows.farm_memory",
    "Fields": "workflows.fields",
    "Frame": "core.session.frames",
    "FrameTree": "core.session.frames",
    "FurrowmapError": "core.runtime.errors",
    "GrowthSettings": "workflows.growth",
    "InputError": "core.runtime.errors",
    "Inspection": "core.readers.reader",
    "KnownMachine": "workflows.machines",
    "KnownSession": "exporters.farm.edit",
    "Mosaic": "exporters.farm.mosaic",
    "MosaicSettings": "exporters.farm.mosaic",
    "MountCalibration": "workflows.calibrate_mount",
    "Notice": "core.runtime.errors",
    "POINT": "points",
    "PairedPoints": "core.checking.paired_points",
    "ParcelSettings": "workflows.parcels",
    "Place": "workflows.plots",
    "PlotGrid": "core.crops.plot_grid",
    "Plots": "workflows.plots",
    "Points": "points",
    "ProposedSession": "workflows.propose",
    "Raster": "results",
    "RefusedError": "core.runtime.errors",
    "ResponseSettings": "workflows.response",
    "Result": "results",
    "Scan": "core.values.scan",
    "Season": "workflows.season",
    "SeasonSettings": "workflows.season",
    "Shared": "workflows.share",
    "Simulated": "core.simulator.simulate",
    "SiteCoordinates": "core.session.site_coordinates",
    "SolveSettings": "workflows.solve_gnss",
    "SolvedPositions": "workflows.solve_gnss",
    "SurfaceSettings": "core.pointclouds.surface_settings",
    "TrafficRaster": "workflows.farm_memory",
    "TrafficSettings": "workflows.farm_memory",
    "UsageError": "core.runtime.errors",
    "Wheels": "exporters.farm.traffic",
    "add_to_farm_map": "workflows.farm",
    "allowing": "core.runtime.allowances",
    "batch": "workflows.batch",
    "calibrate": "workflows.calibrate",
    "calibrate_mount": "workflows.calibrate_mount",
    "canopy": "workflows.canopy",
    "check": "workflows.check",
    "check_pairs": "workflows.check",
    "clean": "workflows.clean",
    "colour": "workflows.colour",
    "evaluate_gnss": "workflows.evaluate_gnss",
    "evaluation_figures": "exporters.reports.evaluation_figures",
    "evaluation_table": "workflows.evaluate_gnss",
    "export": "workflows.export",
    "farm_map_sessions": "workflows.farm",
    "farm_memory": "workflows.farm_memory",
    "farm_traffic": "workflows.farm_memory",
    "features": "workflows.features",
    "field_history": "workflows.farm_memory",
    "fields": "workflows.fields",
    "frames": "workflows.frames",
    "growth": "workflows.growth",
    "inspect": "workflows.inspect",
    "known_machines": "workflows.machines",
    "mosaic": "workflows.mosaic",
    "open_points": "points",
    "open_recording": "recordings",
    "open_result": "results",
    "parcels": "workflows.parcels",
    "plots": "workflows.plots",
    "preview": "workflows.preview",
    "propose_session": "workflows.propose",
    "range_image": "recordings",
    "remove_from_farm_map": "workflows.farm",
    "response": "workflows.response",
    "run": "workflows.run",
    "save_machine": "workflows.machines",
    "season": "workflows.season",
    "share": "workflows.share",
    "simulate": "workflows.simulate",
    "site_coordinates": "core.session.site_coordinates",
    "solve_gnss": "workflows.solve_gnss",
    "surface": "workflows.surface",
    "tie": "workflows.tie",
    "TieSettings": "workflows.tie",
    "time_matches": "core.session.examination",
    "using_threads": "core.runtime.threads",
    "write_report_page": "workflows.report",
}
"""The module of each public name. They are imported on first use, so that `import furrowmap` takes no time."""

__all__ = ["__version__", *_HOMES]


def __getattr__(name: str) -> Any:
    """A public name, imported on first use."""
    if name == "__version__":
        from importlib.metadata import version

        value: Any = version("furrowmap")
    elif name in _HOMES:
        from furrowmap.process import importing, prepare_process

        prepare_process()
        with importing():
            value = getattr(import_module(f"furrowmap.{_HOMES[name]}"), name)
    else:
        raise AttributeError(f"module 'furrowmap' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
