# SPDX-License-Identifier: GPL-2.0-or-later
"""The algorithms: one for each command, with what `commands.json` does not know about it.

Types, choices, defaults, limits, labels and the help of options come from the command line. Here are the texts of
algorithms and of arguments, ids that are not made of the option's name, which layer may stand for a file, and what
becomes of the command's JSON answer. Strings are translated where they are shown; `scripts/plugin_strings.py` collects
them.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .description import DATABASE, Algorithm, Output, parameter

SURFACE_RASTERS = ("dsm", "dtm", "height_above_ground", "hillshade", "slope", "roughness", "low_spots")
SURFACES_OPENED = ("low_spots.gpkg", "dsm.tif", "dtm.tif", "height_above_ground.tif", "slope.tif", "roughness.tif")
RUN_FIGURES = ("worked_area_m2", "overlap_area_m2", "missed_area_m2", "passes", "points")
FEATURE_FIGURES = ("planes_horizontal", "planes_vertical", "poles", "wires", "fences", "plants")
MOUNT_FIGURES = ("frames", "sigma_deg", "rms_px")
BOARDS = "frames_with_board"
COLOUR_FIGURES = ("images", "points_coloured", "points_not_seen")
CHECK_FIGURES = ("rmse_vertical_m", "rmse_horizontal_m", "rmse_3d_m")
MET = "The output MET reports whether it is met."
RUN_LAYERS = ("trajectory", "passes", "coverage", "overlaps", "misses", "zones", "tool_path", "events")


def as_json(answer: Any) -> str:
    """An answer or a part of it as text."""
    return json.dumps(answer, ensure_ascii=False, indent=1)


def item(*keys: str) -> Callable[[Any], Any]:
    """Takes a value out of an answer; None where there is none."""

    def value(answer: Any) -> Any:
        for key in keys:
            answer = (answer or {}).get(key)
        return answer

    return value


def count(key: str) -> Callable[[Any], int]:
    """Takes the length of a list in an answer."""
    return lambda answer: len(answer[key])


def texts(key: str) -> Callable[[Any], str]:
    """Takes the texts of notices in an answer, one per line."""
    return lambda answer: "\n".join(notice["text"] for notice in answer[key])


def numbers(names: tuple[str, ...], *keys: str) -> tuple[Output, ...]:
    """Outputs for figures of an answer: the id is the figure's name in capitals."""
    return tuple(Output(name.upper(), "number", name, item(*keys, name)) for name in names)


def product(name: str) -> Callable[[Any], str | None]:
    """Takes the path of a file in the answer's folder; None where it was not written."""
    return lambda answer: str(Path(answer["folder"]) / name) if name in answer["products"] else None


def products(*names: str) -> Callable[[Any], list[str]]:
    """Takes the paths of the files in the answer's folder that were written."""
    return lambda answer: [path for path in (product(name)(answer) for name in names) if path]


def output(answer: Any) -> list[str]:
    """Takes the file that the command wrote."""
    return [answer["output"]]


def json_of(key: str) -> Callable[[Any], str]:
    """Takes a part of an answer as text."""
    return lambda answer: as_json(answer[key])


OUTPUT_FOLDER = Output("FOLDER", "folder", "Output folder", item("folder"))
FINDINGS = Output("FINDINGS", "text", "Findings (JSON)", as_json)

