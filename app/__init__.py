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
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from importlib.metadata import version

    from furrowmap.core.accuracy.evaluation import Evaluation as Evaluation
    from furrowmap.core.accuracy.paired_points import PairedPoints as PairedPoints
    from furrowmap.core.accuracy.product_check import Check as Check
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
    from furrowmap.core.session.frame_tree import Frame as Frame
    from furrowmap.core.session.frame_tree import FrameTree as FrameTree
    from furrowmap.core.session.site_coordinates import SiteCoordinates as SiteCoordinates
    from furrowmap.core.session.site_coordinates import site_coordinates as site_coordinates
    from furrowmap.core.simulator.simulate import Simulated as Simulated
    from furrowmap.core.values.plot_grid import PlotGrid as PlotGrid
    from furrowmap.core.values.scan import Scan as Scan
    from furrowmap.exporters.farm.edit import KnownSession as KnownSession
    from furrowmap.exporters.farm.surface_mosaic import Mosaic as Mosaic
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
    from furrowmap.workflows.farm.farm_memory import FarmMemory as FarmMemory
    from furrowmap.workflows.farm.farm_memory import FieldHistory as FieldHistory
    from furrowmap.workflows.farm.farm_memory import TrafficRaster as TrafficRaster
    from furrowmap.workflows.farm.farm_memory import farm_memory as farm_memory
    from furrowmap.workflows.farm.farm_memory import farm_traffic as farm_traffic
    from furrowmap.workflows.farm.farm_memory import field_history as field_history
    from furrowmap.workflows.farm.fields import Fields as Fields
    from furrowmap.workflows.farm.fields import fields as fields
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
    from furrowmap.workflows.session.init import ProposedSession as ProposedSession
    from furrowmap.workflows.session.init import propose_session as propose_session
    from furrowmap.workflows.session.known_machines import KnownMachine as KnownMachine
    from furrowmap.workflows.session.known_machines import known_machines as known_machines
    from furrowmap.workflows.session.known_machines import save_machine as save_machine
    from furrowmap.workflows.session.session_frames import frames as frames
    from furrowmap.workflows.session.simulate import simulate as simulate
    from furrowmap.workflows.share.export import Exported as Exported
    from furrowmap.workflows.share.export import export as export
    from furrowmap.workflows.share.share import Shared as Shared
    from furrowmap.workflows.share.share import share as share
    from furrowmap.workflows.share.share import write_report_page as write_report_page
    from furrowmap.workflows.tie.tie import tie as tie

    __version__ = version("furrowmap")

__all__ = [
    "POINT",
    "Batch",
    "BatchSettings",
    "Board",
    "Calibration",
    "CanopySettings",
    "Check",
    "CheckSettings",
    "CleanSettings",
    "Cleaning",
    "Evaluation",
    "EvaluationSettings",
    "Examined",
    "Exported",
    "FarmMapChange",
    "FarmMemory",
    "FeatureSettings",
    "FieldHistory",
    "Fields",
    "Frame",
    "FrameTree",
    "FurrowmapError",
    "GrowthSettings",
    "InputError",
    "Inspection",
    "KnownMachine",
    "KnownSession",
    "LiveSummary",
    "Mosaic",
    "MosaicSettings",
    "MountCalibration",
    "Notice",
    "PairedPoints",
    "ParcelSettings",
    "Place",
    "PlotGrid",
    "Plots",
    "Points",
    "ProposedSession",
    "Raster",
    "Recorded",
    "RefusedError",
    "ResponseSettings",
    "Result",
    "Scan",
    "Season",
    "SeasonSettings",
    "Shared",
    "Simulated",
    "SiteCoordinates",
    "SolveSettings",
    "SolvedPositions",
    "SurfaceSettings",
    "TieSettings",
    "TrafficRaster",
    "TrafficSettings",
    "UsageError",
    "Wheels",
    "__version__",
    "add_to_farm_map",
    "allowing",
    "batch",
    "calibrate",
    "calibrate_mount",
    "canopy",
    "check",
    "check_pairs",
    "clean",
    "colour",
    "evaluate_gnss",
    "evaluation_figures",
    "evaluation_table",
    "export",
    "farm_map_sessions",
    "farm_memory",
    "farm_traffic",
    "features",
    "field_history",
    "fields",
    "frames",
    "growth",
    "inspect",
    "known_machines",
    "live",
    "mosaic",
    "open_points",
    "open_recording",
    "open_result",
    "parcels",
    "plots",
    "preview",
    "propose_session",
    "range_image",
    "record",
    "remove_from_farm_map",
    "response",
    "run",
    "save_machine",
    "season",
    "share",
    "simulate",
    "site_coordinates",
    "solve_gnss",
    "surface",
    "tie",
    "time_matches",
    "using_threads",
    "write_report_page",
]

