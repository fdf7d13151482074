"""What commands write for people: every figure behind its own name, in the unit that is named, with its sign."""

from __future__ import annotations

import datetime as dt
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pyproj import CRS

from furrowmap.cli import batch_commands as batch
from furrowmap.cli import calibrate_commands as calibrate
from furrowmap.cli import clouds_commands as clouds
from furrowmap.cli import crops_commands as crops
from furrowmap.cli import farm_commands as farm
from furrowmap.cli import fields_commands as fields
from furrowmap.cli import gnss_commands as gnss
from furrowmap.cli import session_commands as session
from furrowmap.cli.result_tables import MAX_PARCELS, file_size, parcel_table
from furrowmap.core.accuracy.evaluation import Age, Continuity, ErrorStatistics
from furrowmap.core.accuracy.paired_points import PairedPoints
from furrowmap.core.accuracy.point_check import InternalPrecision
from furrowmap.core.accuracy.product_check import Accuracy, Check, Component
from furrowmap.core.values.machine import Calibrated, Machine, MachineCamera, MachineImplement, MachineImu
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.session import Antenna, Lidar
from furrowmap.workflows.batch.batch import Batch
from furrowmap.workflows.calibrate.calibrate import Calibration
from furrowmap.workflows.farm.farm import FarmMapChange
from furrowmap.workflows.farm.farm_memory import FarmMemory
from furrowmap.workflows.session.known_machines import KnownMachine

STATED = Mounting((-0.61, 0.02, 2.43), (0.04, 40.05, 180.06))
FOUND = Calibration(
    stated=STATED,
    found=Mounting((-0.62, 0.03, 2.44), (0.51, 39.52, 180.53)),
    sigma_deg=(0.11, 0.12, math.inf),
    facing_shown=True,
    height_m=(-0.021, 0.013),
    stated_offset_s=0.104,
    offset_s=(0.255, 0.006),
    clock_differs=True,
    date=dt.date(2026, 6, 11),
)


def rows_of(text: str) -> dict[str, str]:
    """Name and value of each line of a table of two columns."""
    cells = [line.strip().split("  ", 1) for line in text.splitlines() if "  " in line.strip()]
    return {name: value.strip() for name, value in cells}


def test_calibration__is_told_beside_what_the_session_states() -> None:
    text = calibrate._words(FOUND, None, written=False)
    assert rows_of(text) == {
        "scanner rpy_deg, stated": "0.04, 40.05, 180.06",
        "scanner rpy_deg, estimated": "0.51, 39.52, 180.53",
        "sigma of roll, pitch, yaw": "0.11, 0.12, inf",
        "scanner xyz_m, estimated": "-0.620 m, 0.030 m, 2.440 m",
        "facing of the scanner": "shown by the scans",
        "vehicle origin above ground": "-0.021 ± 0.026 m (95 %)",
        "lidar_minus_gnss_s, stated": "0.104",
        "lidar_minus_gnss_s, estimated": "0.255 ± 0.012 s (95 %)",
    }
    assert text.splitlines()[-1] == "The session file was not changed."


def test_calibration__that_shows_nothing_new_says_so() -> None:
    nothing = replace(
        FOUND, found=STATED, facing_shown=False, clock_differs=False, height_m=(math.nan, math.inf), offset_s=(0.2, 0.1)
    )
    rows = rows_of(calibrate._words(nothing, None, written=False))
    assert {name for name, value in rows.items() if value == "unchanged"} == {
        "scanner rpy_deg, estimated",
        "scanner xyz_m, estimated",
        "lidar_minus_gnss_s, estimated",
    }
    assert rows["vehicle origin above ground"] == "not shown"
    assert rows["facing of the scanner"].startswith("not determined")
    turned = replace(nothing, found=Mounting(STATED.xyz_m, FOUND.found.rpy_deg))
    rows = rows_of(calibrate._words(turned, None, written=False))
    assert (rows["scanner rpy_deg, estimated"], rows["scanner xyz_m, estimated"]) == (
        "0.51, 39.52, 180.53",
        "unchanged",
    )


