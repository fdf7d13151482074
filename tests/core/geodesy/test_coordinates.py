"""Epochs, geoids and stated frames: against official sample values, and said where they cannot be had."""

from __future__ import annotations

import datetime as dt
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import jgdtrans
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import CRS, Geod

from furrowmap.core.geodesy.coordinates import (
    EpochMove,
    HeightMove,
    TransformSummary,
    places_on_map,
    transform_poses,
    transform_track,
)
from furrowmap.core.geodesy.projection import (
    MapFrame,
    ParameterFile,
    height_system,
    map_frame,
    read_parameters,
    stated_frame,
)
from furrowmap.core.runtime.errors import FurrowmapError, InputError, RefusedError
from furrowmap.core.session.opened import resolve
from furrowmap.core.values.gnss import Fix, GnssTrack
from furrowmap.core.values.pose_track import PoseTrack
from furrowmap.core.values.session import Crs

DEG = 3e-9
HEIGHT_M = 0.0005
"""Official values are rounded to 1e-9° and 1 mm; their services round to 1e-5" on the way."""
TSUKUBA = 140.08785504166664, 36.103774791666666


@pytest.fixture(scope="module")
def geo(shared_data: Path) -> Path:
    return shared_data / "geo"


@pytest.fixture(scope="module")
def expected(geo: Path) -> dict[str, Any]:
    values: dict[str, Any] = json.loads((geo / "expected.json").read_text())
    return values


@pytest.fixture(scope="module")
def semidyna(geo: Path) -> ParameterFile:
    return read_parameters(geo / "semidynaexe_sample.par")


def frame_beside(crs: Crs, session_file: Path) -> MapFrame:
    """The map frame of a session whose files lie beside it."""
    files = [resolve(session_file, name) if name is not None else None for name in (crs.parameters, crs.geoid_grid)]
    return map_frame(crs, *files)


def of_2023(geo: Path, folder: Path) -> Path:
    """A session file beside the sample parameters, under the name of a fiscal year."""
    shutil.copyfile(geo / "semidynaexe_sample.par", folder / "SemiDyna2023.par")
    return folder / "session.toml"


def track(
    day: str = "2023-06-11", lon: float = TSUKUBA[0], lat: float = TSUKUBA[1], height_m: float = 70.0
) -> GnssTrack:
    begin = dt.datetime.fromisoformat(f"{day}T03:00:00+00:00").timestamp()
    n = 5
    return GnssTrack.build(
        begin + np.arange(n), lon_deg=np.full(n, lon), lat_deg=lat + 1e-5 * np.arange(n), height_m=np.full(n, height_m)
    )


@pytest.mark.parametrize("kind", ["TKY2JGD", "PatchJGD(HV)", "SemiDynaEXE"])
@pytest.mark.parametrize("way", ["forward", "backward"])
def test_parameters__give_the_official_values(geo: Path, expected: dict[str, Any], kind: str, way: str) -> None:
    sample = expected[kind]
    parameters = read_parameters(geo / sample["file"])
    assert parameters.format == sample["format"]
    lat, lon, height = (np.array([value], float) for value in sample[way]["from"])
    moved = np.concatenate(getattr(parameters, way)(lon, lat, height))
    official = sample[way]["to_official_web"]
    np.testing.assert_allclose(moved[:2], [official[1], official[0]], rtol=0, atol=DEG)
    # The service for heights takes its parameter at the place it is given, be that before or after the change.
    sign = 1.0 if way == "forward" else -1.0
    there = moved[2] if kind == "TKY2JGD" else sign * parameters.forward(lon, lat, height)[2][0]
    assert abs(there - official[2]) <= HEIGHT_M
    assert abs(moved[2] - official[2]) <= HEIGHT_M + abs(moved[2] - there)
    assert abs(moved[2] - there) < 0.0002


@pytest.mark.parametrize("kind", ["TKY2JGD", "PatchJGD(HV)", "SemiDynaEXE"])
@pytest.mark.parametrize("way", ["forward", "backward"])
def test_parameters__rounded_as_the_services_do_are_the_official_values_digit_by_digit(
    geo: Path, expected: dict[str, Any], kind: str, way: str
) -> None:
    """They round what they are given, and what they add to it, to 1e-5": all of what is left above."""
    sample = expected[kind]
    parameters = read_parameters(geo / sample["file"])
    lat, lon, height = (np.array([value], float) for value in sample[way]["from"])
    moved = getattr(parameters, way)(lon, lat, height)
    for given_deg, moved_deg, official_deg in zip(
        (lat, lon), moved[1::-1], sample[way]["to_official_web"], strict=False
    ):
        seconds = np.round(3600.0 * given_deg, 5) + np.round(3600.0 * (moved_deg - given_deg), 5)
        assert round(float(seconds[0]) / 3600.0, 9) == official_deg