_MODULES: Final = {
    "Batch": "furrowmap.workflows.batch.batch",
    "BatchSettings": "furrowmap.settings",
    "Board": "furrowmap.core.images.board",
    "Calibration": "furrowmap.workflows.calibrate.calibrate",
    "CanopySettings": "furrowmap.settings",
    "Check": "furrowmap.core.accuracy.product_check",
    "CheckSettings": "furrowmap.settings",
    "CleanSettings": "furrowmap.settings",
    "Cleaning": "furrowmap.core.pointclouds.cleaning_steps",
    "Evaluation": "furrowmap.core.accuracy.evaluation",
    "EvaluationSettings": "furrowmap.settings",
    "Examined": "furrowmap.core.session.examination",
    "Exported": "furrowmap.workflows.share.export",
    "FarmMapChange": "furrowmap.workflows.farm.farm",
    "FarmMemory": "furrowmap.workflows.farm.farm_memory",
    "FeatureSettings": "furrowmap.settings",
    "FieldHistory": "furrowmap.workflows.farm.farm_memory",
    "Fields": "furrowmap.workflows.farm.fields",
    "Frame": "furrowmap.core.session.frame_tree",
    "FrameTree": "furrowmap.core.session.frame_tree",
    "FurrowmapError": "furrowmap.core.runtime.errors",
    "GrowthSettings": "furrowmap.settings",
    "InputError": "furrowmap.core.runtime.errors",
    "Inspection": "furrowmap.core.readers.reader",
    "KnownMachine": "furrowmap.workflows.session.known_machines",
    "KnownSession": "furrowmap.exporters.farm.edit",
    "LiveSummary": "furrowmap.workflows.live.live",
    "Mosaic": "furrowmap.exporters.farm.surface_mosaic",
    "MosaicSettings": "furrowmap.settings",
    "MountCalibration": "furrowmap.workflows.calibrate.mount",
    "Notice": "furrowmap.core.runtime.errors",
    "POINT": "furrowmap.results",
    "PairedPoints": "furrowmap.core.accuracy.paired_points",
    "ParcelSettings": "furrowmap.settings",
    "Place": "furrowmap.workflows.crops.plots",
    "PlotGrid": "furrowmap.core.values.plot_grid",
    "Plots": "furrowmap.workflows.crops.plots",
    "Points": "furrowmap.results",
    "ProposedSession": "furrowmap.workflows.session.init",
    "Raster": "furrowmap.results",
    "Recorded": "furrowmap.workflows.record.record",
    "RefusedError": "furrowmap.core.runtime.errors",
    "ResponseSettings": "furrowmap.settings",
    "Result": "furrowmap.results",
    "Scan": "furrowmap.core.values.scan",
    "Season": "furrowmap.workflows.season.season",
    "SeasonSettings": "furrowmap.settings",
    "Shared": "furrowmap.workflows.share.share",
    "Simulated": "furrowmap.core.simulator.simulate",
    "SiteCoordinates": "furrowmap.core.session.site_coordinates",
    "SolveSettings": "furrowmap.settings",
    "SolvedPositions": "furrowmap.workflows.gnss.solve",
    "SurfaceSettings": "furrowmap.settings",
    "TieSettings": "furrowmap.settings",
    "TrafficRaster": "furrowmap.workflows.farm.farm_memory",
    "TrafficSettings": "furrowmap.settings",
    "UsageError": "furrowmap.core.runtime.errors",
    "Wheels": "furrowmap.exporters.farm.traffic",
    "add_to_farm_map": "furrowmap.workflows.farm.farm",
    "allowing": "furrowmap.core.runtime.settings",
    "batch": "furrowmap.workflows.batch.batch",
    "calibrate": "furrowmap.workflows.calibrate.calibrate",
    "calibrate_mount": "furrowmap.workflows.calibrate.mount",
    "canopy": "furrowmap.workflows.crops.canopy",
    "check": "furrowmap.workflows.clouds.check",
    "check_pairs": "furrowmap.workflows.clouds.check",
    "clean": "furrowmap.workflows.clouds.clean",
    "colour": "furrowmap.workflows.clouds.colour",
    "evaluate_gnss": "furrowmap.workflows.gnss.evaluate",
    "evaluation_figures": "furrowmap.exporters.reports.evaluation_figures",
    "evaluation_table": "furrowmap.workflows.gnss.evaluate",
    "export": "furrowmap.workflows.share.export",
    "farm_map_sessions": "furrowmap.workflows.farm.farm",
    "farm_memory": "furrowmap.workflows.farm.farm_memory",
    "farm_traffic": "furrowmap.workflows.farm.farm_memory",
    "features": "furrowmap.workflows.clouds.features",
    "field_history": "furrowmap.workflows.farm.farm_memory",
    "fields": "furrowmap.workflows.farm.fields",
    "frames": "furrowmap.workflows.session.session_frames",
    "growth": "furrowmap.workflows.crops.growth",
    "inspect": "furrowmap.recordings",
    "known_machines": "furrowmap.workflows.session.known_machines",
    "live": "furrowmap.workflows.live.live",
    "mosaic": "furrowmap.workflows.farm.mosaic",
    "open_points": "furrowmap.results",
    "open_recording": "furrowmap.recordings",
    "open_result": "furrowmap.results",
    "parcels": "furrowmap.workflows.crops.parcels",
    "plots": "furrowmap.workflows.crops.plots",
    "preview": "furrowmap.workflows.run.preview",
    "propose_session": "furrowmap.workflows.session.init",
    "range_image": "furrowmap.recordings",
    "record": "furrowmap.workflows.record.record",
    "remove_from_farm_map": "furrowmap.workflows.farm.farm",
    "response": "furrowmap.workflows.crops.response",
    "run": "furrowmap.workflows.run.session_run",
    "save_machine": "furrowmap.workflows.session.known_machines",
    "season": "furrowmap.workflows.season.season",
    "share": "furrowmap.workflows.share.share",
    "simulate": "furrowmap.workflows.session.simulate",
    "site_coordinates": "furrowmap.core.session.site_coordinates",
    "solve_gnss": "furrowmap.workflows.gnss.solve",
    "surface": "furrowmap.workflows.clouds.surface",
    "tie": "furrowmap.workflows.tie.tie",
    "time_matches": "furrowmap.core.session.examination",
    "using_threads": "furrowmap.core.runtime.settings",
    "write_report_page": "furrowmap.workflows.share.share",
}
"""The module of each name, imported on its first use: `import furrowmap` takes no time."""


def __getattr__(name: str) -> Any:
    """A public name, imported on first use."""
    if name == "__version__":
        from importlib.metadata import version

        value: Any = version("furrowmap")
    elif name in _MODULES:
        from furrowmap.core.runtime.imports import importing
        from furrowmap.process import prepare_process

        prepare_process()
        with importing():
            value = getattr(import_module(_MODULES[name]), name)
    else:
        raise AttributeError(f"module 'furrowmap' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