@pytest.mark.parametrize(
    ("name", "written", "end"),
    [
        (None, True, ["Written to the session file."]),
        ("T\x1b1", False, ["The session file was not changed.", "The mounting was written to the machine T\\x1b1."]),
        ("T1", True, ["Written to the session file.", "The mounting was written to the machine T1."]),
    ],
)
def test_calibration__says_what_it_has_written(name: str | None, written: bool, end: list[str]) -> None:
    assert calibrate._words(FOUND, name, written=written).splitlines()[8:] == end


def test_check__tells_each_figure_under_its_name_and_the_five_largest_errors() -> None:
    accuracy = Accuracy(
        vertical=Component(7, -0.011, 0.012, 0.013, 0.014, 0.015, 0.016, 0.017, 0.018),
        easting=Component(3, 0.021, 0.022, 0.023, 0.024, 0.03, 0.026, 0.027, 0.028),
        northing=Component(3, 0.031, 0.032, 0.033, 0.034, 0.04, 0.036, 0.037, 0.038),
        precision=InternalPrecision(0.041, 0.042, 0.043, 0.044, 5, "times"),
    )
    errors_m = [0.01, -0.06, None, 0.05, -0.02, 0.03, 0.04]
    rows = [{"name": f"P{k}", "error_h_m": error_m} for k, error_m in enumerate(errors_m)]
    found = Check("cloud", CRS.from_epsg(6677), (), accuracy, ())
    told = rows_of(clouds._check_words(found, rows, accuracy.precision.verdicts(0.055)))
    assert told == {
        "product": f"cloud, {CRS.from_epsg(6677).name}",
        "height": "7 points: mean -0.0110 m, standard deviation 0.0120 m, RMSE 0.0150 m, 95 % within 0.0170 m, "
        "maximum 0.0180 m",
        "easting": "3 points: mean +0.0210 m, standard deviation 0.0220 m, RMSE 0.0300 m, 95 % within 0.0270 m, "
        "maximum 0.0280 m",
        "northing": "3 points: mean +0.0310 m, standard deviation 0.0320 m, RMSE 0.0400 m, 95 % within 0.0370 m, "
        "maximum 0.0380 m",
        "RMSE vertical": "0.0150 m",
        "RMSE horizontal": "0.0500 m",
        "RMSE 3D": "0.0522 m",  # of (3, 4, 1.5) cm
        "within swath": "0.0410 m",
        "within swath, maximum": "0.0420 m (outside the class limit of 0.033 m)",
        "between swaths": "0.0430 m (within the class limit of 0.044 m)",
        "between swaths, maximum": "0.0440 m (within the class limit of 0.088 m)",
        "largest errors": "P1 -0.060 m, P3 +0.050 m, P6 +0.040 m, P5 +0.030 m, P4 -0.020 m",
    }


def test_check__leaves_out_what_is_not_known() -> None:
    unknown = InternalPrecision(math.nan, math.nan, math.nan, math.nan, 0, "nothing")
    vertical = Component(1, 0.01, math.nan, 0.01, math.nan, 0.01, 0.01, 0.01, 0.01)
    found = Check("surface", CRS.from_epsg(6677), (), Accuracy(vertical, None, None, unknown), ())
    told = rows_of(clouds._check_words(found, [{"name": "A", "error_h_m": 0.01}], {}))
    assert list(told) == ["product", "height", "RMSE vertical", "largest errors"]