@given(
    st.lists(
        st.tuples(st.floats(140.0626, 140.1249), st.floats(36.0834, 36.1249), st.floats(-100, 4000)),
        min_size=1,
        max_size=4,
    )
)
def test_parameters__agree_with_jgdtrans_and_lead_back(geo: Path, places: list[tuple[float, float, float]]) -> None:
    semidyna = read_parameters(geo / "semidynaexe_sample.par")
    with (geo / "semidynaexe_sample.par").open() as file:
        oracle = jgdtrans.load(file, format="SemiDynaEXE")
    lon, lat, height = np.array(places).T
    there = semidyna.forward(lon, lat, height)
    others = np.array([oracle.forward(*place) for place in zip(lat, lon, height, strict=True)])
    np.testing.assert_allclose(np.column_stack([there[1], there[0]]), others[:, :2], rtol=0, atol=1e-12)
    np.testing.assert_allclose(there[2], others[:, 2], rtol=0, atol=1e-9)
    inside = (there[0] < 140.12499) & (there[1] > 36.08334)
    back = semidyna.backward(*(column[inside] for column in there))
    np.testing.assert_allclose(back[0], lon[inside], rtol=0, atol=1e-12)
    np.testing.assert_allclose(back[2], height[inside], rtol=0, atol=1e-9)


QUARTER = """GRIDDED CORRECTION PARAMETER FOR POS2JGD
FORMAT_VERSION             = 1.00
PUBLISHED_BY               = GEOSPATIAL INFORMATION AUTHORITY OF JAPAN
NATIONAL_DATUM             = JGD2011
POSITIONING_DATUM          = ITRF2014+GRS80
VERSION_OF_PARAMETER       = Ver.1.0.0
EPOCH_OF_PARAMETER         = 20230401
RELEASE_DATE               = 20230531
APPLICABLE_AREA            = INHABITED AREA OF JAPAN
START_OF_APPLICABLE_PERIOD = 20230601
END_OF_APPLICABLE_PERIOD   = 20230831
DATA_FIELDS                = '4 MeshCode dB dL dH'
DATA_FIELD_SEPARATOR       = \\s+
BASED_ON                   = GEONET_CORS




"""
"""The head as published; jgdtrans reads 18 lines of it."""


def quarter(geo: Path, folder: Path, sign: float = 1.0, more: str = "") -> Path:
    """The sample's parameters as a file of POS2JGD, whose numbers lead from the map, or to it."""
    rows = [line.split() for line in (geo / "semidynaexe_sample.par").read_text().splitlines()[16:]]
    body = [f"{code}    " + " ".join(f"{sign * float(v):9.5f}" for v in values) for code, *values in rows]
    path = folder / "pos2jgd_202307_ITRF2014.par"
    path.write_text(QUARTER + "\n".join(body) + more + "\n")
    return path


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["from the map", "to the map"])
def test_pos2jgd__is_read_as_jgdtrans_does_and_leads_to_the_map_whatever_its_sign(
    geo: Path, semidyna: ParameterFile, tmp_path: Path, sign: float
) -> None:
    """The ground of Japan has moved to the south: with numbers that say north, they lead back."""
    path = quarter(geo, tmp_path, sign)
    found = read_parameters(path)
    oracle = jgdtrans.loads(path.read_text().rstrip(), format="ITRF2014")
    lon, lat, height = np.array([TSUKUBA[0]]), np.array([TSUKUBA[1]]), np.array([70.0])
    ours, other = found.forward(lon, lat, height), oracle.forward(lat[0], lon[0], height[0])
    np.testing.assert_allclose(np.ravel(ours), [other.longitude, other.latitude, other.altitude], rtol=0, atol=1e-9)
    ours, other = found.backward(lon, lat, height), oracle.backward(lat[0], lon[0], height[0])
    np.testing.assert_allclose(np.ravel(ours), [other.longitude, other.latitude, other.altitude], rtol=0, atol=1e-9)
    # Numbers that lead to the map are counted at the place where it is today, 0.4 m away: 1e-12° and 1e-6 m.
    np.testing.assert_allclose(
        np.ravel(found.to_map(lon, lat, height)), np.ravel(semidyna.to_map(lon, lat, height)), rtol=0, atol=2e-6
    )
    np.testing.assert_allclose(found.to_map(lon, lat, height)[:2], semidyna.to_map(lon, lat, height)[:2], atol=1e-11)


