"""The import package `furrowmap`: its names, and recordings and GNSS logs opened through it."""

from __future__ import annotations

import ast
import inspect
import re
import subprocess
import sys
from dataclasses import replace
from importlib.metadata import version
from types import FunctionType

import numpy as np
import pytest

import furrowmap

LIGHT = "import sys, furrowmap; print([name for name in ('numpy', 'numba', 'pandas', 'click') if name in sys.modules])"


def test_import__loads_no_other_library() -> None:
    done = subprocess.run([sys.executable, "-c", LIGHT], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_module__runs_the_command_line() -> None:
    done = subprocess.run([sys.executable, "-m", "furrowmap", "--version"], capture_output=True, text=True, check=True)
    assert version("furrowmap") in done.stdout


def test_version__is_that_of_the_distribution() -> None:
    assert furrowmap.__version__ == version("furrowmap")


@pytest.mark.parametrize("name", sorted(furrowmap.__all__))
def test_public_name__resolves(name: str) -> None:
    value = getattr(furrowmap, name)
    assert getattr(furrowmap, name) is value
    assert name in dir(furrowmap)
    assert value.__doc__
    if getattr(value, "__module__", "").startswith("furrowmap"):
        assert value.__name__ == name


def test_public_names__are_the_same_for_type_checkers() -> None:
    (listed,) = (node for node in ast.parse(inspect.getsource(furrowmap)).body if isinstance(node, ast.If))
    imported = {name.asname for node in listed.body if isinstance(node, ast.ImportFrom) for name in node.names}
    assert imported - {None} == set(furrowmap.__all__) - {"__version__"}


def test_public_functions__take_paths_as_str_and_as_path() -> None:
    functions = [value for name in furrowmap.__all__ if isinstance(value := getattr(furrowmap, name), FunctionType)]
    assert len(functions) > 20
    for function in functions:
        for name, parameter in inspect.signature(function).parameters.items():
            kinds = set(re.findall(r"\w+", str(parameter.annotation)))
            assert "Path" not in kinds or "str" in kinds, (function, name)


def test_unknown_name__raises_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'furrowmap' has no attribute 'plough'"):
        _ = furrowmap.plough


def test_recording__gives_its_scans(simulated: furrowmap.Simulated) -> None:
    figures = simulated.figures["lidar"]
    for path in (simulated.recording, str(simulated.recording)):
        scans = list(furrowmap.open_recording(path).scans())
        assert sum(map(len, scans)) == figures["points"]
        assert sum(scan.whole for scan in scans) == figures["scans_complete"]
    assert {type(scan) for scan in scans} == {furrowmap.Scan}


def test_range_image__has_the_range_of_each_return(simulated: furrowmap.Simulated) -> None:
    scan = next(scan for scan in furrowmap.open_recording(simulated.recording).scans() if scan.whole)
    image = furrowmap.range_image(scan)
    assert (image.shape[0], image.dtype) == (16, np.float32)
    assert np.count_nonzero(np.isfinite(image)) == len(scan)
    x, y, z = scan.xyz_m.T.astype(float)
    np.testing.assert_allclose(image[15 - scan.laser, scan.column], np.sqrt(x * x + y * y + z * z), rtol=1e-6)
    # Highest first: the elevation of the returns falls from row to row.
    elevation_deg = np.degrees(np.arctan2(z, np.hypot(x, y)))
    rows = [np.median(elevation_deg[scan.laser == 15 - row]) for row in range(16)]
    np.testing.assert_allclose(rows, np.arange(15, -16, -2), atol=0.5)


def test_range_image__of_a_plane_is_its_closed_form() -> None:
    elevation_deg, azimuth_deg = np.array([-15.0, -5.0, 5.0]), np.arange(0.0, 360.0, 2.0)
    laser, column = (part.ravel() for part in np.meshgrid([0, 1, 2], np.arange(len(azimuth_deg)), indexing="ij"))
    up, around = np.radians(elevation_deg[laser]), np.radians(azimuth_deg[column])
    ray = np.column_stack([np.cos(up) * np.sin(around), np.cos(up) * np.cos(around), np.sin(up)])
    hit = ray[:, 2] < 0  # a floor 2 m below the scanner
    n = int(hit.sum())
    one = np.ones(n, np.uint8)
    scan = furrowmap.Scan(
        number=0,
        t_s=np.zeros(n),
        xyz_m=(ray[hit] * (-2.0 / ray[hit, 2:])).astype(np.float32),
        intensity=one,
        laser=laser[hit].astype(np.uint8),
        column=column[hit].astype(np.uint16),
        return_number=one,
        returns=one,
    )
    floor = 2.0 / np.sin(np.radians([5.0, 15.0]))
    assert furrowmap.range_image(scan).shape == (2, 180)
    image = furrowmap.range_image(scan, lasers=3)
    assert np.isnan(image[0]).all()
    np.testing.assert_allclose(image[1:], np.repeat(floor[:, None], 180, axis=1), rtol=1e-6)
    nothing = replace(scan[:0])
    assert furrowmap.range_image(nothing).shape == (0, 0)
    assert furrowmap.range_image(nothing, lasers=3).shape == (3, 0)


def test_evaluate_gnss__has_the_tables_of_each_log(simulated: furrowmap.Simulated) -> None:
    logs = {"CLAS": simulated.folder / "gnss.nmea", "RTK": str(simulated.folder / "reference.nmea")}
    reference = simulated.folder / "reference.nmea"
    found = furrowmap.evaluate_gnss(logs, str(reference))
    table = furrowmap.evaluation_table(found)
    assert list(table["service"].unique()) == ["CLAS", "RTK"]
    for service, log in logs.items():
        tables = furrowmap.evaluate_gnss({"one": log}, reference)["one"].tables
        rows = table[table["service"] == service].set_index(["fix", "quantity"])
        assert set(rows.index) == {(fix, quantity) for fix, found in tables.items() for quantity in found}
        for fix, found in tables.items():
            for quantity, row in found.items():
                expected = [row.n, row.average_m, row.standard_deviation_m, row.rmse_m, row.percentiles_m[3]]
                columns = ["epochs", "average_m", "standard_deviation_m", "rmse_m", "p95_m"]
                np.testing.assert_array_equal(rows.loc[(fix, quantity), columns].to_numpy(float), expected)
    assert (table.loc[(table["service"] == "RTK") & (table["quantity"] == "3D"), "rmse_m"] == 0).all()


def test_evaluate_gnss__settings_hold_for_all_logs(simulated: furrowmap.Simulated) -> None:
    reference = simulated.folder / "reference.nmea"
    settings = furrowmap.EvaluationSettings(antenna_offset_m=(0.0, 0.0, 0.5))
    table = furrowmap.evaluation_table(furrowmap.evaluate_gnss({"RTK": reference}, reference, settings=settings))
    heights = table[(table["fix"] == "all") & (table["quantity"] == "Z")]
    assert heights["average_m"].item() == pytest.approx(-0.5, abs=1e-6)