@pytest.mark.parametrize(
    ("vertical_m", "horizontal_m", "required", "met"),
    [
        (0.02, 0.05, (0.02, 0.049), {"vertical": True, "horizontal": False}),
        (0.021, 0.05, (0.02, 0.05), {"vertical": False, "horizontal": True}),
        (0.021, 0.05, (None, 0.05), {"horizontal": True}),
        (0.01, None, (0.02, 0.05), {"vertical": True, "horizontal": False}),
        (0.01, None, (None, None), {}),
    ],
)
def test_verdicts__are_those_of_the_accuracies_asked_for(
    vertical_m: float, horizontal_m: float | None, required: tuple[float | None, float | None], met: dict[str, bool]
) -> None:
    verdicts = clouds._verdicts(vertical_m, horizontal_m, required)
    assert {name: verdict["met"] for name, verdict in verdicts.items()} == met
    for name, verdict in verdicts.items():
        rmse_m, required_m = (vertical_m, required[0]) if name == "vertical" else (horizontal_m, required[1])
        assert (verdict["rmse_m"], verdict["required_m"]) == (rmse_m, required_m)


def test_pairs__are_measured_less_surveyed_by_axis() -> None:
    measured, surveyed = (
        np.array([[1.5, 2.0, 3.0], [1.0, 2.0, math.nan]]),
        np.array([[1.0, 2.25, 2.0], [0.0, 2.0, 9.0]]),
    )
    lines = clouds._pair_words(PairedPoints(("A", "B"), measured, surveyed, ("C", "D"))).splitlines()
    assert [line.split() for line in lines[1:]] == [
        ["A", "+0.5000", "-0.2500", "+1.0000"],
        ["B", "+1.0000", "+0.0000", "—"],
        ["mean", "+0.7500", "-0.1250", "+1.0000"],
        ["RMS", "0.7906", "0.1768", "1.0000"],
        ["not", "paired", "C,", "D"],
    ]
    assert lines[0].split()[:3] == ["X", "Y", "Z"]


@pytest.mark.parametrize(
    ("date", "words"),
    [
        ({"tied": False}, "not tied"),
        (
            {
                "tied": True, "east_m": 0.0011, "north_m": -0.0022, "height_m": 0.0033, "tilt_east_deg": 0.0044,
                "tilt_north_deg": -0.0055,
            },
            "moved +1.1 mm east, -2.2 mm north, +3.3 mm up, tilted +0.0044° east, -0.0055° north",
        ),
    ],
)  # fmt: skip
def test_tie__tells_the_move_of_a_date(date: dict[str, Any], words: str) -> None:
    assert batch._move(date) == words


def test_tie__tells_dates_changes_and_files(tmp_path: Path) -> None:
    (tmp_path / "tie.gpkg").write_bytes(bytes(1200))
    change = {"volume_m3": -1.5, "volume_sigma_m3": 0.25, "worked_m2": 120.0, "mean_change_m": -0.0125}
    account = {
        "dates": [{"date": "2026-06-11", "name": "Nord\x1b", "tied": False}],
        "changes": [
            {"date_a": 1, "date_b": 3, "mean_change_sigma_m": 0.0021, **change},
            {"date_a": 3, "date_b": 4, "volume_m3": None},
        ],
        "products": ["tie.gpkg"],
    }
    assert batch._tie_words(account, tmp_path).splitlines() == [
        "  2026-06-11 Nord\\x1b  not tied",
        "  1 to 3  -1.50 ± 0.50 m³ on 120.0 m², mean -12.5 ± 4.2 mm (95 %)",
        "  3 to 4  no worked ground seen on both dates",
        f"{tmp_path}:",
        "  tie.gpkg  1.2 kB",
    ]