def test_pos2jgd__holds_on_its_days_in_japan(geo: Path, tmp_path: Path) -> None:
    quarter(geo, tmp_path)
    crs = Crs(map="EPSG:6677", coordinates="current-epoch", parameters="pos2jgd_202307_ITRF2014.par")
    frame = frame_beside(crs, tmp_path / "session.toml")
    _, done = transform_track(track("2023-06-11"), frame)
    assert done.account(frame)["moves"][0]["parameters"] == "pos2jgd_202307_ITRF2014.par"
    assert done.notices == ()
    for day in ("2023-05-31", "2023-09-01"):
        with pytest.raises(InputError, match=r"is valid from 2023-05-31T15:00.* to 2023-08-31T15:00"):
            transform_track(track(day), frame)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("JGD2011", "KGD2002", "NATIONAL_DATUM is KGD2002"),
        ("20230831", "August", "END_OF_APPLICABLE_PERIOD is not a date"),
        ("'4 MeshCode dB dL dH'", "'3 MeshCode dB dL'", "its fields are '3 MeshCode dB dL'"),
        ("54401005", "44420005", "without nodes"),
        ("0.09460", "x", "could not convert"),
        ("0.09460", "nan", "not numbers"),
        ("0.09460", "", "not every line"),
    ],
)
def test_pos2jgd__damaged_of_elsewhere_or_of_islands_alone_is_refused(
    geo: Path, tmp_path: Path, old: str, new: str, says: str
) -> None:
    path = quarter(geo, tmp_path)
    text = path.read_text()
    if old == "54401005":  # Ogasawara, on the Philippine Sea plate
        text = QUARTER + f"{new}    -0.00622   0.01516   0.09460\n"
    path.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=says):
        read_parameters(path)


def test_current_epoch__moves_every_position_back_to_the_map(
    geo: Path, expected: dict[str, Any], tmp_path: Path
) -> None:
    """The ground at Tsukuba has moved to the east-south-east since 2011: the map's coordinates lie west of today's."""
    frame = frame_beside(
        Crs(map="EPSG:6677", coordinates="current-epoch", parameters="SemiDyna2023.par"), of_2023(geo, tmp_path)
    )
    sample = expected["SemiDynaEXE"]["backward"]
    moved, done = transform_track(track(lon=sample["from"][1], lat=sample["from"][0]), frame)
    assert abs(moved.lon_deg[0] - sample["to_official_web"][1]) < DEG
    assert abs(moved.lat_deg[0] - sample["to_official_web"][0]) < DEG
    assert abs(moved.height_m[0] - 70.0 - sample["to_official_web"][2]) < HEIGHT_M
    (move,) = done.account(frame)["moves"]
    azimuth, _, distance_m = Geod(ellps="GRS80").inv(
        sample["from"][1], sample["from"][0], sample["to_official_web"][1], sample["to_official_web"][0]
    )
    grid = np.radians(azimuth - frame.convergence_deg(moved.lon_deg, moved.lat_deg)[0])
    assert move["parameters"] == "SemiDyna2023.par"
    assert move["east_m"] == pytest.approx(distance_m * np.sin(grid), abs=1e-3)
    assert move["north_m"] == pytest.approx(distance_m * np.cos(grid), abs=1e-3)
    assert move["east_m"] < -0.3
    assert move["up_m"] == pytest.approx(-0.096, abs=1e-3)
    assert done.notices == ()
    assert "SemiDyna2023.par" in frame.words


def test_a_position_far_away_stays_for_those_who_tell_jumps(geo: Path, tmp_path: Path) -> None:
    crs = Crs(map="EPSG:6677", coordinates="current-epoch", parameters="SemiDyna2023.par", heights="GSIGEO2011")
    frame = frame_beside(crs, of_2023(geo, tmp_path))
    some = track()
    some.lon_deg[3], some.lat_deg[3] = 0.0, 0.0
    moved, _ = transform_track(some, frame)
    assert (moved.lon_deg[3], moved.lat_deg[3]) == (0.0, 0.0)
    assert (np.delete(moved.height_m, 3) < 30.0).all()


