"""Layers of a foreign GeoPackage become files in the folder that was named, or nothing is written."""

from __future__ import annotations

import shutil
from pathlib import Path

import geopandas as gpd
import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from pyproj import CRS

from furrowmap.core.readers.vector_file import VectorLayer
from furrowmap.core.runtime.errors import InputError
from furrowmap.exporters.exchange.vectors import FORMATS, _short_names, write_vectors
from furrowmap.exporters.files.provenance import Origin
from furrowmap.workflows.share.export import export
from tests.exporters.farm.result_folders import rename_layer, write_result

SPLIT = sorted(name for name, kind in FORMATS.items() if kind.write_one is not None)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_result(tmp_path_factory.mktemp("layers") / "result")


@pytest.fixture
def result(written: Path, tmp_path: Path) -> Path:
    """A result of one's own to damage."""
    return Path(shutil.copytree(written, tmp_path / "result"))


def layer(*names: str) -> VectorLayer:
    """A point with fields of these names."""
    columns = {name: np.array([k]) for k, name in enumerate(names, start=1)}
    return VectorLayer(np.array([shapely.Point(1, 2)]), columns, CRS("EPSG:6677"))


@pytest.mark.parametrize(
    ("to", "name"),
    [*((to, "../out") for to in SPLIT), *(("csv", n) for n in ("/tmp/out", "..\\out", "x/../../out", "con", "a\nb"))],
)
def test_promise_23__layer_names_do_not_lead_out_of_the_folder(
    result: Path, tmp_path: Path, to: str, name: str
) -> None:
    rename_layer(result / "field.gpkg", "zones", name)
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(InputError) as raised:
        export([result], to, tmp_path / "exported")
    assert raised.value.code == "name-outside"
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("names", [("Passes", "passes"), ("ä", "Ä"), ("e\u0301", "é")])
def test_layers_whose_files_would_be_one__are_refused(tmp_path: Path, names: tuple[str, str]) -> None:
    with pytest.raises(InputError) as raised:
        layers = dict.fromkeys(("other", *names, "third"), layer("a"))
        write_vectors(FORMATS["shapefile"], tmp_path / "out", layers, Origin("x"))
    assert raised.value.code == "layer-names-equal"
    assert f"on some systems: {names[0]}, {names[1]}." in str(raised.value)
    assert not (tmp_path / "out").exists()


@given(names=st.lists(st.text("abAB_äÄ圃m123", min_size=1, max_size=24), unique=True, max_size=12))
def test_shapefile_names__are_ten_bytes_and_differ_in_more_than_case(names: list[str]) -> None:
    short = _short_names(layer(*names))
    assert list(short) == names
    assert all(0 < len(name.encode()) <= 10 for name in short.values())
    assert len({name.casefold() for name in short.values()}) == len(names)
    kept = [name for name in names if len(name.encode()) <= 10]
    assert all(short[name].startswith(name[:1]) for name in kept)


def test_shapefile__tells_which_names_of_fields_it_shortened(tmp_path: Path) -> None:
    """As they are in the file; those of ten letters stay."""
    table = layer("working_depth", "tencolumns", "b")
    _, notices = write_vectors(FORMATS["shapefile"], tmp_path / "out", {"passes": table}, Origin("x"))
    (short,) = set(gpd.read_file(tmp_path / "out" / "passes.shp").columns) - {"tencolumns", "b", "geometry"}
    (notice,) = notices
    assert notice.text.endswith(f": working_depth is {short}.")
    few = {"passes": layer("tencolumns", "b")}
    assert write_vectors(FORMATS["shapefile"], tmp_path / "few", few, Origin("x"))[1] == []


def test_shapefile__with_long_names_of_other_scripts_is_read_back(tmp_path: Path) -> None:
    table = layer("作業面積の合計", "作業面積の平均", "Ha", "ha")
    write_vectors(FORMATS["shapefile"], tmp_path / "out", {"passes": table}, Origin("x"))
    back = gpd.read_file(tmp_path / "out" / "passes.shp")
    assert sorted(int(back[name].iloc[0]) for name in back.columns if name != "geometry") == [1, 2, 3, 4]


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
@pytest.mark.parametrize("xy", [(np.nan, 1.0), (np.inf, 1.0), (1.0, -np.inf)])
def test_promise_14__coordinates_that_are_not_finite_are_an_error_before_anything_is_written(
    result: Path, tmp_path: Path, xy: tuple[float, float]
) -> None:
    gpd.GeoDataFrame(
        {"a": [1, 2]}, geometry=[shapely.Point(0, 0), shapely.LineString([(0, 0), xy])], crs="EPSG:6677"
    ).to_file(result / "field.gpkg", layer="damaged", driver="GPKG", engine="pyogrio")
    for to in ("csv", "gpkg", "kml", "geojson"):
        with pytest.raises(InputError) as raised:
            export([result], to, tmp_path / "out")
        assert raised.value.code == "result-unreadable"
        assert not (tmp_path / "out").exists()