@pytest.mark.parametrize(
    ("size_bytes", "words"), [(99_999, "100.0 kB"), (100_000, "0.1 MB"), (1_234_567_890, "1,234.6 MB")]
)
def test_size_of_a_file__has_its_unit(size_bytes: int, words: str, tmp_path: Path) -> None:
    with (tmp_path / "file").open("wb") as file:
        file.truncate(size_bytes)
    assert file_size(tmp_path / "file") == words


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (None, "reference"),
        ({"offset_m": -0.0012, "offset_sigma_m": 0.0034, "tilted": False}, "soil -1.2 ± 6.8 mm (95 %)"),
        (
            {"offset_m": 0.012, "offset_sigma_m": 0.0034, "tilted": True, "tilt_east": 1.2e-4, "tilt_north": -3.4e-5},
            "soil +12.0 ± 6.8 mm (95 %), tilt +1.2e-04 east, -3.4e-05 north",
        ),
    ],
)
def test_growth__tells_how_a_flight_was_aligned(found: dict[str, Any] | None, words: str) -> None:
    assert crops._alignment({"alignment": found}) == words


def test_response__tells_the_shapes_and_the_analysis_of_each_flight() -> None:
    optimum = {"value": 199.4, "low": 173.1, "high": 260.0, "low_open": False, "high_open": True}
    shape = {"name": "quadratic", "weight": 0.814, "r2": 0.7391, "lack_of_fit_p": 0.5798, "economic": optimum}
    other = {**shape, "name": "linear", "weight": 0.186, "lack_of_fit_p": None, "economic": None}
    other["agronomic"] = {**optimum, "low_open": True, "high_open": False}
    source = [{"source": "dose", "f": 4.256, "p": 0.0213, "freedom": 3}, {"source": "rest", "f": None}]
    means = [{"treatment": "N60", "mean": 5.25, "low": 4.5, "high": 6.0, "letters": "a"}]
    bare = {"sentences": ["No response shown: 12 %."], "variance": None, "parcels": 3, "day": None}
    part = {"by": "site", "label": "Jackson", "sentences": ["Nothing.", "Else."]}
    full = {"sentences": ["A curve.", "Another 1.5 t."], "models": [shape, other], "parts": [part], "parcels": 12}
    full |= {"variance": {"rows": source, "means": means}, "day": "2026-06-11"}
    account = {"flights": [full, bare], "products": ["response.csv", "response.json"]}
    assert crops._response_words(account, Path("out")).splitlines() == [
        "12 parcels, 2026-06-11",
        "  A curve.",
        "  Another 1.5 t.",
        "shape      weight     R²  lack of fit      optimum (95 %)",
        "quadratic    81 %  0.739     p = 0.58  199 (173 to above)",
        "linear       19 %  0.739                     199 (to 260)",
        "  Jackson: Nothing. Else.",
        "  F of dose  4.26 (p = 0.021, 3 degrees of freedom)",
        "mean of            95 %  letters",
        "N60      5.25  4.5 to 6        a",
        "3 parcels",
        "  No response shown: 12 %.",
        "Written to out: response.csv, response.json",
    ]


def statistics(base: float) -> ErrorStatistics:
    return ErrorStatistics(
        12_345, base + 0.1, base + 0.2, base + 0.3, tuple(base + 0.01 * k for k in range(5)), base + 0.4
    )


def log_of(first_by_fix_s: dict[str, float], age: Age | None) -> Continuity:
    shares = {"fixed": 0.912, "float": 0.088}
    return Continuity(54_321, 0.0, 9.0, 0.1, 0.9, shares, first_by_fix_s, 4, 5.25, 6.5, (), age)