def test_as_recorded__moves_nothing() -> None:
    frame = map_frame(Crs(map="EPSG:6677"))
    moved, done = transform_track(track(), frame)
    np.testing.assert_array_equal(moved.lon_deg, track().lon_deg)
    np.testing.assert_array_equal(moved.height_m, track().height_m)
    assert done.account(frame)["moves"] == []
    assert frame.words == ""


def test_positions_without_a_place_stay_without_one(geo: Path, tmp_path: Path) -> None:
    frame = frame_beside(
        Crs(map="EPSG:6677", coordinates="current-epoch", parameters="SemiDyna2023.par"), of_2023(geo, tmp_path)
    )
    some = track()
    some.lon_deg[2] = np.nan
    moved, _ = transform_track(some, frame)
    np.testing.assert_array_equal(np.isfinite(moved.lon_deg), [True, True, False, True, True])


@pytest.mark.parametrize("day", ["2023-03-30", "2024-04-02"])
def test_an_epoch_out_of_the_files_year_is_refused(geo: Path, tmp_path: Path, day: str) -> None:
    frame = frame_beside(
        Crs(map="EPSG:6677", coordinates="current-epoch", parameters="SemiDyna2023.par"), of_2023(geo, tmp_path)
    )
    with pytest.raises(InputError, match=r"SemiDyna2023\.par is valid from 2023-03-31T15:00.* to 2024-03-31T15:00"):
        transform_track(track(day), frame)


def test_parameters_whose_year_is_unknown_are_used_and_told(geo: Path, tmp_path: Path) -> None:
    shutil.copyfile(geo / "semidynaexe_sample.par", tmp_path / "shift.par")
    frame = frame_beside(
        Crs(map="EPSG:6677", coordinates="current-epoch", parameters="shift.par"), tmp_path / "session.toml"
    )
    _, done = transform_track(track("2019-01-01"), frame)
    assert [notice.code for notice in done.notices] == ["epoch-unchecked"]


@pytest.mark.parametrize(
    ("crs", "code"),
    [
        (Crs(map="EPSG:6677", coordinates="current-epoch"), "parameters-missing"),
        (Crs(map="EPSG:32654", coordinates="current-epoch", parameters="SemiDyna2023.par"), "epoch-map"),
        (Crs(map="EPSG:6677", coordinates="current-epoch", parameters="SemiDyna2031.par"), "session-file-missing"),
        (Crs(map="EPSG:6677", coordinates="current-epoch", parameters="session.toml"), "parameters-unreadable"),
        (Crs(map="EPSG:6677", coordinates="current-epoch", parameters="tokyo.par"), "parameters-kind"),
        (Crs(map="EPSG:6677", coordinates="itrf2021@2026.4"), "frame-unknown"),
        (Crs(map="EPSG:6677", coordinates="itrf2020@20264"), "epoch-out-of-range"),
        (Crs(map="EPSG:6677", heights="EGM2008", geoid_grid="session.toml"), "geoid-unreadable"),
        (Crs(map="EPSG:32633", heights="EPSG:5783"), "geoid-unknown"),
    ],
)
def test_promise_18__what_is_missing_or_wrong_is_refused_before_any_work(
    geo: Path, tmp_path: Path, crs: Crs, code: str
) -> None:
    session = of_2023(geo, tmp_path)
    session.write_text("furrowmap = 1\n")
    shutil.copyfile(geo / "tky2jgd_sample.par", tmp_path / "tokyo.par")
    with pytest.raises(FurrowmapError) as refused:
        frame_beside(crs, session)
    assert refused.value.code == code
    assert all(refused.value.lines)


def test_a_place_outside_the_parameters_is_refused(semidyna: ParameterFile) -> None:
    """The last one has, by the rule of mesh codes, the codes of Tsukuba."""
    for lon, lat in ((141.0, 36.1), (20.9, 52.4), (-140.0, 36.1), (40.06, 36.75)):
        with pytest.raises(InputError, match="has no parameters for"):
            semidyna.backward(np.array([lon]), np.array([lat]), np.zeros(1))


def test_damaged_parameters_are_refused(geo: Path, tmp_path: Path) -> None:
    text = (geo / "semidynaexe_sample.par").read_text().replace("0.01529", "0.01x29")
    (tmp_path / "a.par").write_text(text)
    with pytest.raises(InputError, match=r"0\.01x29"):
        read_parameters(tmp_path / "a.par")


