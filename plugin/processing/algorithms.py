# SPDX-License-Identifier: GPL-2.0-or-later
"""The algorithms: one for each command, with what `commands.json` does not know about it.

Types, choices, defaults, limits and the help of options come from the command line. Here are ids, labels, help of
arguments, which file is which, and what becomes of the command's JSON answer. Strings are translated where they are
shown; `scripts/plugin_strings.py` collects them.
"""

import json
from pathlib import Path

from .description import Algorithm, Output, parameter

GROUPS = {
    "session": "Sessions",
    "surfaces": "Surfaces and point clouds",
    "crops": "Crops and trials",
    "farm": "Farm map",
    "exchange": "Data exchange",
    "accuracy": "Accuracy",
}
"""Id → as the toolbox shows it."""

SURFACES = ("dsm", "dtm", "height_above_ground", "hillshade", "slope", "roughness", "low_spots")
SURFACES_OPENED = ("low_spots.gpkg", "dsm.tif", "dtm.tif", "height_above_ground.tif", "slope.tif", "roughness.tif")
RUN_FIGURES = ("worked_area_m2", "overlap_area_m2", "missed_area_m2", "passes", "points")
FEATURE_FIGURES = ("planes_horizontal", "planes_vertical", "poles", "wires", "fences", "plants")
MOUNT_FIGURES = ("frames", "sigma_deg", "rms_px")
BOARDS = "frames_with_board"
COLOUR_FIGURES = ("images", "points_coloured", "points_not_seen")
CHECK_FIGURES = ("rmse_vertical_m", "rmse_horizontal_m", "rmse_3d_m")
MET = "The output MET reports whether it is met."
LAYERS = ("trajectory", "passes", "coverage", "overlaps", "misses", "zones", "tool_path", "events")

SESSION = {
    "session": parameter(
        "SESSION",
        "Session file",
        "The session.toml beside the recording; 'Create a session file' writes one.",
        filter="TOML (*.toml)",
    )
}
RESULTS = parameter(
    "RESULTS", "Results of runs", "The report.json of each run; it stands for the folder of the run.", folder_of="*"
)
OVERWRITE = {
    "--overwrite": parameter(
        "OVERWRITE", "Overwrite existing files", "Otherwise the algorithm stops if the output exists."
    )
}
WITHIN = parameter(
    "WITHIN",
    "Within polygons",
    "GeoPackage, Shapefile, GeoJSON, FlatGeobuf, KML, or a CSV of corners, in any CRS.",
    kind="file",
    layers="polygons",
)
CLOUDS = {
    "--bbox": parameter("EXTENT", "Extent"),
    "--within": WITHIN,
    "--every": parameter("EVERY", "Every n-th point"),
    "--crs": parameter("CRS", "CRS of clouds without one"),
}
DATABASE = parameter(
    "DATABASE",
    "Farm map (PostGIS)",
    "A connection URI such as postgresql://me@server/farm, instead of a GeoPackage. Keep passwords in PostgreSQL's "
    "password file.",
    kind="text",
    advanced=True,
)
FARM_MAP = (
    parameter("FARM_MAP", "Farm map (GeoPackage)", "The farm's GeoPackage.", kind="file", filter="GeoPackage (*.gpkg)")
    + DATABASE
)
SCHEMA = {"--schema": parameter("SCHEMA", "PostGIS schema")}


def as_json(answer):
    """An answer or a part of it as text."""
    return json.dumps(answer, ensure_ascii=False, indent=1)


def item(*keys):
    """Takes a value out of an answer; None where there is none."""

    def value(answer):
        for key in keys:
            answer = (answer or {}).get(key)
        return answer

    return value


def count(key):
    """Takes the length of a list in an answer."""
    return lambda answer: len(answer[key])


def texts(key):
    """Takes the texts of notices in an answer, one per line."""
    return lambda answer: "\n".join(notice["text"] for notice in answer[key])


def numbers(names, *keys):
    """Outputs for figures of an answer: the id is the figure's name in capitals."""
    return tuple(Output(name.upper(), "number", name, item(*keys, name)) for name in names)


def product(name):
    """Takes the path of a file in the answer's folder; None where it was not written."""
    return lambda answer: str(Path(answer["folder"]) / name) if name in answer["products"] else None


def surfaces_written(answer):
    """The files of `surface` that are opened as layers."""
    return [path for path in (product(name)(answer) for name in SURFACES_OPENED) if path]


def parcels_written(answer):
    """The files of `parcels` that are opened as layers."""
    return [path for path in (product(name)(answer) for name in ("parcels.gpkg", "crop_height.tif")) if path]


def canopy_written(answer):
    """The files of `canopy` that are opened as layers."""
    return [path for path in (product(name)(answer) for name in ("canopy.gpkg", "canopy_height.tif")) if path]


def features_written(answer):
    """The files of `features` that are opened as layers."""
    return [product(name)(answer) for name in ("features.gpkg", "cloud.copc.laz")]