def test_evaluation__tells_each_figure_under_its_name() -> None:
    table = {axis: statistics(k) for k, axis in enumerate(("3D", "2D", "X", "Y", "Z", "along"))}
    table["across"] = ErrorStatistics(0, *[math.nan] * 3, (math.nan,) * 5, math.nan)
    found: Any = SimpleNamespace(
        test="walk.pos", service="MADOCA", reference="base.pos", reference_service="", matched=range(12_345),
        tables={"all": table}, outlier=np.arange(8) == 3, within_sigmas={"1": 0.61, "2": 0.92, "3": 0.99},
        time_ahead_s=(-0.012, 0.003), continuity=log_of({"fixed": 31.5, "float": 2.0}, Age(7, 1.5, 2.5, 3.5)),
    )  # fmt: skip
    head, rows, figures = gnss._words("A", found).split("\n\n")
    assert head == "A:"
    assert rows_of(rows) == {
        "test": "walk.pos (MADOCA)",
        "reference": "base.pos",
        "compared": "12,345 of 54,321 positions",
        "fix types": "fixed 91.2%, float 8.8%",
        "first fix": "fixed after 31.5 s, float after 2.0 s",
        "gaps": "4, longest 5.2 s",
        "outliers": "1 (12.5%)",
        "age of corrections": "median 1.5 s, maximum 3.5 s",
        "within 1, 2, 3 reported sigmas": "61.0%, 92.0%, 99.0%",
        "test ahead in time": "-0.0120 ± 0.0060 s (95 %)",
    }
    lines = figures.splitlines()
    assert lines[0] == "all (12,345 epochs)"
    assert lines[1].split() == ["3D", "2D", "X", "Y", "Z", "along"]  # nothing is known across
    for line, plus in zip(lines[2:], (0.1, 0.2, 0.3, 0.03, 0.4), strict=True):  # the 95th percentile is the fourth
        assert [float(value) for value in line.split()[-6:]] == pytest.approx([k + plus for k in range(6)])
    assert [line[2:22].strip() for line in lines[2:]] == [
        "average",
        "standard deviation",
        "RMSE",
        "95th percentile",
        "maximum",
    ]


def test_services__are_beside_each_other_in_one_table() -> None:
    def service(base: float) -> Any:
        rows = {axis: statistics(base + k) for k, axis in enumerate(("3D", "2D", "X", "Y", "Z"))}
        rows["Z"] = replace(rows["Z"], standard_deviation_m=math.nan)
        return SimpleNamespace(tables={"all": rows})

    lines = gnss._services({"nanosat": service(0.0), "SLAS": service(10.0)}).splitlines()
    assert lines[0].replace(" [m]", "").split() == ["3D", "2D", "X", "Y", "Z"]
    assert [line[:28].split() for line in lines[1:]] == [
        ["nanosat", "average"], ["standard", "deviation"], ["RMSE"], ["SLAS", "average"], ["standard", "deviation"],
        ["RMSE"],
    ]  # fmt: skip
    for number, line in enumerate(lines[1:]):
        base, plus = 10.0 * (number // 3), 0.1 * (1 + number % 3)
        expected = [f"{base + k + plus:.4f}" for k in range(5)]
        assert line[28:].split() == [*expected[:4], "–" if number % 3 == 1 else expected[4]]


@pytest.mark.parametrize(
    ("length_s", "words"), [(119.4, "119 s"), (120.0, "0 h 02 min"), (3_570.0, "1 h 00 min"), (7_500.0, "2 h 05 min")]
)
def test_duration__is_in_seconds_then_in_hours_and_minutes(length_s: float, words: str) -> None:
    assert rows_of(batch._planned(Batch("out", estimate_s=length_s)))["expected duration"] == words


def test_plan_of_a_batch__names_the_first_twenty() -> None:
    names = tuple(f"field {k}" for k in range(23))
    lines = batch._planned(Batch("out", run=names, unchanged=("a", "b"), estimate_s=1.0)).splitlines()
    assert rows_of("\n".join(lines[:3])) == {"sessions to run": "23", "unchanged": "2", "expected duration": "1 s"}
    assert lines[3:] == [*(f"  {name}" for name in names[:20]), "  … 3 more"]
    assert batch._planned(Batch("out", run=names[:20])).splitlines()[3:] == [f"  {name}" for name in names[:20]]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (FarmMapChange("f.gpkg", "EPSG:6677", sessions=1), "f.gpkg: nothing changed; now 1 session in EPSG:6677."),
        (
            FarmMapChange("f.gpkg", "EPSG:6677", ("a",), ("b", "c"), ("d", "e", "f"), ("g",) * 4, 7),
            "f.gpkg: 1 added, 2 replaced, 3 unchanged, 4 removed; now 7 sessions in EPSG:6677.",
        ),
    ],
)
def test_farm_map__tells_what_changed(change: FarmMapChange, words: str) -> None:
    assert farm._words(change) == words