@pytest.mark.parametrize("more", ["5440", "54401005", "54401005 0.1", "x"])
def test_promise_18__a_line_that_is_no_row_of_parameters_is_refused(geo: Path, tmp_path: Path, more: str) -> None:
    (tmp_path / "a.par").write_text((geo / "semidynaexe_sample.par").read_text() + more + "\n")
    with pytest.raises(InputError, match="is not a mesh code and parameters"):
        read_parameters(tmp_path / "a.par")


@pytest.mark.parametrize("number", ["9" * 5000, "nan", "1e999", "0.0152", "٣"])
def test_promise_18__parameters_with_numbers_that_are_none_are_refused(geo: Path, tmp_path: Path, number: str) -> None:
    text = (geo / "semidynaexe_sample.par").read_text().replace("0.01529", number)
    (tmp_path / "a.par").write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as refused:
        read_parameters(tmp_path / "a.par")
    assert refused.value.code == "parameters-unreadable"


@pytest.mark.parametrize("name", ["GSIGEO2011", "JPGEO2024"])
def test_geoids_of_japan_are_the_official_ones_to_a_millimetre(expected: dict[str, Any], name: str) -> None:
    key = {"GSIGEO2011": "gsigeo2011", "JPGEO2024": "jpgeo2024_hrefconv2024"}[name]
    heights = height_system(name, CRS("EPSG:6668"))
    for value in expected["geoid"]["values"]:
        found = heights.geoid_m(np.array([float(value["lon"])]), np.array([float(value["lat"])]))[0]
        assert np.isnan(found) if value[key] is None else abs(found - value[key]) < 1e-3


def test_heights_above_a_geoid_are_told_in_crs_and_account() -> None:
    frame = map_frame(Crs(map="EPSG:6677", heights="GSIGEO2011"))
    moved, done = transform_track(track(), frame)
    assert moved.height_m[0] == pytest.approx(70.0 - 40.1859, abs=1e-3)
    assert frame.whole_crs == CRS("EPSG:10170")
    (move,) = done.account(frame)["moves"]
    assert (move["step"], move["up_m"]) == ("heights", pytest.approx(-40.186, abs=1e-3))
    assert done.notices == ()
    wkt = map_frame(Crs(map="EPSG:6677", heights="JPGEO2024")).whole_crs.to_wkt("WKT1_GDAL")
    assert "JGD2024 (vertical) height" in wkt


def test_promise_18__a_place_without_a_geoid_is_refused() -> None:
    frame = map_frame(Crs(map="EPSG:32634", heights="GSIGEO2011"))
    with pytest.raises(InputError, match="GSIGEO2011 has no geoid at 52"):
        transform_track(track(lon=20.9, lat=52.4), frame)


@pytest.mark.parametrize(
    ("heights", "coordinates", "day", "warned"),
    [
        ("GSIGEO2011", "as-recorded", "2023-06-11", False),
        ("JPGEO2024", "as-recorded", "2023-06-11", True),
        ("JPGEO2024", "as-recorded", "2026-06-11", False),
        ("GSIGEO2011", "as-recorded", "2026-06-11", True),
        ("GSIGEO2011", "itrf2020@2026.4", "2026-06-11", True),
    ],
)
def test_an_epoch_and_a_geoid_that_do_not_belong_together_are_told_with_the_size(
    heights: str, coordinates: str, day: str, warned: bool
) -> None:
    frame = map_frame(Crs(map="EPSG:6677", heights=heights, coordinates=coordinates))
    notices = transform_track(track(day), frame)[1].notices
    assert [notice.code for notice in notices] == (["epoch-and-geoid"] if warned else [])
    if warned:
        assert "9.7 cm" in notices[0].text  # 40.2826 - 40.1859


def test_a_grid_of_the_user_is_read(tmp_path: Path) -> None:
    """A GTX whose heights rise by 1 m a degree to the north and 0.5 m to the east; PROJ interpolates between."""
    lat, lon = np.mgrid[0:3, 0:3]
    folder = tmp_path / "a field 圃場"
    folder.mkdir()
    head = np.array([51.0, 20.0, 1.0, 1.0], ">f8").tobytes() + np.array([3, 3], ">i4").tobytes()
    (folder / "geoid.gtx").write_bytes(head + (30.0 + lat + 0.5 * lon).astype(">f4").tobytes())
    frame = frame_beside(Crs(map="EPSG:32634", heights="EGM2008", geoid_grid="geoid.gtx"), folder / "session.toml")
    moved, done = transform_track(track(lon=20.9, lat=52.4, height_m=100.0), frame)
    assert moved.height_m[0] == pytest.approx(100.0 - (30.0 + 1.4 + 0.45), abs=1e-4)
    assert done.account(frame)["moves"][0]["source"] == "the grid geoid.gtx"
    assert "EGM2008 height" in frame.whole_crs.name