FINDINGS = Output("FINDINGS", "text", "Findings (JSON)", as_json)

ALGORITHMS = (
    Algorithm(
        "init",
        "Create a session file",
        "session",
        "Reads recordings and writes a commented session.toml with everything that they contain. What they do not "
        "contain, such as the mounting of the scanner, is left as a comment and reported.",
        basic={
            "recordings": parameter(
                "RECORDINGS", "Recordings", "LiDAR captures or bags, GNSS logs and trajectories of one drive."
            ),
            "--output": parameter("OUTPUT", "Session file", filter="TOML (*.toml)"),
            "--machine": parameter("MACHINE", "Machine", required=False),
        },
        advanced=OVERWRITE,
        outputs=(
            Output("SESSION", "file", "Session file", item("session")),
            Output("FOUND", "text", "Found in the recordings", texts("found")),
            Output("MISSING", "text", "Missing from the recordings", texts("missing")),
        ),
    ),
    Algorithm(
        "inspect",
        "Inspect recordings",
        "session",
        "Reports what recordings contain: sensor model, points, time span, clocks and their differences, fix types.",
        basic={"files": parameter("FILES", "Recordings", "Captures, bags, GNSS logs, trajectories, point clouds.")},
        outputs=(FINDINGS,),
    ),
    Algorithm(
        "run",
        "Run a session",
        "session",
        "Computes the georeferenced point cloud of a session's recording, detects in the scans when the implement is "
        "in the ground, and writes the worked ground, surfaces and a report.",
        basic={
            **SESSION,
            "--preview": parameter("PREVIEW", "Preview only"),
            "--output": parameter(
                "OUTPUT", "Output folder", "Products of the same recording in it are replaced.", required=True
            ),
        },
        advanced={
            "--overwrite": parameter("OVERWRITE", "Replace the products of another recording"),
            "--within": parameter(
                "WITHIN",
                "Within polygons",
                "Only the ground in them is mapped: GeoPackage, Shapefile, GeoJSON, FlatGeobuf, KML, or task data.",
                kind="file",
                layers="polygons",
            ),
        },
        outputs=(
            Output("FOLDER", "folder", "Output folder", item("folder")),
            Output("REPORT", "text", "Report (HTML)", product("report.html")),
            *numbers(RUN_FIGURES, "figures"),
        ),
        opens=True,
    ),
    Algorithm(
        "calibrate",
        "Calibrate the mounting",
        "session",
        "Estimates the scanner's mounting and the offset between its clock and the GNSS receiver's from the recording: "
        "on average the ground is level, and ground scanned twice coincides.",
        basic={**SESSION, "--write": parameter("WRITE", "Write the estimates into the session file")},
        advanced={"--machine": parameter("MACHINE", "Machine", required=False)},
        outputs=(FINDINGS, Output("WRITTEN", "boolean", "Session file written", item("written"))),
    ),
    Algorithm(
        "calibrate mount",
        "Attitude of a mount from images of a chessboard",
        "session",
        "Computes the attitude of a mount that moves against the vehicle, such as one on dampers, from images of a "
        "chessboard: the camera is on the mount and the board on the vehicle, or the other way round. A session "
        "names the table under [mount] attitude.",
        basic={
            "frames": parameter(
                "FRAMES",
                "Images",
                "A table of the images and their times (CSV: file, time_unix_s), or one of the images: it stands for "
                "all in its folder, with their times in EXIF data.",
                filter="Images (*.csv *.jpg *.jpeg *.png *.tif *.tiff)",
                folder_of="*.[!c]*",
            ),
            "--board": parameter("BOARD", "Inner corners of the chessboard"),
            "--square-m": parameter("SQUARE", "Side of a square", unit="m"),
            "--output": parameter(
                "OUTPUT",
                "Attitude of the mount",
                "Table of roll, pitch and yaw over time.",
                required=True,
                filter="CSV (*.csv)",
            ),
        },
        advanced={
            "--camera": parameter(
                "CAMERA",
                "Session with the intrinsics",
                "Its [camera] has the intrinsics. Without it they are estimated from the images.",
                kind="file",
                filter="TOML (*.toml)",
            ),
            "--board-rpy": parameter("BOARD_RPY", "Roll, pitch and yaw of the board", count=3),
            "--board-on": parameter("BOARD_ON", "The board is on the"),
            **OVERWRITE,
        },
        outputs=(*numbers(MOUNT_FIGURES), Output("WITH_BOARD", "number", "Images with the board", item(BOARDS))),
    ),
    Algorithm(
        "machine save",
        "Save the machine of a session",
        "session",
        "Saves the places of antenna, scanner, IMU, camera and implement that a session states, for sessions of the "
        "same machine.",
        basic={**SESSION, "name": parameter("NAME", "Machine", "A name, or a file to pass on that ends with .toml.")},
        advanced=OVERWRITE,
        outputs=(Output("MACHINE", "file", "Machine", item("machine")),),
    ),
    Algorithm(
        "machine list",
        "List the saved machines",
        "session",
        "Lists the machines whose places of sensors and tools are saved.",
        basic={},
        outputs=(Output("MACHINES", "text", "Machines (JSON)", lambda answer: as_json(answer["machines"])),),
    ),
    Algorithm(
        "simulate",
        "Simulate a recording",
        "session",
        "Writes a simulated tractor recording: LiDAR packets, a GNSS log, a session file and the field boundary, with "
        "the ground truth. Useful to learn furrowmap and to plan a sensor mount.",
        basic={
            "scenario": parameter(
                "SCENARIO",
                "Scenario",
                "Field, drive and sensors. By default a small field that is tilled for a minute.",
                filter="TOML (*.toml)",
                required=False,
                if_absent="demo",
            ),
            "--output": parameter("OUTPUT", "Output folder"),
        },
        advanced=OVERWRITE,
        outputs=(
            Output("FOLDER", "folder", "Output folder", item("folder")),
            Output("SESSION", "file", "Session file", item("session")),
        ),
    ),
    Algorithm(
        "surface",
        "Surfaces from point clouds",
        "surfaces",
        "Computes rasters from LAS, LAZ or COPC point clouds of any source: surface model (DSM), terrain model (DTM), "
        "height above ground, hillshade, slope, roughness, and low spots that hold water. Memory use does not depend "
        "on the size of the area.",
        basic={
            "clouds": parameter(
                "CLOUDS", "Point clouds", "LAS, LAZ or COPC files; all go into one raster grid.", layers="cloud"
            ),
            "--cell": parameter("CELL", "Cell size"),
            "--ground-method": parameter("GROUND", "Ground classification"),
            "--fill": parameter("FILL", "Maximum gap to fill"),
            "--output": parameter("OUTPUT", "Output folder"),
        },
        advanced={
            **CLOUDS,
            "--dst-crs": parameter("DST_CRS", "CRS of the surfaces"),
            "--class": parameter("CLASSES", "Class codes to use, such as 2,9"),
            "--statistic": parameter("STATISTIC", "Cell statistic"),
            "--outliers": parameter("OUTLIERS", "Outlier detection method"),
            "--tillage": parameter("TILLAGE", "Direction of tillage"),
            **OVERWRITE,
        },
        outputs=(
            Output("FOLDER", "folder", "Output folder", item("folder")),
            *(Output(name.upper(), "raster", name, product(f"{name}.tif")) for name in SURFACES),
        ),
        opens=True,
        layers=surfaces_written,
    ),
    Algorithm(
        "parcels",
        "Crops by parcel",
        "crops",
        "Measures height and volume of the crop on each parcel from LAS, LAZ or COPC point clouds of any source, with "
        "standard deviations: a layer of the parcels, a table, and a raster of crop heights.",
        basic={
            "clouds": parameter(
                "CLOUDS", "Point clouds", "LAS, LAZ or COPC files; they are used together.", layers="cloud"
            ),
            "parcels_file": parameter(
                "PARCELS",
                "Parcels",
                "Gross parcels: GeoPackage, Shapefile, GeoJSON, FlatGeobuf, KML, or a CSV of corners.",
                layers="polygons",
            ),
            "--net-inset": parameter(
                "NET_INSET", "Net parcels: metres off each end, off each side", kind="numbers", count=2
            ),
            "--output": parameter("OUTPUT", "Output folder"),
        },
        advanced={
            "--net": parameter("NET", "Net parcels from a file", kind="file", layers="polygons"),
            "--treatments": parameter("TREATMENTS", "Treatments", kind="file", layers="table"),
            "--day": parameter("DAY", "Day of the flight"),
            "--method": parameter("METHOD", "Method for heights and volumes"),
            "--soil": parameter(
                "SOIL",
                "Soil below the crop",
                "A surface through the bare soil around the parcels (default), or a plane around each.",
                kind="choice",
                choices=("surface", "plane"),
                default=None,
            )
            + parameter(
                "SOIL_SURVEY",
                "Soil of another date",
                "A surface or terrain model (GeoTIFF), or a cloud of bare soil.",
                kind="file",
                layers="raster or cloud",
            ),
            "--compare": parameter("COMPARE", "Compute the published method, too"),
            "--class": parameter("CLASSES", "Class codes to use, such as 2,9"),
            "--crs": CLOUDS["--crs"],
            "--dst-crs": parameter("DST_CRS", "CRS of the output"),
            **OVERWRITE,
        },
        outputs=(
            Output("FOLDER", "folder", "Output folder", item("folder")),
            Output("TABLE", "file", "Table of the parcels", product("parcels.csv")),
            Output("CROP_HEIGHT", "raster", "Crop height", product("crop_height.tif")),
            Output("PARCELS_MEASURED", "number", "Number of parcels", count("parcels")),
        ),
        opens=True,
        layers=parcels_written,
    ),
    Algorithm(
        "growth",
        "Growth of crops by parcel",
        "crops",
        "Measures what the crop on each parcel grew between flights of several days, aligned in height by the bare "
        "soil that they have in common, with standard deviations: a layer coloured by growth, and a table.",
        basic={
            "clouds": parameter(
                "CLOUDS", "Point clouds", "LAS, LAZ or COPC files of two days or more.", layers="cloud"
            ),
            "parcels_file": parameter(
                "PARCELS",
                "Parcels",
                "Gross parcels: GeoPackage, Shapefile, GeoJSON, FlatGeobuf, KML, or a CSV of corners.",
                layers="polygons",
            ),
            "--day": parameter("DAYS", "Days of the flights", "One per line, in the order of the clouds: 2017-05-23."),
            "--net-inset": parameter(
                "NET_INSET", "Net parcels: metres off each end, off each side", kind="numbers", count=2
            ),
            "--output": parameter("OUTPUT", "Output folder"),
        },
        advanced={
            "--net": parameter("NET", "Net parcels from a file", kind="file", layers="polygons"),
            "--class": parameter("CLASSES", "Class codes to use, such as 2,9"),
            "--crs": CLOUDS["--crs"],
            "--dst-crs": parameter("DST_CRS", "CRS of the output"),
            **OVERWRITE,
        },
        outputs=(
            Output("FOLDER", "folder", "Output folder", item("folder")),
            Output("GROWTH", "file", "Growth", product("growth.gpkg")),
            Output("TABLE", "file", "Table of the growth", product("growth.csv")),
            Output("PARCELS_MEASURED", "number", "Number of parcels", count("parcels")),
        ),
        opens=True,
        layers=lambda answer: [path for path in [product("growth.gpkg")(answer)] if path],
        layer_group="Growth",
    ),
    Algorithm(
        "canopy",
        "Stands by cell or polygon",
        "crops",
        "Describes trees, orchards and other stands in LAS, LAZ or COPC point clouds: canopy height model, height "
        "percentiles, gap fraction and vertical profile, by square cell or by polygon.",
        basic={
            "clouds": parameter(
                "CLOUDS", "Point clouds", "LAS, LAZ or COPC files; they are used together.", layers="cloud"
            ),
            "--cell": parameter("CELL", "Side of the cells"),
            "--polygons": parameter("POLYGONS", "Polygons instead of cells", kind="file", layers="polygons"),
            "--ground-height": parameter("GROUND_HEIGHT", "Highest return from the ground"),
            "--output": parameter("OUTPUT", "Output folder"),
        },
        advanced={
            "--pixel": parameter("PIXEL", "Pixel of the canopy height model"),
            "--layer": parameter("LAYER", "Height of a layer of the profile"),
            "--ground-method": parameter("GROUND", "Ground classification"),
            "--bbox": parameter("EXTENT", "Extent"),
            "--class": parameter("CLASSES", "Class codes to use, such as 2,9"),
            "--crs": CLOUDS["--crs"],
            "--dst-crs": parameter("DST_CRS", "CRS of the output"),
            **OVERWRITE,
        },
        outputs=(
            Output("FOLDER", "folder", "Output folder", item("folder")),
            Output("CANOPY_HEIGHT", "raster", "Canopy height", product("canopy_height.tif")),
            Output("TABLE", "file", "Table of the areas", product("canopy.csv")),
            Output("PROFILES", "file", "Table of the profiles", product("canopy_profile.csv")),
            Output("AREAS", "number", "Number of areas", item("figures", "areas")),
        ),
        opens=True,
        layers=canopy_written,
        layer_group="Canopy",
    ),
    Algorithm(
        "cloud",
        "Clean point clouds",
        "surfaces",
        "Writes one COPC file from LAS, LAZ or COPC point clouds of any source: outliers become noise, ground is "
        "classified, and the cloud is thinned, each if asked for. Memory use does not depend on the size of the area.",
        basic={
            "clouds": parameter("CLOUDS", "Point clouds", "LAS, LAZ or COPC files in one CRS.", layers="cloud"),
            "--outliers": parameter("OUTLIERS", "Outlier detection method"),
            "--drop-noise": parameter("DROP_NOISE", "Leave out noise"),
            "--ground": parameter("GROUND", "Ground classification"),
            "--voxel": parameter("VOXEL", "Voxel size"),
            "--output": parameter("OUTPUT", "Clean point cloud", filter="COPC (*.copc.laz)"),
        },
        advanced={
            **CLOUDS,
            "--dst-crs": parameter("DST_CRS", "CRS of the clean point cloud"),
            "--without-class": parameter("CLASSES", "Class codes to leave out, such as 64,65"),
            **OVERWRITE,
        },
        outputs=(Output("POINTS", "number", "Number of points", item("figures", "points")),),
        opens=True,
        layers=lambda answer: [answer["output"]],
        layer_group="Clean point cloud",
    ),
    Algorithm(
        "colour",
        "Colour a point cloud by images",
        "surfaces",
        "Writes a LAS, LAZ or COPC point cloud of any source in the colours of the images of a session. Each point "
        "takes the colour of the best image that sees it; points that no image sees are black.",
        basic={
            "cloud": parameter("CLOUD", "Point cloud", "LAS, LAZ or COPC file.", layers="cloud"),
            "session": parameter(
                "SESSION",
                "Session file",
                "Its [camera] names the images; GNSS and IMU give their poses. The scans are not read.",
                filter="TOML (*.toml)",
            ),
            "--output": parameter(
                "OUTPUT", "Coloured point cloud", required=True, filter="COPC point cloud (*.copc.laz)"
            ),
        },
        advanced=OVERWRITE,
        outputs=numbers(COLOUR_FIGURES, "figures"),
        opens=True,
        layers=lambda answer: [answer["output"]],
        layer_group="Coloured point cloud",
    ),
    Algorithm(
        "features",
        "Features of point clouds",
        "surfaces",
        "Classifies LAS, LAZ or COPC point clouds of any source by the shape and colour around each point: ground, "
        "horizontal and vertical planes, lines, vegetation. Writes the classified cloud, and layers of planes (roofs, "
        "walls), lines (poles, wires, fences) and plants. Memory use does not depend on the size of the area.",
        basic={
            "clouds": parameter(
                "CLOUDS", "Point clouds", "LAS, LAZ or COPC files; they are used together.", layers="cloud"
            ),
            "--ground-method": parameter("GROUND", "Ground classification"),
            "--output": parameter("OUTPUT", "Output folder"),
        },
        advanced={
            **CLOUDS,
            "--voxel": parameter("VOXEL", "Voxel size"),
            "--dst-crs": parameter("DST_CRS", "CRS of the output"),
            **OVERWRITE,
        },
        outputs=(
            Output("FOLDER", "folder", "Output folder", item("folder")),
            Output("CLOUD", "file", "Classified point cloud", product("cloud.copc.laz")),
            Output("FEATURES", "file", "Features (GeoPackage)", product("features.gpkg")),
            *numbers(FEATURE_FIGURES, "figures"),
        ),
        opens=True,
        layers=features_written,
    ),
    Algorithm(
        "fields",
        "Worked ground from task data (ISOXML)",
        "exchange",
        "Computes the ground that a machine worked in each field from its ISO 11783-10 task data, without a scanner: "
        "passes, overlaps, missed strips and their areas.",
        basic={
            "taskdata": parameter(
                "TASKDATA", "Task data", "TASKDATA.XML in its folder, or a .zip of the folder.", folder_of="*.xml"
            ),
            "--width": parameter("WIDTH", "Working width"),
            "--output": parameter("OUTPUT", "Worked ground", filter="GeoPackage (*.gpkg)", required=True),
        },
        advanced={"--task": parameter("TASK", "Task"), "--crs": parameter("CRS", "CRS of the output"), **OVERWRITE},
        outputs=(
            Output("FIELDS", "text", "Figures by field (JSON)", lambda answer: as_json(answer["fields"])),
            Output(
                "WORKED_AREA_M2",
                "number",
                "worked_area_m2",
                lambda answer: sum(each["worked_area_m2"] or 0.0 for each in answer["fields"]),
            ),
        ),
        opens=True,
        layers=lambda answer: [answer["output"]],
        layer_group="Worked ground",
    ),
    Algorithm(
        "plots",
        "Lay out the plots of a trial",
        "crops",
        "Makes the plots of a trial as a grid of rectangles with identifiers and blocks. Click the outer corner of the "
        "first plot, and the other end of the first row.",
        basic={
            "--corner": parameter("CORNER", "First corner"),
            "--end": parameter("END", "End of the first row"),
            "--rows": parameter("ROWS", "Rows"),
            "--columns": parameter("COLUMNS", "Columns"),
            "--length": parameter("LENGTH", "Length of a plot"),
            "--width": parameter("WIDTH", "Width of a plot"),
            "--alley": parameter("ALLEY", "Alley"),
            "--path": parameter("PATH", "Path"),
            "--side": parameter("SIDE", "Side"),
            "--numbering": parameter("NUMBERING", "Numbering"),
            "--along": parameter("ALONG", "Numbers along"),
            "--blocks": parameter("BLOCKS", "Blocks"),
            "--crs": parameter("CRS", "CRS of the output"),
            "--output": parameter("OUTPUT", "Plots", filter="GeoPackage (*.gpkg);;GeoJSON (*.geojson)", required=True),
        },
        advanced={
            "--azimuth": parameter(
                "AZIMUTH", "Azimuth", "Instead of the end of the first row: its direction from north."
            ),
            "--first": parameter("FIRST", "First number"),
            "--block-size": parameter("BLOCK_SIZE", "Rows or columns of a block"),
            "--by-block": parameter("BY_BLOCK", "Number each block anew"),
            **OVERWRITE,
        },
        outputs=(Output("PLOTS", "number", "plots", item("plots")),),
        opens=True,
        layers=lambda answer: [answer["output"]],
        layer_group="Plots",
    ),
    Algorithm(
        "response",
        "Analyse the response of a trial",
        "crops",
        "Fits the logistic response of crop heights to a dose, finds the dose beyond which nothing is gained, analyses "
        "the variance by treatment and block, and computes growth where there are tables of several days. Writes "
        "charts, a table and response.json.",
        basic={
            "tables": parameter(
                "TABLES", "Tables of parcels", "parcels.csv of runs, one for each day.", layers="table"
            ),
            "--treatments": parameter("TREATMENTS", "Treatments", kind="file", layers="table"),
            "--day": parameter("DAYS", "Days of the flights", "One per line, in the order of the tables: 2017-05-23."),
            "--output": parameter("OUTPUT", "Output folder", required=True),
        },
        advanced={
            "--dose": parameter("DOSE", "Column of the dose"),
            "--measure": parameter("MEASURE", "Column of the measure"),
            **OVERWRITE,
        },
        outputs=(
            Output("CHART", "file", "Chart of the response", product("response.svg")),
            FINDINGS,
        ),
    ),
    Algorithm(
        "export",
        "Export results",
        "exchange",
        "Converts the results of a run: GeoPackage, GeoParquet, FlatGeobuf, GeoJSON, Shapefile, KML, CSV, ISO 11783-10 "
        "task data for farm software and terminals, or a STAC catalogue of many runs. GeoJSON and KML are always in "
        "WGS 84.",
        basic={
            "results": RESULTS,
            "--to": parameter(
                "FORMAT",
                "Format",
                "isoxml writes task data into a folder, or into a .zip if the output's name ends in .zip. Only stac "
                "accepts several results.",
            ),
            "--output": parameter(
                "TARGET",
                "Output file or folder",
                "By default beside the results. Formats with one layer per file need a folder.",
            ),
        },
        advanced={
            "--layer": parameter("LAYERS", "Layers", "By default all layers.", kind="choices", choices=LAYERS),
            "--dst-crs": parameter("DST_CRS", "CRS of the vectors"),
            **OVERWRITE,
        },
        outputs=(
            Output("WRITTEN", "text", "File or folder written", item("target")),
            Output("FILES", "layers", "Files written", item("files")),
        ),
    ),
    Algorithm(
        "share",
        "Share a result",
        "exchange",
        "Writes the result of a run as a folder for people without a GIS: a web page with map, layers, figures, point "
        "cloud in three dimensions and measuring, which opens from disk and needs no network; or a project for QField.",
        basic={
            "result": parameter(
                "RESULT",
                "Result of a run",
                "The report.json of the run; it stands for the folder of the run.",
                folder_of="*",
            ),
            "--qfield": parameter("QFIELD", "A project for QField instead of a web page"),
            "--output": parameter("OUTPUT", "Output folder", required=True),
        },
        advanced=OVERWRITE,
        outputs=(
            Output("START", "file", "File to open", item("start")),
            Output("FILES", "layers", "Files written", item("files")),
        ),
    ),
    Algorithm(
        "farm add",
        "Add results to the farm map",
        "farm",
        "Adds the results of runs to a farm map, a GeoPackage or a PostGIS database, which is created if it does not "
        "exist. Sessions that the farm map contains are replaced by the new result. If one of them fails, nothing is "
        "changed.",
        basic={
            "folders": RESULTS,
            "target": parameter(
                "FARM_MAP",
                "Farm map (GeoPackage)",
                "The farm's GeoPackage.",
                kind="new file",
                filter="GeoPackage (*.gpkg)",
                required=False,
                adds=True,
            )
            + DATABASE,
        },
        advanced={
            **SCHEMA,
            "--crs": parameter("CRS", "CRS of a new farm map"),
            "--same-crs": parameter("SAME_CRS", "Refuse sessions in another CRS"),
            "--time-zone": parameter("TIME_ZONE", "Time zone"),
            "--season-start": parameter("SEASON_START", "First day of a season (MM-DD)"),
        },
        outputs=(
            *(Output(name.upper(), "number", name, count(name)) for name in ("added", "replaced", "unchanged")),
            Output("SESSIONS", "number", "sessions", item("sessions")),
        ),
        opens=True,
        layers=lambda answer: [answer["farm_map"]] if Path(answer["farm_map"]).is_file() else [],
        layer_group="Farm map",
    ),
    Algorithm(
        "tie",
        "Change between dates of one field",
        "farm",
        "Ties the results of one field to each other by the ground that no tool touched in between, in height, tilt "
        "and place, and measures the soil moved from each date to the next, with standard deviations.",
        basic={
            "results": RESULTS,
            "--reference": parameter(
                "REFERENCE",
                "Surveyed surface or points",
                "The dates are moved onto it: GeoTIFF, or CSV or GeoPackage of points.",
                kind="file",
                filter="Surfaces and points (*.tif *.tiff *.csv *.txt *.tsv *.gpkg)",
            ),
            "--reference-sigma": parameter("REFERENCE_SIGMA", "Standard deviation of its heights"),
            "--output": parameter("OUTPUT", "Output folder"),
        },
        advanced=OVERWRITE,
        outputs=(
            Output("FOLDER", "folder", "Output folder", item("folder")),
            Output("TIES", "file", "Ties", product("tie.gpkg")),
            Output("PAGE", "file", "Page", product("tie.html")),
            Output("CHANGES", "number", "Number of changes", count("changes")),
        ),
        opens=True,
        layers=lambda answer: [str(Path(answer["folder"], row["raster"])) for row in answer["changes"]],
        layer_group="Change between dates",
    ),
    Algorithm(
        "farm list",
        "List the sessions of the farm map",
        "farm",
        "Lists the sessions of a farm map: identifier, date, worked area, name.",
        basic={"target": FARM_MAP},
        advanced=SCHEMA,
        outputs=(
            Output("SESSIONS", "text", "Sessions (JSON)", lambda answer: as_json(answer["sessions"])),
            Output("COUNT", "number", "Number of sessions", count("sessions")),
        ),
    ),
    Algorithm(
        "farm remove",
        "Remove sessions from the farm map",
        "farm",
        "Removes sessions from a farm map. The folders of their results are not touched.",
        basic={
            "target": FARM_MAP,
            "sessions": parameter(
                "SESSION", "Sessions", "One per line: the identifier, the beginning of it, or the name."
            ),
        },
        advanced=SCHEMA,
        outputs=(
            Output("REMOVED", "number", "Number of sessions removed", count("removed")),
            Output("SESSIONS", "number", "Number of sessions left", item("sessions")),
        ),
    ),
    Algorithm(
        "farm mosaic",
        "Mosaic of the farm map's surfaces",
        "farm",
        "Combines the surfaces of a farm map's sessions into one raster. Where they overlap, the latest session is "
        "used. A .vrt is a small file that refers to the surfaces; a .tif is a cloud-optimised GeoTIFF with all bands.",
        basic={
            "sources": FARM_MAP,
            "--product": parameter(
                "PRODUCT",
                "Surface",
                "dsm: after the work; dsm_before: before it; change: the difference.",
                kind="choice",
                choices=("dsm", "dsm_before", "change"),
            ),
            "--output": parameter("OUTPUT", "Mosaic", kind="new raster"),
        },
        advanced={
            **SCHEMA,
            "--dst-crs": parameter("DST_CRS", "CRS of the mosaic"),
            "--cell": parameter("CELL", "Cell size"),
            "--mean": parameter("MEAN", "Mean of all sessions"),
            **OVERWRITE,
        },
        outputs=(Output("SURFACES", "number", "Number of surfaces", item("surfaces")),),
    ),
    Algorithm(
        "farm fields",
        "Fields, seasons and machines of the farm map",
        "farm",
        "Lists the work of each field and season in a farm map, and that of each machine.",
        basic={"target": FARM_MAP},
        advanced=SCHEMA,
        outputs=(
            Output("FIELDS", "text", "Fields (JSON)", lambda answer: as_json(answer["fields"])),
            Output("SEASONS", "text", "Seasons of fields (JSON)", lambda answer: as_json(answer["seasons"])),
            Output("MACHINES", "text", "Machines (JSON)", lambda answer: as_json(answer["machines"])),
        ),
    ),
    Algorithm(
        "farm history",
        "History of a field",
        "farm",
        "Writes all sessions of a field in a farm map as a page with a map, or as a table (CSV).",
        basic={
            "target": FARM_MAP,
            "field": parameter("FIELD", "Field", "Its name or identifier."),
            "--output": parameter("OUTPUT", "Page or table", filter="HTML (*.html);;CSV (*.csv)"),
        },
        advanced={**SCHEMA, **OVERWRITE},
        outputs=(Output("SESSIONS", "number", "Number of sessions", count("visits")),),
    ),
    Algorithm(
        "farm traffic",
        "Traffic: how often each spot was worked and driven on",
        "farm",
        "Counts how often each spot was worked, when last, and how often rear wheels passed it, from the sessions of a "
        "farm map. Wheels are counted where both widths are given.",
        basic={
            "target": FARM_MAP,
            "--season": parameter("SEASON", "Season", "The year in which it begins; all seasons by default."),
            "--track-width": parameter(
                "TRACK_WIDTH", "Track width", "Between the middles of the rear tyres, in metres."
            ),
            "--tyre-width": parameter("TYRE_WIDTH", "Tyre width", "Of a rear tyre, in metres."),
            "--output": parameter("OUTPUT", "Traffic", kind="new raster"),
        },
        advanced={
            **SCHEMA,
            "--since": parameter("SINCE", "First day"),
            "--until": parameter("UNTIL", "Last day"),
            "--cell": parameter("CELL", "Cell size"),
            **OVERWRITE,
        },
        outputs=(Output("PASSES", "number", "Number of passes", item("passes")),),
    ),
    Algorithm(
        "crs",
        "Coordinate transformations of a session",
        "accuracy",
        "Reports what a run would do with the coordinates of a session, with figures for the site: reference frame and "
        "epoch, size of the shift, geoid height, grid convergence and scale factor. Nothing is written.",
        basic=SESSION,
        outputs=(FINDINGS,),
    ),
    Algorithm(
        "frames",
        "Frames of a session",
        "session",
        "Shows the frames of a session: earth, map, vehicle, and each sensor with its place, its angles and the "
        "directions of its axes in words. A drawing shows them from the side and from above. The recordings are not "
        "read.",
        basic={**SESSION, "--svg": parameter("DRAWING", "Drawing", filter="SVG (*.svg)")},
        outputs=(FINDINGS,),
    ),
    Algorithm(
        "gnss solve",
        "Positions from RINEX files",
        "accuracy",
        "Computes the positions of a rover relative to a base station from RINEX files, with RTKLIB's program "
        "rnx2rtkp, which has to be installed. A session names the result as its GNSS log.",
        basic={
            "rover": parameter("ROVER", "Rover (RINEX)", "Observations of the rover."),
            "base": parameter("BASE", "Base station (RINEX)", "Observations of the base station at the same time."),
            "nav": parameter("NAVIGATION", "Ephemerides (RINEX)", "Navigation files of the same day."),
            "--base-position": parameter(
                "POSITION",
                "Position of the base station",
                "Latitude, longitude and height above the ellipsoid of its antenna, separated by commas; by default "
                "approximate, from its file.",
                kind="numbers",
                count=3,
            ),
            "--static": parameter("STATIC", "The rover stands still"),
            "--output": parameter("OUTPUT", "Positions", filter="RTKLIB solution (*.pos)"),
        },
        advanced={"--mask": parameter("MASK", "Elevation mask"), **OVERWRITE},
        outputs=(
            Output("EPOCHS", "number", "Epochs", item("epochs")),
            FINDINGS,
        ),
    ),
    Algorithm(
        "gnss evaluate",
        "Evaluate GNSS logs",
        "accuracy",
        "Compares the positions of GNSS logs with a reference at the same epochs: mean, standard deviation and RMSE "
        "in 3D, 2D, X, Y and Z, for all epochs and by fix type. Several services are compared in one table, and their "
        "tracks and errors become layers.",
        basic={
            "test": parameter("TEST", "Logs to evaluate", "NMEA, or other logs that 'Inspect recordings' reads."),
            "--reference": parameter(
                "REFERENCE",
                "Reference log",
                "Another log of the same drive, or a trajectory.",
                kind="file",
                required=False,
            )
            + parameter(
                "POINT",
                "Known point",
                "Of a static antenna, instead of a log: latitude, longitude, height, separated by commas.",
                kind="numbers",
                count=3,
                required=False,
            ),
            "--name": parameter(
                "NAMES", "Names", "Of the services in the tables: one per line, in the order of the logs."
            ),
            "--output": parameter("OUTPUT", "Output folder"),
        },
        advanced={
            "--antenna-offset": parameter(
                "OFFSET",
                "Antenna offset (m)",
                "Forward,left,up: from the antenna of the reference to that of the log, on the same vehicle. One line "
                "for all logs, or one for each.",
            ),
            "--reference-fix": parameter("REFERENCE_FIX", "Epochs of the reference"),
            "--max-gap": parameter("MAX_GAP", "Maximum interpolation gap"),
            "--date": parameter("DATE", "Date of the first position"),
            **OVERWRITE,
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
        opens=True,
        layers=lambda answer: [str(Path(answer["output"]) / "evaluation.gpkg")] if answer["output"] else [],
    ),
    Algorithm(
        "check",
        "Check against surveyed points",
        "accuracy",
        "Compares a point cloud or a surface with surveyed points. The RMSE follows the ASPRS Positional Accuracy "
        "Standards, Edition 2 (2023), and includes the accuracy of the points.",
        basic={
            "product": parameter(
                "PRODUCT", "Point cloud or surface", "LAS, LAZ, COPC or GeoTIFF.", layers="raster or cloud"
            ),
            "points": parameter("POINTS", "Surveyed points", "CSV or GeoPackage.", layers="points"),
            "--points-sigma": parameter("SIGMA", "Standard deviation of the survey"),
            "--require-vertical": parameter("VERTICAL", "Required vertical RMSE", MET),
            "--require-horizontal": parameter("HORIZONTAL", "Required horizontal RMSE", MET),
            "--table": parameter("TABLE", "Table of errors", filter="CSV (*.csv)"),
        },
        advanced={
            "--crs": parameter("CRS", "CRS of the points"),
            "--within": WITHIN,
            "--targets": parameter("TARGETS", "Disc targets"),
            "--diameter": parameter("DIAMETER", "Diameter of the discs"),
            **OVERWRITE,
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
