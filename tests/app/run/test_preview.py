"""A preview judged by what was simulated, and what of a folder it leaves alone."""

from __future__ import annotations

import json
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import rasterio
import tomli_w
from numpy.typing import NDArray

import furrowmap
from furrowmap.core.runtime.errors import InputError
from furrowmap.exporters.files.result_folder import PREVIEW_DSM, PREVIEW_REPORT, PREVIEW_TRACK, RUN_PRODUCTS
from tests.app.told_progress import Told

_EN = ("e_m", "n_m")


@pytest.fixture(scope="module")
def loop(shared_data: Path) -> Path:
    return shared_data / "tractor_loop"


@pytest.fixture(scope="module")
def folder(loop: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("preview")
    furrowmap.preview(loop / "session.toml", folder, progress=Told())
    return folder


def test_preview__is_a_track_and_a_surface(folder: Path) -> None:
    account = json.loads((folder / PREVIEW_REPORT).read_text(encoding="utf-8"))
    assert account["products"] == sorted(path.name for path in folder.iterdir())
    assert set(account["products"]) == {PREVIEW_REPORT, PREVIEW_DSM, "preview_dsm.qml", PREVIEW_TRACK}
    assert set(account["products"]).isdisjoint(RUN_PRODUCTS)
    assert account["figures"]["duration_s"] == pytest.approx(60.4, abs=0.2)
    assert "level-assumed" in {warning["code"] for warning in account["warnings"]}


def test_preview__of_a_session_as_init_wrote_it_has_one_cause(loop: Path, tmp_path: Path) -> None:
    """What is not entered comes first; what follows from it stands behind it."""
    text = (loop / "session.toml").read_text(encoding="utf-8")
    stated = tomllib.loads(text)
    bare = {name: stated[name] for name in ("furrowmap", "recording", "crs")}
    for name in ("recording.pcap.gz", "gnss.nmea"):
        shutil.copyfile(loop / name, tmp_path / name)
    (tmp_path / "session.toml").write_text(tomli_w.dumps(bare), encoding="utf-8")
    warnings = furrowmap.preview(tmp_path / "session.toml", tmp_path / "out")["warnings"]
    assert [(warning["code"], warning["follows"]) for warning in warnings[:1]] == [("mounting-identity", None)]
    assert {warning["follows"] for warning in warnings[1:]} == {"mounting-identity"}
    assert {"antenna-unknown", "level-assumed"} <= {warning["code"] for warning in warnings}


def test_track__is_the_vehicles_within_its_lean(folder: Path, loop: Path) -> None:
    """Up to 3° of lean move a point 1.6 m below the antenna by 8 cm, which a preview does not know."""
    truth = np.genfromtxt(loop / "truth" / "trajectory.csv", delimiter=",", names=True)
    _, _, shapes, (t_s,) = pyogrio.raw.read(folder / PREVIEW_TRACK, layer="trajectory", columns=["t_s"])
    en_m = np.array([np.frombuffer(shape[5:21], "<f8") for shape in shapes])
    apart_m = np.hypot(*(en_m[:, k] - np.interp(t_s, truth["time_unix_s"], truth[c]) for k, c in enumerate(_EN)))
    assert len(t_s) > 500
    assert np.median(apart_m) < 0.05
    assert apart_m.max() < 0.3


def test_surface__is_the_soils_within_decimetres(folder: Path, loop: Path) -> None:
    """The vehicle is taken to stand level: 2° of it are 0.35 m at 10 m."""
    with rasterio.open(folder / PREVIEW_DSM) as raster:
        height_m: NDArray[np.float32] = raster.read(1)
        rows, columns = np.nonzero(np.isfinite(height_m))
        e_m, n_m = raster.xy(rows, columns)
        cell_m = raster.res[0]
    truth = np.load(loop / "truth" / "surface.npz")
    column, row = (
        np.floor((np.asarray(x) - truth[start]) / truth["cell_m"]).astype(int)
        for x, start in ((e_m, "e0"), (n_m, "n0"))
    )
    soil = truth["after"]
    inside = (row >= 0) & (row < soil.shape[0]) & (column >= 0) & (column < soil.shape[1])
    error_m = height_m[rows, columns][inside] - truth["h0_m"] - soil[row[inside], column[inside]]
    assert inside.sum() * cell_m**2 > 800
    assert abs(np.median(error_m)) < 0.15
    assert np.quantile(np.abs(error_m), 0.9) < 0.5


def test_preview__leaves_what_else_is_in_the_folder(loop: Path, tmp_path: Path) -> None:
    for name in RUN_PRODUCTS:
        (tmp_path / name).write_text(f"of a run: {name}")
    furrowmap.preview(loop / "session.toml", tmp_path)
    assert [name for name in RUN_PRODUCTS if (tmp_path / name).read_text() != f"of a run: {name}"] == []


def test_preview__of_a_session_without_a_scanner_is_its_track(shared_data: Path, tmp_path: Path) -> None:
    """It takes the place of an earlier preview with a surface."""
    shutil.copyfile(shared_data / "isoxml" / "other" / "single_dpd.zip", tmp_path / "tasks.zip")
    (tmp_path / "session.toml").write_text(
        'furrowmap = 1\n[recording]\ngnss = ["tasks.zip"]\n[crs]\nmap = "EPSG:32615"\n'
        '[implement]\nwidth_m = 3.0\nxy_m = [0.0, 0.0]\nstates = ["tasks.zip"]\n'
    )
    folder = tmp_path / "preview"
    folder.mkdir()
    (folder / PREVIEW_REPORT).write_text(json.dumps({"products": [PREVIEW_REPORT, PREVIEW_DSM]}))
    (folder / PREVIEW_DSM).touch()
    account = furrowmap.preview(tmp_path / "session.toml", folder)
    assert account["products"] == [PREVIEW_REPORT, PREVIEW_TRACK] == sorted(path.name for path in folder.iterdir())


def test_preview__fails_where_the_run_would(loop: Path, tmp_path: Path) -> None:
    """Clocks that do not overlap in time are reported in a second, not after the work."""
    for name in ("recording.pcap.gz", "gnss.nmea", "boundary.geojson"):
        shutil.copyfile(loop / name, tmp_path / name)
    text = (loop / "session.toml").read_text(encoding="utf-8")
    assert "lidar_minus_gnss_s = 0.0" in text
    (tmp_path / "session.toml").write_text(
        text.replace("lidar_minus_gnss_s = 0.0", "lidar_minus_gnss_s = 3600.0"), encoding="utf-8"
    )
    with pytest.raises(InputError) as refused:
        furrowmap.preview(tmp_path / "session.toml", tmp_path / "preview")
    assert refused.value.code == "no-common-time"
    assert not (tmp_path / "preview").exists()


@pytest.mark.parametrize("span", ["", 'to = "2026-06-11T01:24:10Z"\n'])
def test_promise_05__a_preview_names_the_wrong_model_also_of_a_part(span: str, loop: Path, tmp_path: Path) -> None:
    text = (loop / "session.toml").read_text(encoding="utf-8").replace('model = "VLP-16"', 'model = "Puck Hi-Res"')
    for path in loop.iterdir():
        if path.is_file():
            shutil.copyfile(path, tmp_path / path.name)
    (tmp_path / "session.toml").write_text(text.replace("[recording]\n", f"[recording]\n{span}"), encoding="utf-8")
    furrowmap.preview(tmp_path / "session.toml", tmp_path / "out", progress=Told())
    account = json.loads((tmp_path / "out" / PREVIEW_REPORT).read_text(encoding="utf-8"))
    assert "model-differs" in {warning["code"] for warning in account["warnings"]}
    assert account["figures"]["duration_s"] == pytest.approx(60.4 if not span else 29.0, abs=3.0)