def test_a_stated_frame_and_epoch_are_in_the_name_and_the_metadata() -> None:
    frame = map_frame(Crs(map="EPSG:6677", coordinates="itrf2020@2026.4"))
    plain = map_frame(Crs(map="EPSG:6677"))
    lon, lat = np.array([TSUKUBA[0]]), np.array([TSUKUBA[1]])
    np.testing.assert_allclose(frame.project(lon, lat), plain.project(lon, lat), rtol=0, atol=1e-6)
    assert frame.name.startswith("ITRF2020 @ 2026.4 / Japan Plane Rectangular CS")
    assert "EPOCH[2026.4]" in frame.wkt
    assert CRS.from_wkt(frame.crs.to_wkt("WKT1_GDAL")).name == frame.name
    account = transform_track(track("2026-05-27"), frame)[1].account(frame)
    assert (account["frame"], account["epoch"], account["moves"]) == ("ITRF2020", 2026.4, [])
    (told,) = transform_track(track("2019-05-27"), frame)[1].notices
    assert told.code == "epoch-apart"
    with pytest.raises(RefusedError, match="area of use"):
        frame.project(np.array([20.9]), np.array([52.4]))


@given(st.floats(1984, 2100), st.sampled_from(["ITRF2020", "itrf2014", "JGD2011", "wgs 84 (g2139)"]))
def test_stated_frames_are_read_whatever_their_case(epoch: float, frame: str) -> None:
    found = stated_frame(f"{frame}@{epoch:.4f}")
    assert found is not None
    assert found.frame.name.casefold() == frame.casefold()
    assert abs(found.epoch - epoch) < 1e-4


@pytest.mark.parametrize(
    ("epsg", "lon", "lat", "least_m"),
    [
        (27700, -1.5, 52.5, 100),
        (28992, 5.6, 52.0, 100),
        (30169, *TSUKUBA, 400),
        (31467, 9.2, 48.8, 100),
        (2056, 7.5, 47.0, 100),
        (26715, -93.6, 42.0, 10),
    ],
)
def test_promise_17__a_datum_that_lies_beside_todays_is_refused_unless_it_is_stated(
    epsg: int, lon: float, lat: float, least_m: float
) -> None:
    """British, Dutch, Japan's and Germany's old ones, the Swiss, NAD27: 10 to 450 m beside, as textbooks have them."""
    frame = map_frame(Crs(map=f"EPSG:{epsg}"))
    with pytest.raises(RefusedError, match=r"differ by \d+ m from") as refused:
        transform_track(track(lon=lon, lat=lat), frame)
    assert refused.value.code == "crs-datum"
    assert int(refused.value.lines[0].split(" differ by ")[1].split()[0]) > least_m
    base = frame.crs.geodetic_crs
    assert base is not None
    stated = map_frame(Crs(map=f"EPSG:{epsg}", coordinates=f"{base.name}@2023.4"))
    assert transform_track(track(lon=lon, lat=lat), stated)[1].account(stated)["moves"] == []


@pytest.mark.parametrize(
    ("epsg", "lon", "lat"),
    [
        (6677, *TSUKUBA), (25832, 10.0, 52.0), (2180, 20.9, 52.3), (26915, -93.6, 42.0), (6344, -93.6, 42.0),
        (28355, 147.0, -35.0), (7855, 147.0, -35.0), (2193, 172.0, -43.0), (31982, -51.0, -20.0), (2154, 3.0, 46.5),
        (5186, 127.0, 37.0), (3826, 121.0, 24.0), (32736, 35.2, -15.8), (2048, 19.0, -30.0),
    ],
)  # fmt: skip
def test_datums_of_today_are_taken(epsg: int, lon: float, lat: float) -> None:
    assert transform_track(track(lon=lon, lat=lat), map_frame(Crs(map=f"EPSG:{epsg}")))[1].notices == ()


def test_jgd2000_is_told_to_be_superseded() -> None:
    frame = map_frame(Crs(map="EPSG:2451"))
    assert [notice.code for notice in transform_track(track("2011-10-01"), frame)[1].notices] == []
    assert [notice.code for notice in transform_track(track("2023-06-11"), frame)[1].notices] == ["datum-superseded"]