ALGORITHMS = (
    Algorithm(
        "init",
        "Create a session file",
        "Reads recordings and writes a commented session.toml with everything that they contain. What they do not "
        "contain, such as the mounting of the scanner, is left as a comment and reported.",
        basic=("recordings", "--output", "--machine"),
        facts={
            "recordings": parameter(help_text="LiDAR captures or bags, GNSS logs and trajectories of one drive."),
            "--output": parameter(filter="TOML (*.toml)"),
        },
        outputs=(
            Output("SESSION", "file", "Session file", item("session")),
            Output("FOUND", "text", "Found in the recordings", texts("found")),
            Output("MISSING", "text", "Missing from the recordings", texts("missing")),
        ),
    ),
    Algorithm(
        "inspect",
        "Inspect recordings",
        "Reports what recordings contain: sensor model, points, time span, clocks and their differences, fix types.",
        basic=("files",),
        facts={"files": parameter("Recordings", "Captures, bags, GNSS logs, trajectories, point clouds.")},
        outputs=(FINDINGS,),
    ),
    Algorithm(
        "run",
        "Run a session",
        "Computes the georeferenced point cloud of a session's recording, detects in the scans when the implement is "
        "in the ground, and writes the worked ground, surfaces and a report.",
        basic=("session", "--preview", "--output"),
        facts={
            "--output": parameter(help_text="Products of the same recording in it are replaced.", required=True),
            "--overwrite": parameter(),
            "--within": parameter(
                help_text="Only the ground in them is mapped: GeoPackage, Shapefile, GeoJSON, FlatGeobuf, KML, "
                "or task data.",
                layers="polygons",
            ),
        },
        outputs=(
            OUTPUT_FOLDER,
            Output("REPORT", "text", "Report (HTML)", product("report.html")),
            *numbers(RUN_FIGURES, "figures"),
        ),
    ),
    Algorithm(
        "calibrate",
        "Calibrate the mounting",
        "Estimates the scanner's mounting and the offset between its clock and the GNSS receiver's from the recording: "
        "on average the ground is level, and ground scanned twice coincides.",
        basic=("session", "--write"),
        outputs=(FINDINGS, Output("WRITTEN", "boolean", "Session file written", item("written"))),
    ),
    Algorithm(
        "calibrate mount",
        "Attitude of a mount from images of a chessboard",
        "Computes the attitude of a mount that moves against the vehicle, such as one on dampers, from images of a "
        "chessboard: the camera is on the mount and the board on the vehicle, or the other way round. A session "
        "names the table under [mount] attitude.",
        basic=("frames", "--board", "--square-m", "--output"),
        facts={
            "frames": parameter(
                "Images",
                "A table of the images and their times (CSV: file, time_unix_s), or one of the images: it "
                "stands for all in its folder, with their times in EXIF data.",
                filter="Images (*.csv *.jpg *.jpeg *.png *.tif *.tiff)",
                folder_of="*.[!c]*",
            ),
            "--square-m": parameter(name="SQUARE"),
            "--output": parameter(
                help_text="Table of roll, pitch and yaw over time.", required=True, filter="CSV (*.csv)"
            ),
            "--camera": parameter(
                help_text="Its [camera] has the intrinsics. Without it they are estimated from the images.",
                filter="TOML (*.toml)",
            ),
            "--board-rpy": parameter(count=3),
        },
        outputs=(*numbers(MOUNT_FIGURES), Output("WITH_BOARD", "number", "Images with the board", item(BOARDS))),
    ),
    Algorithm(
        "machine save",
        "Save the machine of a session",
        "Saves the places of antenna, scanner, IMU, camera and implement that a session states, for sessions of the "
        "same machine.",
        basic=("session", "name"),
        facts={"name": parameter("Machine", "A name, or a file to pass on that ends with .toml.")},
        outputs=(Output("MACHINE", "file", "Machine", item("machine")),),
    ),
    Algorithm(
        "machine list",
        "List the saved machines",
        "Lists the machines whose places of sensors and tools are saved.",
        basic=(),
        outputs=(Output("MACHINES", "text", "Machines (JSON)", json_of("machines")),),
    ),
    Algorithm(
        "simulate",
        "Simulate a recording",
        "Writes a simulated tractor recording: LiDAR packets, a GNSS log, a session file and the field boundary, with "
        "the ground truth. Useful to learn furrowmap and to plan a sensor mount.",
        basic=("scenario", "--output"),
        facts={
            "scenario": parameter(
                help_text="Field, drive and sensors. By default a small field that is tilled for a minute.",
                required=False,
                filter="TOML (*.toml)",
                if_absent="demo",
            )
        },
        outputs=(
            OUTPUT_FOLDER,
            Output("SESSION", "file", "Session file", item("session")),
        ),
    ),
    Algorithm(
        "surface",
        "Surfaces from point clouds",
        "Computes rasters from LAS, LAZ or COPC point clouds of any source: surface model (DSM), terrain model (DTM), "
        "height above ground, hillshade, slope, roughness, and low spots that hold water. Memory use does not depend "
        "on the size of the area.",
        basic=("clouds", "--cell", "--ground-method", "--fill", "--output"),
        facts={
            "clouds": parameter("Point clouds", "LAS, LAZ or COPC files; all go into one raster grid.", layers="cloud")
        },
        outputs=(
            OUTPUT_FOLDER,
            *(Output(name.upper(), "raster", name, product(f"{name}.tif")) for name in SURFACE_RASTERS),
        ),
        layers=products(*SURFACES_OPENED),
    ),
    Algorithm(
        "parcels",
        "Crops by parcel",
        "Measures height and volume of the crop on each parcel from LAS, LAZ or COPC point clouds of any source, with "
        "standard deviations: a layer of the parcels, a table, and a raster of crop heights.",
        basic=("clouds", "parcels_file", "--net-inset", "--output"),
        facts={
            "--soil": parameter(
                help_text="A surface through the bare soil around the parcels (default), or a plane around each.",
                kind="choice",
                default=None,
                choices=("surface", "plane"),
            )
            + parameter(
                "Soil of another date",
                "A surface or terrain model (GeoTIFF), or a cloud of bare soil.",
                name="SOIL_SURVEY",
                kind="file",
                layers="raster or cloud",
            )
        },
        outputs=(
            OUTPUT_FOLDER,
            Output("TABLE", "file", "Table of the parcels", product("parcels.csv")),
            Output("CROP_HEIGHT", "raster", "Crop height", product("crop_height.tif")),
            Output("PARCELS_MEASURED", "number", "Number of parcels", count("parcels")),
        ),
        layers=products("parcels.gpkg", "crop_height.tif"),
    ),
    Algorithm(
        "growth",
        "Growth of crops by parcel",
        "Measures what the crop on each parcel grew between flights of several days, aligned in height by the bare "
        "soil that they have in common, with standard deviations: a layer coloured by growth, and a table.",
        basic=("clouds", "parcels_file", "--day", "--net-inset", "--output"),
        facts={
            "clouds": parameter("Point clouds", "LAS, LAZ or COPC files of two days or more.", layers="cloud"),
            "--day": parameter(help_text="One per line, in the order of the clouds: 2017-05-23.", name="DAYS"),
        },
        outputs=(
            OUTPUT_FOLDER,
            Output("GROWTH", "file", "Growth", product("growth.gpkg")),
            Output("TABLE", "file", "Table of the growth", product("growth.csv")),
            Output("PARCELS_MEASURED", "number", "Number of parcels", count("parcels")),
        ),
        layers=products("growth.gpkg"),
        layer_group="Growth",
    ),
    Algorithm(
        "canopy",
        "Stands by cell or polygon",
        "Describes trees, orchards and other stands in LAS, LAZ or COPC point clouds: canopy height model, height "
        "percentiles, gap fraction and vertical profile, by square cell or by polygon.",
        basic=("clouds", "--cell", "--polygons", "--ground-height", "--output"),
        outputs=(
            OUTPUT_FOLDER,
            Output("CANOPY_HEIGHT", "raster", "Canopy height", product("canopy_height.tif")),
            Output("TABLE", "file", "Table of the areas", product("canopy.csv")),
            Output("PROFILES", "file", "Table of the profiles", product("canopy_profile.csv")),
            Output("AREAS", "number", "Number of areas", item("figures", "areas")),
        ),
        layers=products("canopy.gpkg", "canopy_height.tif"),
        layer_group="Canopy",
    ),
    Algorithm(
        "cloud",
        "Clean point clouds",
        "Writes one COPC file from LAS, LAZ or COPC point clouds of any source: outliers become noise, ground is "
        "classified, and the cloud is thinned, each if asked for. Memory use does not depend on the size of the area.",
        basic=("clouds", "--outliers", "--drop-noise", "--ground", "--voxel", "--output"),
        facts={
            "clouds": parameter("Point clouds", "LAS, LAZ or COPC files in one CRS.", layers="cloud"),
            "--output": parameter(filter="COPC (*.copc.laz)"),
            "--without-class": parameter(name="CLASSES"),
        },
        outputs=(Output("POINTS", "number", "Number of points", item("figures", "points")),),
        layers=output,
        layer_group="Clean point cloud",
    ),
    Algorithm(
        "colour",
        "Colour a point cloud by images",
        "Writes a LAS, LAZ or COPC point cloud of any source in the colours of the images of a session. Each point "
        "takes the colour of the best image that sees it; points that no image sees are black.",
        basic=("cloud", "session", "--output"),
        facts={
            "cloud": parameter("Point cloud", "LAS, LAZ or COPC file.", layers="cloud"),
            "session": parameter(
                "Session file",
                "Its [camera] names the images; GNSS and IMU give their poses. The scans are not read.",
                filter="TOML (*.toml)",
            ),
            "--output": parameter(filter="COPC point cloud (*.copc.laz)"),
        },
        outputs=numbers(COLOUR_FIGURES, "figures"),
        layers=output,
        layer_group="Coloured point cloud",
    ),
    Algorithm(
        "features",
        "Features of point clouds",
        "Classifies LAS, LAZ or COPC point clouds of any source by the shape and colour around each point: ground, "
        "horizontal and vertical planes, lines, vegetation. Writes the classified cloud, and layers of planes (roofs, "
        "walls), lines (poles, wires, fences) and plants. Memory use does not depend on the size of the area.",
        basic=("clouds", "--ground-method", "--output"),
        outputs=(
            OUTPUT_FOLDER,
            Output("CLOUD", "file", "Classified point cloud", product("cloud.copc.laz")),
            Output("FEATURES", "file", "Features (GeoPackage)", product("features.gpkg")),
            *numbers(FEATURE_FIGURES, "figures"),
        ),
        layers=products("features.gpkg", "cloud.copc.laz"),
    ),
    Algorithm(
        "fields",
        "Worked ground from task data (ISOXML)",
        "Computes the ground that a machine worked in each field from its ISO 11783-10 task data, without a scanner: "
        "passes, overlaps, missed strips and their areas.",
        basic=("taskdata", "--width", "--output"),
        facts={
            "taskdata": parameter(
                "Task data", "TASKDATA.XML in its folder, or a .zip of the folder.", folder_of="*.xml"
            ),
            "--output": parameter(required=True, filter="GeoPackage (*.gpkg)"),
        },
        outputs=(
            Output("FIELDS", "text", "Figures by field (JSON)", json_of("fields")),
            Output(
                "WORKED_AREA_M2",
                "number",
                "worked_area_m2",
                lambda answer: sum(each["worked_area_m2"] or 0.0 for each in answer["fields"]),
            ),
        ),
        layers=output,
        layer_group="Worked ground",
    ),
    Algorithm(
        "plots",
        "Lay out the plots of a trial",
        "Makes the plots of a trial as a grid of rectangles with identifiers and blocks. Click the outer corner of the "
        "first plot, and the other end of the first row.",
        basic=(
            "--corner",
            "--end",
            "--rows",
            "--columns",
            "--length",
            "--width",
            "--alley",
            "--path",
            "--side",
            "--numbering",
            "--along",
            "--blocks",
            "--crs",
            "--output",
        ),
        facts={
            "--output": parameter(filter="GeoPackage (*.gpkg);;GeoJSON (*.geojson)"),
            "--azimuth": parameter(help_text="Instead of the end of the first row: its direction from north."),
            "--rows": parameter(default=5),
            "--columns": parameter(default=4),
            "--width": parameter(default=2.5),
            "--alley": parameter(default=1.0),
            "--path": parameter(default=0.5),
            "--crs": parameter(default="ProjectCrs"),
        },
        outputs=(Output("PLOTS", "number", "plots", item("plots")),),
        layers=output,
        layer_group="Plots",
    ),
    Algorithm(
        "response",
        "Analyse the response of a trial",
        "Fits the logistic response of crop heights to a dose, finds the dose beyond which nothing is gained, analyses "
        "the variance by treatment and block, and computes growth where there are tables of several days. Writes "
        "charts, a table and response.json.",
        basic=("tables", "--treatments", "--day", "--output"),
        facts={
            "tables": parameter("Tables of parcels", "parcels.csv of runs, one for each day.", layers="table"),
            "--day": parameter(help_text="One per line, in the order of the tables: 2017-05-23.", name="DAYS"),
        },
        outputs=(
            Output("CHART", "file", "Chart of the response", product("response.svg")),
            FINDINGS,
        ),
    ),
    Algorithm(
        "export",
        "Export results",
        "Converts the results of a run: GeoPackage, GeoParquet, FlatGeobuf, GeoJSON, Shapefile, KML, CSV, ISO 11783-10 "
        "task data for farm software and terminals, or a STAC catalogue of many runs. GeoJSON and KML are always in "
        "WGS 84.",
        basic=("results", "--to", "--output"),
        facts={
            "--to": parameter(
                help_text="isoxml writes task data into a folder, or into a .zip if the output's name ends in "
                ".zip. Only stac accepts several results.",
                name="FORMAT",
            ),
            "--output": parameter(
                help_text="By default beside the results. Formats with one layer per file need a folder.", name="TARGET"
            ),
            "--layer": parameter(help_text="By default all layers.", name="LAYERS", kind="choices", choices=RUN_LAYERS),
        },
        outputs=(
            Output("WRITTEN", "text", "File or folder written", item("target")),
            Output("FILES", "layers", "Files written", item("files")),
        ),
    ),
    Algorithm(
        "share",
        "Share a result",
        "Writes the result of a run as a folder for people without a GIS: a web page with map, layers, figures, point "
        "cloud in three dimensions and measuring, which opens from disk and needs no network; or a project for QField.",
        basic=("result", "--qfield", "--output"),
        facts={
            "result": parameter(
                "Result of a run", "The report.json of the run; it stands for the folder of the run.", folder_of="*"
            ),
            "--output": parameter(required=True),
        },
        outputs=(
            Output("START", "file", "File to open", item("start")),
            Output("FILES", "layers", "Files written", item("files")),
        ),
    ),
    Algorithm(
        "farm add",
        "Add results to the farm map",
        "Adds the results of runs to a farm map, a GeoPackage or a PostGIS database, which is created if it does not "
        "exist. Sessions that the farm map contains are replaced by the new result. If one of them fails, nothing is "
        "changed.",
        basic=("folders", "target"),
        facts={
            "target": parameter(
                "Farm map (GeoPackage)",
                "The farm's GeoPackage.",
                name="FARM_MAP",
                kind="new file",
                filter="GeoPackage (*.gpkg)",
                adds=True,
            )
            + DATABASE
        },
        outputs=(
            *(Output(name.upper(), "number", name, count(name)) for name in ("added", "replaced", "unchanged")),
            Output("SESSIONS", "number", "sessions", item("sessions")),
        ),
        layers=lambda answer: [answer["farm_map"]] if Path(answer["farm_map"]).is_file() else [],
        layer_group="Farm map",
    ),
    Algorithm(
        "tie",
        "Change between dates of one field",
        "Ties the results of one field to each other by the ground that no tool touched in between, in height, tilt "
        "and place, and measures the soil moved from each date to the next, with standard deviations.",
        basic=("results", "--reference", "--reference-sigma", "--output"),
        facts={
            "--reference": parameter(
                help_text="The dates are moved onto it: GeoTIFF, or CSV or GeoPackage of points.",
                filter="Surfaces and points (*.tif *.tiff *.csv *.txt *.tsv *.gpkg)",
            )
        },
        outputs=(
            OUTPUT_FOLDER,
            Output("TIES", "file", "Ties", product("tie.gpkg")),
            Output("PAGE", "file", "Page", product("tie.html")),
            Output("CHANGES", "number", "Number of changes", count("changes")),
        ),
        layers=lambda answer: [str(Path(answer["folder"], row["raster"])) for row in answer["changes"]],
        layer_group="Change between dates",
    ),
    Algorithm(
        "farm list",
        "List the sessions of the farm map",
        "Lists the sessions of a farm map: identifier, date, worked area, name.",
        basic=("target",),
        outputs=(
            Output("SESSIONS", "text", "Sessions (JSON)", json_of("sessions")),
            Output("COUNT", "number", "Number of sessions", count("sessions")),
        ),
    ),
    Algorithm(
        "farm remove",
        "Remove sessions from the farm map",
        "Removes sessions from a farm map. The folders of their results are not touched.",
        basic=("target", "sessions"),
        facts={
            "sessions": parameter(
                help_text="One per line: the identifier, the beginning of it, or the name.", name="SESSION"
            )
        },
        outputs=(
            Output("REMOVED", "number", "Number of sessions removed", count("removed")),
            Output("SESSIONS", "number", "Number of sessions left", item("sessions")),
        ),
    ),
    Algorithm(
        "farm mosaic",
        "Mosaic of the farm map's surfaces",
        "Combines the surfaces of a farm map's sessions into one raster. Where they overlap, the latest session is "
        "used. A .vrt is a small file that refers to the surfaces; a .tif is a cloud-optimised GeoTIFF with all bands.",
        basic=("sources", "--product", "--output"),
        facts={
            "--product": parameter(
                help_text="dsm: after the work; dsm_before: before it; change: the difference.",
                kind="choice",
                choices=("dsm", "dsm_before", "change"),
            ),
            "--output": parameter(kind="new raster"),
        },
        outputs=(Output("SURFACES", "number", "Number of surfaces", item("surfaces")),),
    ),
    Algorithm(
        "farm fields",
        "Fields, seasons and machines of the farm map",
        "Lists the work of each field and season in a farm map, and that of each machine.",
        basic=("target",),
        outputs=(
            Output("FIELDS", "text", "Fields (JSON)", json_of("fields")),
            Output("SEASONS", "text", "Seasons of fields (JSON)", json_of("seasons")),
            Output("MACHINES", "text", "Machines (JSON)", json_of("machines")),
        ),
    ),
    Algorithm(
        "farm history",
        "History of a field",
        "Writes all sessions of a field in a farm map as a page with a map, or as a table (CSV).",
        basic=("target", "field", "--output"),
        facts={
            "field": parameter(help_text="Its name or identifier."),
            "--output": parameter(filter="HTML (*.html);;CSV (*.csv)"),
        },
        outputs=(Output("SESSIONS", "number", "Number of sessions", count("visits")),),
    ),
    Algorithm(
        "farm traffic",
        "Traffic: how often each spot was worked and driven on",
        "Counts how often each spot was worked, when last, and how often rear wheels passed it, from the sessions of a "
        "farm map. Wheels are counted where both widths are given.",
        basic=("target", "--season", "--track-width", "--tyre-width", "--output"),
        facts={
            "--season": parameter(help_text="The year in which it begins; all seasons by default."),
            "--track-width": parameter(help_text="Between the middles of the rear tyres, in metres."),
            "--tyre-width": parameter(help_text="Of a rear tyre, in metres."),
            "--output": parameter(kind="new raster"),
        },
        outputs=(Output("PASSES", "number", "Number of passes", item("passes")),),
    ),
    Algorithm(
        "season",
        "Products of a season",
        "Merges the results of many sessions, such as those of a list of drives: for each date a mosaic of the "
        "surfaces, of the change and of the worked ground, tables of points and trajectories, and a STAC catalogue "
        "of it all. "
        "Parts that have not changed are not made again.",
        basic=("results", "--content", "--dst-crs", "--cell", "--output"),
        facts={
            "--content": parameter(
                "Content",
                "Points and trajectories are GeoParquet, which needs the extra 'parquet'.",
                kind="choices",
                default=["mosaics"],
            ),
            "--output": parameter("Output folder", kind="new folder"),
            "--cell": parameter("Cell size"),
            "--spacing": parameter("Point spacing"),
        },
        outputs=(FINDINGS,),
        layers=lambda answer: [str(path) for path in sorted(Path(answer["folder"]).glob("mosaics/*/*.vrt"))],
    ),
    Algorithm(
        "crs",
        "Coordinate transformations of a session",
        "Reports what a run would do with the coordinates of a session, with figures for the site: reference frame and "
        "epoch, size of the shift, geoid height, grid convergence and scale factor. Nothing is written.",
        basic=("session",),
        outputs=(FINDINGS,),
    ),
    Algorithm(
        "frames",
        "Frames of a session",
        "Shows the frames of a session: earth, map, vehicle, and each sensor with its place, its angles and the "
        "directions of its axes in words. A drawing shows them from the side and from above. The recordings are not "
        "read.",
        basic=("session", "--svg"),
        facts={"--svg": parameter(name="DRAWING", filter="SVG (*.svg)")},
        outputs=(FINDINGS,),
    ),
    Algorithm(
        "gnss solve",
        "Positions from RINEX files",
        "Computes the positions of a rover relative to a base station from RINEX files, with RTKLIB's program "
        "rnx2rtkp, which has to be installed. A session names the result as its GNSS log.",
        basic=("rover", "base", "nav", "--base-position", "--static", "--output"),
        facts={
            "rover": parameter("Rover (RINEX)", "Observations of the rover."),
            "base": parameter("Base station (RINEX)", "Observations of the base station at the same time."),
            "nav": parameter("Ephemerides (RINEX)", "Navigation files of the same day.", name="NAVIGATION"),
            "--base-position": parameter(
                help_text="Latitude, longitude and height above the ellipsoid of its antenna, separated by "
                "commas; by default approximate, from its file.",
                name="POSITION",
                count=3,
            ),
            "--output": parameter(filter="RTKLIB solution (*.pos)"),
        },
        outputs=(
            Output("EPOCHS", "number", "Epochs", item("epochs")),
            FINDINGS,
        ),
    ),
    Algorithm(
        "gnss evaluate",
        "Evaluate GNSS logs",
        "Compares the positions of GNSS logs with a reference at the same epochs: mean, standard deviation and RMSE "
        "in 3D, 2D, X, Y and Z, for all epochs and by fix type. Several services are compared in one table, and their "
        "tracks and errors become layers.",
        basic=("test", "--reference", "--name", "--output"),
        facts={
            "test": parameter("Logs to evaluate", "NMEA, or other logs that 'Inspect recordings' reads."),
            "--reference": parameter("Reference log", "Another log of the same drive, or a trajectory.", kind="file")
            + parameter(
                "Known point",
                "Of a static antenna, instead of a log: latitude, longitude, height, separated by commas.",
                name="POINT",
                count=3,
            ),
            "--name": parameter(
                "Names", "Of the services in the tables: one per line, in the order of the logs.", name="NAMES"
            ),
            "--antenna-offset": parameter(
                "Antenna offset (m)",
                "Forward,left,up: from the antenna of the reference to that of the log, on the same vehicle. "
                "One line for all logs, or one for each.",
                name="OFFSET",
            ),
        },
        outputs=(
            FINDINGS,
            Output(
                "PAGE",
                "text",
                "Evaluation (HTML)",
                lambda answer: str(Path(answer["output"]) / "evaluation.html") if answer["output"] else None,
            ),
        ),
        layers=lambda answer: [str(Path(answer["output"]) / "evaluation.gpkg")] if answer["output"] else [],
    ),
    Algorithm(
        "check",
        "Check against surveyed points",
        "Compares a point cloud or a surface with surveyed points. The RMSE follows the ASPRS Positional Accuracy "
        "Standards, Edition 2 (2023), and includes the accuracy of the points.",
        basic=("product", "points", "--points-sigma", "--require-vertical", "--require-horizontal", "--table"),
        facts={
            "product": parameter("Point cloud or surface", "LAS, LAZ, COPC or GeoTIFF.", layers="raster or cloud"),
            "points": parameter("Surveyed points", "CSV or GeoPackage.", layers="points"),
            "--points-sigma": parameter(name="SIGMA"),
            "--require-vertical": parameter(help_text=MET, name="VERTICAL"),
            "--require-horizontal": parameter(help_text=MET, name="HORIZONTAL"),
            "--table": parameter(filter="CSV (*.csv)"),
        },
        outputs=(
            FINDINGS,
            Output(
                "MET",
                "boolean",
                "Requirements met",
                lambda answer: all(verdict["met"] for verdict in answer["verdicts"].values()),
            ),
            *numbers(CHECK_FIGURES, "accuracy"),
        ),
    ),
)