def test_farm_map__tells_seasons_and_machines() -> None:
    season = {"season": "2026", "name": "Nord", "times_worked": 3, "worked_area_m2": 12_345.6}
    seasons = [
        {**season, "hours": 4.56, "work_rate_ha_h": 1.234},
        {**season, "worked_area_m2": None, "hours": None, "work_rate_ha_h": None},
    ]
    memory = FarmMemory("f.gpkg", [], seasons, [{"machine": "T1", "sessions": 5, "worked_area_m2": 678.0}])
    lines = [line.split() for line in farm._tables(memory).splitlines()]
    assert lines == [
        ["2026", "Nord", "3", "×", "12,346", "m²", "4.6", "h", "1.23", "ha/h"],
        ["2026", "Nord", "3", "×", "unknown", "unknown", "unknown"],
        [],
        ["T1", "5", "sessions", "678", "m²"],
    ]
    assert farm._tables(FarmMemory("f.gpkg", [], [], [])) == ""


def test_logged_fields__have_their_areas_in_hectares() -> None:
    keys = ("worked", "overlap", "missed", "logged_swept", "counted", "boundary")
    areas = {f"{key}_area_m2": 10_000.0 * (k + 1) + 1234.0 for k, key in enumerate(keys)}
    text = fields._table([{"task": "TSK1", "field": "N", "passes": 7, **areas, "missed_area_m2": None}])
    head, row = text.splitlines()
    assert row.split() == ["TSK1", "N", "7", "1.123", "2.123", "unknown", "4.123", "5.123", "6.123"]
    for name, value in (("worked ha", "1.123"), ("overlap ha", "2.123"), ("counter ha", "5.123"), ("passes", "7")):
        assert head.index(name) + len(name) == row.index(value) + len(value), name
    assert [head.index(name) for name in ("task", "field")] == [row.index(name) for name in ("TSK1", "N")]


MACHINE = Machine(
    antenna=Antenna(xyz_m=(0.0, 0.0, 1.0)),
    lidar=Lidar(xyz_m=(0.0, 0.0, 2.0)),
    imu=MachineImu(xyz_m=(0.0, 0.0, 1.0), rpy_deg=(0.0, 0.0, 0.0)),
    camera=MachineCamera(xyz_m=(0.0, 0.0, 1.0), rpy_deg=(0.0, 0.0, 0.0)),
    implement=MachineImplement(width_m=2.0, xy_m=(-1.0, 0.0)),
)


@pytest.mark.parametrize(
    ("profile", "words"),
    [
        (None, "not readable: m.toml"),
        (MACHINE, "antenna, lidar, imu, camera, implement"),
        (Machine(lidar=MACHINE.lidar), "lidar"),
        (
            Machine(
                antenna=MACHINE.antenna,
                calibrated=Calibrated(date=dt.date(2026, 6, 11), rpy_sigma_deg=(0.1, 0.1, 0.1)),
            ),
            "antenna, calibrated 2026-06-11",
        ),
    ],
)
def test_saved_machine__is_told_by_what_it_states(profile: Machine | None, words: str) -> None:
    assert session._machine_words(KnownMachine("M", Path("m.toml"), profile)) == words


def test_parcels__as_many_as_are_shown_have_no_rest() -> None:
    rows = [{"id": f"P{k}", "height_m": 1.0} for k in range(MAX_PARCELS)]
    assert len(parcel_table(rows, ["height_m"], "parcels.csv").splitlines()) == 1 + MAX_PARCELS