@pytest.mark.parametrize(("heights", "told"), [("ellipsoidal", True), ("EPSG:6695", False)])
@pytest.mark.parametrize("name", ["EPSG:6677+6695", "EPSG:10170"])
def test_heights_that_the_maps_crs_names_and_nobody_asks_for_are_told(name: str, heights: str, told: bool) -> None:
    frame = map_frame(Crs(map=name, heights=heights))
    notices = transform_track(track(), frame)[1].notices
    assert [notice.code for notice in notices] == (["heights-not-asked-for"] if told else [])
    if told:
        assert '`heights = "EPSG:6695"`' in notices[0].text


def test_heights_of_jgd2011_by_their_code_are_above_gsigeo2011() -> None:
    by_code, by_name = (map_frame(Crs(map="EPSG:6677", heights=heights)) for heights in ("EPSG:6695", "GSIGEO2011"))
    assert by_code.whole_crs == by_name.whole_crs
    np.testing.assert_array_equal(
        transform_track(track(), by_code)[0].height_m, transform_track(track(), by_name)[0].height_m
    )


def test_promise_17__degrees_in_the_columns_of_eastings_and_northings_are_reported() -> None:
    position = np.column_stack([np.full(3, TSUKUBA[0]), TSUKUBA[1] + 1e-5 * np.arange(3), np.full(3, 70.0)])
    zeros = np.zeros(3)
    poses = PoseTrack(
        1_686_000_000.0 + np.arange(3), position, True, zeros, zeros, zeros, False, np.full((3, 6), np.nan), "p.csv"
    )
    (told,) = transform_poses(poses, map_frame(Crs(map="EPSG:6677")))[1].notices
    assert told.code == "coordinates-look-like-degrees"


@pytest.mark.parametrize(
    ("service", "fix", "coordinates", "told"),
    [
        ("clas", Fix.FIXED, "as-recorded", True),
        ("", Fix.PPP, "as-recorded", True),
        ("rtk", Fix.FIXED, "as-recorded", False),
        ("", Fix.FIXED, "as-recorded", False),
        ("clas", Fix.FIXED, "itrf2020@2026.4", False),
    ],
)
def test_positions_of_the_day_taken_as_recorded_are_told(service: str, fix: Fix, coordinates: str, told: bool) -> None:
    some = replace(track("2026-05-27"), service=service, fix=np.full(5, fix, np.int8))
    notices = transform_track(some, map_frame(Crs(map="EPSG:6677", coordinates=coordinates)))[1].notices
    assert [notice.code for notice in notices] == (["epoch-of-the-day"] if told else [])


def test_poses_in_map_coordinates_are_not_moved_and_others_are() -> None:
    frame = map_frame(Crs(map="EPSG:6677", heights="GSIGEO2011"))
    for projected in (True, False):
        position = np.array([[22_900.0, 11_600.0, 70.0]] * 3 if projected else [[*TSUKUBA, 70.0]] * 3)
        zeros = np.zeros(3)
        t_s = 1_686_000_000.0 + np.arange(3)
        poses = PoseTrack(t_s, position, projected, zeros, zeros, zeros, False, np.full((3, 6), np.nan), "poses.csv")
        moved, done = transform_poses(poses, frame)
        assert moved.position[0, 2] == pytest.approx(70.0 if projected else 29.814, abs=1e-3)
        assert (done.heights is None) == projected
        assert [notice.code for notice in done.notices] == (["coordinates-of-the-map"] if projected else [])


@pytest.mark.parametrize(("years", "told"), [(-1.1, True), (-0.9, False), (0.9, False), (1.1, True)])
def test_a_stated_epoch_is_told_beyond_a_year_from_the_recording(years: float, *, told: bool) -> None:
    """11 June 2026 is 2026.44."""
    frame = map_frame(Crs(map="EPSG:6677", coordinates=f"itrf2020@{2026.44 + years:.2f}"))
    (*notices,) = transform_track(track("2026-06-11"), frame)[1].notices
    assert [notice.code for notice in notices] == (["epoch-apart"] if told else [])
    assert all("made in 2026.4:" in notice.text for notice in notices)


@pytest.mark.parametrize(
    ("away_deg", "moved"),
    [((0.97, 0.0), True), ((1.03, 0.0), False), ((0.0, 0.97), True), ((0.0, -1.03), False)],
)
def test_positions_within_a_degree_of_the_others_are_moved(away_deg: tuple[float, float], *, moved: bool) -> None:
    some = track()
    some.lon_deg[3] += away_deg[0]
    some.lat_deg[3] += away_deg[1]
    done, _ = transform_track(some, map_frame(Crs(map="EPSG:6677", heights="JPGEO2024")))
    assert (done.height_m[3] < 40.0) == moved
    assert (np.delete(done.height_m, 3) < 40.0).all()


@pytest.mark.parametrize(
    ("place", "spread", "told"),
    [
        ((139.9, 36.1), 0.49, True),
        ((139.9, 36.1), 0.51, False),
        ((-179.9, -89.4), 0.3, True),
        ((180.2, 36.1), 0.1, False),
        ((139.9, 90.1), 0.1, False),
    ],
)
def test_eastings_and_northings_look_like_degrees_within_their_range_and_half_a_degree(
    place: tuple[float, float], spread: float, *, told: bool
) -> None:
    position = np.column_stack([np.full(3, place[0]), place[1] - spread * np.arange(3) / 2.0, np.full(3, 70.0)])
    zeros = np.zeros(3)
    poses = PoseTrack(
        1.7e9 + np.arange(3), position, True, zeros, zeros, zeros, False, np.full((3, 6), np.nan), "p.csv"
    )
    notices = transform_poses(poses, map_frame(Crs(map="EPSG:6677")))[1].notices
    assert [notice.code for notice in notices] == (["coordinates-look-like-degrees"] if told else [])


@pytest.mark.parametrize(
    ("last_second", "results"), [("2025-03-31T14:59:54+00:00", "JGD2011"), ("2025-03-31T15:00:01+00:00", "JGD2024")]
)
def test_network_corrections_are_those_of_jgd2024_from_april_2025_in_japan(last_second: str, results: str) -> None:
    begin_s = dt.datetime.fromisoformat(last_second).timestamp()
    some = replace(track(), t_s=begin_s + np.arange(5))
    own, other = ("GSIGEO2011", "JPGEO2024") if results == "JGD2011" else ("JPGEO2024", "GSIGEO2011")
    assert transform_track(some, map_frame(Crs(map="EPSG:6677", heights=own)))[1].notices == ()
    (told,) = transform_track(some, map_frame(Crs(map="EPSG:6677", heights=other)))[1].notices
    assert f"were in {results}" in told.text


def test_account__has_each_figure_of_a_step_under_its_name() -> None:
    """Heights fall by the mean of the least and greatest geoid height."""
    moves = TransformSummary(
        EpochMove("SemiDyna2023.par", 0.11111, -0.22222, 0.33333, 0.04444),
        HeightMove("EGM2008", "the grid geoid.gtx", (30.11111, 31.33333)),
    ).account(map_frame(Crs(map="EPSG:6677")))["moves"]
    assert moves == [
        {
            "step": "epoch", "parameters": "SemiDyna2023.par", "east_m": 0.1111, "north_m": -0.2222, "up_m": 0.3333,
            "spread_m": 0.0444,
        },
        {
            "step": "heights", "geoid": "EGM2008", "source": "the grid geoid.gtx", "up_m": -30.7222,
            "geoid_m": [30.1111, 31.3333],
        },
    ]  # fmt: skip


def test_geoid_of_a_drive__is_told_from_least_to_greatest() -> None:
    """Against the geoid at the ends of a drive to the north."""
    some = track()
    some.lat_deg[:] = TSUKUBA[1] + 0.1 * np.arange(5)
    frame = map_frame(Crs(map="EPSG:6677", heights="GSIGEO2011"))
    moved, done = transform_track(some, frame)
    geoid_m = 70.0 - moved.height_m
    assert geoid_m.max() - geoid_m.min() > 0.5
    (move,) = done.account(frame)["moves"]
    assert move["geoid_m"] == pytest.approx([geoid_m.min(), geoid_m.max()], abs=1e-4)


def test_places_on_map__two_at_one_time_and_one_unknown() -> None:
    """Two images may state the same second."""
    frame = map_frame(Crs(map="EPSG:25832"))
    places = np.array([[9.0, 51.0, 100.0], [9.0, 51.0001, 101.0], [np.nan, np.nan, np.nan]])
    placed, _ = places_on_map(np.array([1.7e9, 1.7e9, 1.7e9 + 1.0]), places, frame)
    north_m = Geod(ellps="GRS80").line_length([9.0, 9.0], [51.0, 51.0001])
    assert placed[1, 1] - placed[0, 1] == pytest.approx(north_m * 0.9996, abs=1e-4)
    assert placed[:2, 2].tolist() == [100.0, 101.0]
    assert np.isnan(placed[2]).all()
