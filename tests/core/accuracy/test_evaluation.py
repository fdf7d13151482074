"""Evaluations: known errors come back, the tables' identities hold, and samples agree with other computations."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Geod, Transformer

from furrowmap.core.accuracy.evaluation import Continuity, ErrorStatistics, Evaluation, evaluate, match, outliers, table
from furrowmap.core.accuracy.receiver_logs import evaluate_logs
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.gnss import Fix, GnssTrack

LAT, LON, HEIGHT = 36.1, 140.2, 60.0
T0 = 1_780_000_000.0
NAMES = ("test", "reference")


def track(t_s: np.ndarray, enu_m: np.ndarray, **columns: Any) -> GnssTrack:
    """A track of places east, north, up of a point, by PROJ's own topocentric frame."""
    place = Transformer.from_pipeline(
        f"+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 +lat_0={LAT} +lon_0={LON} +h_0={HEIGHT} "
        "+step +inv +proj=cart +ellps=WGS84 +step +proj=unitconvert +xy_in=rad +xy_out=deg"
    )
    lon, lat, height = place.transform(*enu_m.T)
    fix = columns.pop("fix", np.full(len(t_s), Fix.FIXED, np.int8))
    return GnssTrack.build(
        t_s, source="made", service="", lon_deg=lon, lat_deg=lat, height_m=height, fix=fix, **columns
    )


def straight(n: int = 200, speed_mps: float = 2.0, rate_hz: float = 10.0) -> tuple[np.ndarray, np.ndarray]:
    """Times, and a way towards north-east (3 east on 4 north)."""
    t = np.arange(n) / rate_hz
    return T0 + t, np.column_stack([0.6 * speed_mps * t, 0.8 * speed_mps * t, np.zeros(n)])


def test_known_errors__come_back_to_the_rounding() -> None:
    """Of the table's every cell a closed form is known: errors of two kinds, as often."""
    t_s, way = straight()
    error = np.where(np.arange(200)[:, None] % 2 == 0, (0.03, 0.04, 0.12), (-0.03, 0.04, 0.12))
    found = evaluate(track(t_s, way + error), track(t_s, way)).tables["all"]
    expected = {
        "X": (0.0, 0.03, 0.03),
        "Y": (0.04, 0.0, 0.04),
        "Z": (0.12, 0.0, 0.12),
        "2D": (0.05, 0.0, 0.05),
        "3D": (0.13, 0.0, 0.13),
        # East and north are (0.6, 0.8) along and (−0.8, 0.6) to the left.
        "along": (0.032, 0.018, np.hypot(0.032, 0.018)),
        "across": (0.024, 0.024, np.hypot(0.024, 0.024)),
    }
    for name, (average, deviation, rmse) in expected.items():
        row = found[name]
        assert (row.average_m, row.standard_deviation_m, row.rmse_m) == pytest.approx(
            (average, deviation, rmse), abs=2e-6
        )


def test_log_of_known_errors__through_a_file(tmp_path: Path) -> None:
    """The same through the .pos writer of RTKLIB's layout: exact to what its digits hold (0.1 mm)."""
    rng = np.random.default_rng(3)
    t_s, way = straight(600)
    error = rng.normal(0.0, (0.02, 0.03, 0.05), (600, 3)) + np.array([0.01, -0.02, 0.04])
    names = []
    for name, made in (("test", track(t_s, way + error)), ("reference", track(t_s, way))):
        path = tmp_path / f"{name}.pos"
        rows = [
            f"{int((t - 315964782) // 604800)} {(t - 315964782) % 604800:.3f} {lat:.9f} {lon:.9f} {h:.4f} 1 10 0 0 0\n"
            for t, lat, lon, h in zip(made.t_s, made.lat_deg, made.lon_deg, made.height_m, strict=True)
        ]
        path.write_text("%  GPST  latitude(deg) longitude(deg) height(m) Q ns sdn(m) sde(m) sdu(m)\n" + "".join(rows))
        names.append(path)
    found = evaluate_logs(names[0], str(names[1])).tables["all"]
    columns = {"X": error[:, 0], "Y": error[:, 1], "Z": error[:, 2], "2D": np.hypot(error[:, 0], error[:, 1])}
    columns["3D"] = np.sqrt(np.sum(error**2, axis=1))
    for name, values in columns.items():
        assert found[name].average_m == pytest.approx(values.mean(), abs=1e-4)
        assert found[name].standard_deviation_m == pytest.approx(values.std(), abs=1e-4)
        assert found[name].rmse_m == pytest.approx(np.sqrt(np.mean(values**2)), abs=1e-4)


finite = st.floats(-100.0, 100.0)


@given(errors=st.lists(st.tuples(finite, finite, finite), min_size=1, max_size=30))
def test_identities_of_the_papers_tables(errors: list[tuple[float, float, float]]) -> None:
    error = np.array(errors)
    rows = table(error, error[:, 0], error[:, 1])
    for row in rows.values():
        assert row.rmse_m**2 == pytest.approx(row.average_m**2 + row.standard_deviation_m**2, abs=1e-8)
        assert list(row.percentiles_m) == sorted(row.percentiles_m)
        assert row.percentiles_m[-1] <= row.greatest_m + 1e-12
    assert rows["2D"].rmse_m ** 2 == pytest.approx(rows["X"].rmse_m ** 2 + rows["Y"].rmse_m ** 2, abs=1e-8)
    assert rows["3D"].rmse_m ** 2 == pytest.approx(rows["2D"].rmse_m ** 2 + rows["Z"].rmse_m ** 2, abs=1e-8)


def test_identities__hold_for_the_published_tables() -> None:
    """So these definitions are the paper's: its own numbers obey them to their rounding (columns 3D, 2D, X, Y, Z)."""
    published = {
        "SLAS": ([0.5632, 0.3122, 0.2120, 0.0962, 0.3515], [0.2530, 0.1348, 0.1606, 0.1888, 0.3769],
                 [0.6174, 0.3400, 0.2659, 0.2119, 0.5153]),
        "CLAS": ([0.0532, 0.0119, -0.0008, -0.0020, 0.0450], [0.0243, 0.0069, 0.0071, 0.0116, 0.0347],
                 [0.0585, 0.0138, 0.0071, 0.0118, 0.0569]),
        "MADOCA": ([0.2708, 0.2191, -0.1972, -0.0204, -0.1184], [0.2272, 0.1583, 0.1547, 0.0991, 0.1946],
                   [0.3534, 0.2703, 0.2506, 0.1012, 0.2277]),
    }  # fmt: skip
    for average, deviation, rmse in published.values():
        np.testing.assert_allclose(np.hypot(average, deviation), rmse, atol=1.5e-4)
        assert np.hypot(rmse[2], rmse[3]) == pytest.approx(rmse[1], abs=1.5e-4)
        assert np.hypot(rmse[1], rmse[4]) == pytest.approx(rmse[0], abs=1.5e-4)


def curved(t: np.ndarray) -> np.ndarray:
    """A figure of eight, 3 m/s at most."""
    return np.column_stack([10.0 * np.sin(0.2 * t), 5.0 * np.sin(0.4 * t), 0.1 * np.sin(0.3 * t)])


@pytest.mark.parametrize(("rate_hz", "bound_m"), [(1.0, 0.03), (5.0, 5e-5), (10.0, 2e-5)])
def test_interpolation__on_a_curve(rate_hz: float, bound_m: float) -> None:
    reference_s, test_s = np.arange(0.0, 60.0, 1.0 / rate_hz), np.arange(3.03, 55.0, 0.1)
    found = match(track(T0 + test_s, curved(test_s)), track(T0 + reference_s, curved(reference_s)))
    assert len(found) == len(test_s)
    assert np.abs(found.error_m).max() < bound_m
    # What the evaluation says of its own interpolation, by every other epoch, is no less than the truth.
    assert found.interpolation_m[1] > np.quantile(np.linalg.norm(found.error_m, axis=1), 0.95)


def test_gaps__nothing_is_taken_across_them() -> None:
    t_s, way = straight(100, rate_hz=1.0)
    kept = np.ones(100, bool)
    kept[40:60] = False
    reference = track(t_s[kept], way[kept])
    tested = np.arange(0.0, 99.0, 0.5)
    found = match(track(T0 + tested, np.column_stack([1.2 * tested, 1.6 * tested, 0 * tested])), reference)
    inside = (found.t_s > t_s[39] + 1e-3) & (found.t_s < t_s[60] - 1e-3)
    assert not inside.any()
    assert found.in_gaps == int(np.sum((tested > 39.0) & (tested < 60.0)))
    assert found.outside == 0
    assert np.abs(found.error_m).max() < 1e-6
    assert match(track(T0 + tested, np.zeros((len(tested), 3))), reference, max_gap_s=30.0).in_gaps == 0


def test_gaps__an_epoch_alone_bends_nothing_beyond_them() -> None:
    """Between the second and the third epoch, and the last but two, a curve would need what is across the gap."""
    reference_s = np.concatenate([[0.0], np.arange(10.0, 16.0), [26.0]])
    way = np.column_stack([2.0 * reference_s, np.zeros(8), np.zeros(8)])
    way[[0, -1], 1] = 40.0
    tested = np.arange(10.0, 15.01, 0.25)
    test = track(T0 + tested, np.column_stack([2.0 * tested, 0 * tested, 0 * tested]))
    found = match(test, track(T0 + reference_s, way), max_gap_s=1.5)
    assert len(found) == len(tested)
    assert np.abs(found.error_m).max() < 1e-6


def test_logs_without_common_time__are_refused_with_both_spans() -> None:
    t_s, way = straight(20)
    with pytest.raises(InputError, match="no time in common") as error:
        evaluate(track(t_s, way), track(t_s + 3600.0, way))
    assert error.value.code == "no-time-in-common"
    with pytest.raises(InputError) as error:
        evaluate(track(t_s[5:6] + 0.05, way[5:6]), track(t_s[::10], way[::10]), max_gap_s=0.5)
    assert error.value.code == "reference-gaps"


@pytest.mark.parametrize("stated", ["travel", "reference", "test"])
def test_antenna_offset__is_turned_with_the_vehicle(stated: str) -> None:
    """Two antennas on one vehicle on a circle: with their offset there is no error, without it there is its length."""
    t = np.arange(0.0, 60.0, 0.1)
    angle = 0.1 * t  # anticlockwise, so that the vehicle turns left
    ahead = np.column_stack([-np.sin(angle), np.cos(angle)])
    left = np.column_stack([-np.cos(angle), -np.sin(angle)])
    way = np.column_stack([20.0 * np.cos(angle), 20.0 * np.sin(angle), 0.0 * t])
    other = way + np.column_stack([0.8 * ahead - 0.3 * left, np.full(len(t), 0.5)])
    heading = {"heading_deg": np.degrees(np.arctan2(ahead[:, 0], ahead[:, 1])) % 360.0}
    test = track(T0 + t, other, **(heading if stated == "test" else {}))
    reference = track(T0 + t, way, **(heading if stated == "reference" else {}))
    with_offset = evaluate(test, reference, antenna_offset_m=(0.8, -0.3, 0.5))
    # At either end of the log the direction of travel is that of a quarter of a second ahead or behind: 1.4° here.
    assert with_offset.tables["all"]["3D"].greatest_m < (0.025 if stated == "travel" else 1e-3)
    assert with_offset.tables["all"]["3D"].percentiles_m[3] < 1e-3
    without = evaluate(test, reference).tables["all"]
    assert without["2D"].average_m == pytest.approx(np.hypot(0.8, 0.3), abs=1e-3)
    assert without["along"].average_m == pytest.approx(0.8, abs=0.01)
    assert without["across"].average_m == pytest.approx(-0.3, abs=0.01)


def test_antenna_offset__while_standing_keeps_the_last_direction() -> None:
    t = np.arange(0.0, 20.0, 0.1)
    east = np.where(t < 10.0, t, 10.0)
    way = np.column_stack([east, 0.0 * t, 0.0 * t])
    found = evaluate(
        track(T0 + t, way + np.array([1.0, 0.0, 0.0])), track(T0 + t, way), antenna_offset_m=(1.0, 0.0, 0.0)
    )
    assert found.tables["all"]["2D"].greatest_m < 1e-3
    standing = np.zeros((200, 3))
    with pytest.raises(InputError, match="no heading"):
        evaluate(track(T0 + t, standing), track(T0 + t, standing), antenna_offset_m=(1.0, 0.0, 0.0))


def test_time_ahead__is_told_from_an_offset_of_the_antenna() -> None:
    t = np.arange(0.0, 100.0, 0.1)
    speed = 2.0 + np.sin(0.2 * t)
    travelled = np.cumsum(speed) * 0.1
    way = np.column_stack([travelled, 0 * t, 0 * t])
    late = np.column_stack([travelled + 0.05 * speed + 0.4, 0 * t, 0 * t])
    found = evaluate(track(T0 + t, late), track(T0 + t, way)).time_ahead_s
    assert found is not None
    assert found[0] == pytest.approx(0.05, abs=0.002)


def test_outliers__are_those_of_their_kind_of_fix() -> None:
    rng = np.random.default_rng(5)
    error = rng.normal(0.0, 0.01, (400, 3))
    error[200:] *= 100.0  # the other kind is a hundred times as rough
    kind = np.repeat(np.array([4, 1], np.int8), 200)
    error[[17, 250]] = (0.2, 0.0, 0.0), (0.2, 0.0, 0.0)
    found = outliers(error, kind)
    assert found[17]
    assert not found[250]
    assert found.sum() < 12


def test_heights_that_nobody_states__leave_2d() -> None:
    t_s, way = straight(50)
    test = track(t_s, way + np.array([0.1, 0.0, 0.0]))
    flat = GnssTrack.build(
        test.t_s, source="flat", service="", lon_deg=test.lon_deg, lat_deg=test.lat_deg, fix=test.fix
    )
    found = evaluate(flat, track(t_s, way))
    assert found.tables["all"]["2D"].rmse_m == pytest.approx(0.1, abs=1e-5)
    assert found.tables["all"]["Z"].n == found.tables["all"]["3D"].n == 0
    assert "no-heights" in {notice.code for notice in found.notices}


def test_reference_that_is_not_fixed__is_told_and_may_be_left_out() -> None:
    t_s, way = straight(100)
    fix = np.where(np.arange(100) < 60, Fix.FIXED, Fix.FLOAT).astype(np.int8)
    found = evaluate(track(t_s, way), track(t_s, way, fix=fix))
    assert "reference-not-fixed" in {notice.code for notice in found.notices}
    assert found.reference_share_by_fix == pytest.approx({"fixed": 0.6, "float": 0.4})
    found = evaluate(track(t_s, way), track(t_s, way, fix=fix), fixed_reference_only=True)
    assert (len(found.matched), found.left_out_by_reference_fix) == (60, 40)


def test_a_reference_of_one_epoch__is_compared_at_that_one() -> None:
    t_s, way = straight(50)
    found = evaluate(track(t_s, way + 0.1), track(t_s[20:21], way[20:21]))
    assert len(found.matched) == 1
    assert found.matched.error_m[0] == pytest.approx([0.1, 0.1, 0.1], abs=1e-5)
    assert np.isnan(found.matched.along_m).all()
    assert "few-epochs" in {notice.code for notice in found.notices}


def test_across_the_antimeridian_and_in_the_south() -> None:
    """The same errors at 179.99999° E and beyond, south of the equator, where longitudes jump by 360°."""
    t = np.arange(0.0, 20.0, 0.1)
    lon = (179.9999 + 1e-5 * t + 180.0) % 360.0 - 180.0
    columns = {"height_m": np.full(len(t), 10.0), "fix": np.full(len(t), Fix.FIXED, np.int8)}
    reference = GnssTrack.build(T0 + t, source="", service="", lon_deg=lon, lat_deg=np.full(len(t), -17.0), **columns)
    east_deg, north_deg = 1e-6, 2e-6
    other = (lon + east_deg + 180.0) % 360.0 - 180.0
    test = GnssTrack.build(
        T0 + t + 0.05, source="", service="", lon_deg=(other + 1e-5 * 0.05 + 180.0) % 360.0 - 180.0,
        lat_deg=np.full(len(t), -17.0 + north_deg), **columns,
    )  # fmt: skip
    found = evaluate(test[: len(t) - 1], reference).tables["all"]
    geod = Geod(ellps="WGS84")
    assert found["X"].average_m == pytest.approx(geod.inv(0.0, -17.0, east_deg, -17.0)[2], rel=1e-3)
    assert found["Y"].average_m == pytest.approx(geod.inv(0.0, -17.0, 0.0, -17.0 + north_deg)[2], rel=1e-3)
    assert found["2D"].standard_deviation_m < 1e-5


def test_continuity() -> None:
    t = np.delete(np.arange(0.0, 100.0), np.arange(50, 60))
    fix = np.where(t < 7, Fix.SINGLE, np.where(t < 20, Fix.FLOAT, Fix.FIXED)).astype(np.int8)
    age = np.where(fix == Fix.SINGLE, np.nan, 1.0)
    found = Continuity.from_track(track(T0 + t, np.zeros((90, 3)), fix=fix, age_s=age))
    assert found.first_by_fix_s == {"single": 0.0, "float": 7.0, "fixed": 20.0}
    assert found.share_by_fix == pytest.approx({"single": 7 / 90, "float": 13 / 90, "fixed": 70 / 90})
    assert (found.gaps, found.longest_gap_s, found.availability) == (1, 11.0, 0.9)
    assert [(gap.begin_s - T0, gap.length_s) for gap in found.gap_list] == [(49.0, 11.0)]
    assert found.age is not None
    assert (found.age.epochs, found.age.median_s, found.age.greatest_s) == (83, 1.0, 1.0)


def test_stated_sigmas__that_are_honest_hold_what_they_should() -> None:
    rng = np.random.default_rng(1)
    t_s, way = straight(4000)
    sigma = rng.uniform(0.01, 0.1, (4000, 3))
    stated = {f"sigma_{axis}_m": sigma[:, k] for k, axis in enumerate("enh")}
    found = evaluate(track(t_s, way + rng.normal(0.0, sigma), **stated), track(t_s, way)).within_sigmas
    assert found is not None
    assert list(found.values()) == pytest.approx([0.683, 0.954, 0.997], abs=0.01)


@pytest.fixture(scope="module")
def car(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, pd.DataFrame]:
    """The 5 Hz reference as a trajectory that furrowmap reads, and as pandas reads it."""
    folder = shared_data / "gnss/car_reference"
    names = ["tow", "week", "lat", "lon", "h", "x", "y", "z", "roll", "pitch", "heading", "ve", "vn", "vu"]
    frame = pd.read_csv(folder / "reference.csv", skiprows=1, names=names, skipinitialspace=True)
    assert len(frame) == 6151
    path = tmp_path_factory.mktemp("car") / "reference.csv"
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["time_gps_s", "lon_deg", "lat_deg", "h_m", "roll_deg", "pitch_deg", "heading_deg"])
        for row in frame.itertuples():
            rows.writerow([row.week * 604800 + row.tow, row.lon, row.lat, row.h, row.roll, row.pitch, row.heading])
    return path, frame


def independent(pos: Path, frame: pd.DataFrame) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Horizontal distance by the geodesic, height difference and Q at equal time stamps, without our code."""
    rows = pd.read_csv(pos, sep=r"\s+", comment="%", header=None)
    if "/" in str(rows[0][0]):
        clock = pd.to_datetime(rows[0] + " " + rows[1])
        stamp = (clock - pd.Timestamp("1980-01-06")).dt.total_seconds().to_numpy() % 604800
    else:
        stamp = rows[1].to_numpy()
    key, known = np.round(stamp * 1000).astype(int), np.round(frame.tow.to_numpy() * 1000).astype(int)
    _, a, b = np.intersect1d(key, known, return_indices=True)
    lat, lon, h, q = (rows[k].to_numpy()[a] for k in (2, 3, 4, 5))
    away = Geod(ellps="WGS84").inv(frame.lon.to_numpy()[b], frame.lat.to_numpy()[b], lon, lat)[2]
    return away, h - frame.h.to_numpy()[b], q


@pytest.mark.parametrize(
    ("name", "readme"),
    [
        ("rover_rtk.pos", (0.90, 31.0, 52.7)),
        ("rover_1Hz_rtk.pos", (1.90, 27.0, 61.2)),
        ("rover_1Hz_spp.pos", (2.86, 27.2, 96.4)),
    ],
)
def test_car__agrees_with_an_independent_computation(
    name: str, readme: tuple[float, float, float], car: tuple[Path, pd.DataFrame], shared_data: Path
) -> None:
    reference, frame = car
    pos = shared_data / "gnss/car_reference" / name
    away, up, q = independent(pos, frame)
    assert (np.median(away), np.quantile(away, 0.95), away.max()) == pytest.approx(readme, rel=0.01)
    found = evaluate_logs(pos, str(reference))
    stamp = np.abs(found.matched.t_s * 5.0 - np.round(found.matched.t_s * 5.0)) < 1e-4
    error = found.matched.error_m[stamp]
    assert int(stamp.sum()) == len(away)
    # At errors of tens of metres geodesic and chord differ by micrometres, and height couples in by its slope.
    np.testing.assert_allclose(np.hypot(error[:, 0], error[:, 1]), away, rtol=1e-4, atol=1e-3)
    np.testing.assert_allclose(error[:, 2], up, atol=2e-3)
    for word, code in (("fixed", 1), ("float", 2), ("single", 5)):
        if code in q and stamp.all():
            assert found.tables[word]["2D"].n == int(np.sum(q == code))
            assert found.tables[word]["2D"].rmse_m == pytest.approx(np.sqrt(np.mean(away[q == code] ** 2)), rel=1e-4)


def test_car__fixed_epochs_and_their_constant_offset(car: tuple[Path, pd.DataFrame], shared_data: Path) -> None:
    """What the README holds of the fixed epochs: median 0.069 m; +0.023 m forward, −0.039 m right in the median."""
    found = evaluate_logs(shared_data / "gnss/car_reference/rover_rtk.pos", str(car[0]))
    fixed = found.fix == Fix.FIXED
    assert found.tables["fixed"]["2D"].percentiles_m[0] == pytest.approx(0.069, abs=0.002)
    assert np.median(found.matched.error_m[fixed, 2]) == pytest.approx(-0.045, abs=0.002)
    offset = evaluate_logs(
        shared_data / "gnss/car_reference/rover_rtk.pos", str(car[0]), antenna_offset_m=(0.023, 0.039, -0.045)
    )
    better = offset.tables["fixed"]
    assert better["2D"].percentiles_m[0] < 0.9 * found.tables["fixed"]["2D"].percentiles_m[0]


CLAS = {
    "clas_static": (581, (0.005, 0.008), (-0.001, 0.009), (0.097, 0.023)),
    "clas_kinematic": (881, (0.006, 0.007), (-0.002, 0.008), (0.103, 0.025)),
}


@pytest.mark.parametrize("name", CLAS)
def test_clas__agrees_with_the_published_place(name: str, shared_data: Path) -> None:
    count, east, north, up = CLAS[name]
    path = shared_data / "gnss/clas" / f"{name}.pos"
    found = evaluate_logs(path, "35.339325776,139.522173128,65.712")
    fixed = found.tables["fixed"]
    assert fixed["2D"].n == count
    for quantity, expected in (("X", east), ("Y", north), ("Z", up)):
        assert (fixed[quantity].average_m, fixed[quantity].standard_deviation_m) == pytest.approx(expected, abs=6e-4)
    assert found.continuity.first_by_fix_s == {"single": 0.0, "fixed": 19.0}
    assert found.service == "clas"
    # The published Cartesian place, and PROJ's topocentric frame there: no code of ours.
    rows = pd.read_csv(path, sep=r"\s+", comment="%", header=None)
    rows = rows[rows[5] == 1]
    to_local = Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 "
        "+step +proj=topocentric +ellps=WGS84 +X_0=-3962108.673 +Y_0=3381309.574 +Z_0=3668678.638"
    )
    local = np.column_stack(to_local.transform(rows[3], rows[2], rows[4]))
    for axis, quantity in enumerate("XYZ"):
        assert fixed[quantity].average_m == pytest.approx(local[:, axis].mean(), abs=1e-3)
        assert fixed[quantity].standard_deviation_m == pytest.approx(local[:, axis].std(), abs=1e-5)


def test_two_logs_of_one_drive__agree_within_their_rounding(shared_data: Path) -> None:
    folder = shared_data / "gnss/walk_f9p"
    found: Evaluation = evaluate_logs(folder / "walk.nmea", str(folder / "walk.ubx"))
    # Of the two positions without a partner one is before the first of the other log, one in a step of 0.15 s.
    assert (found.continuity.epochs, len(found.matched)) == (3902, 3900)
    assert (found.matched.outside, found.matched.in_gaps) == (1, 1)
    assert not found.matched.interpolated.any()
    assert found.tables["all"]["2D"].greatest_m < 0.012
    assert found.tables["all"]["2D"].rmse_m == pytest.approx(0.0068, abs=3e-4)


def test_rows_of_nothing__say_so() -> None:
    row = ErrorStatistics.from_values(np.full(3, np.nan))
    assert row.n == 0
    assert np.isnan(row.rmse_m)


@pytest.mark.parametrize("empty", ["test", "reference"])
def test_a_log_without_positions__is_named(empty: str) -> None:
    t_s, way = straight()
    tracks = {name: track(t_s[: 0 if name == empty else 200], way[: 0 if name == empty else 200]) for name in NAMES}
    tracks[empty] = replace(tracks[empty], source="empty.nmea")
    with pytest.raises(InputError, match=r"empty\.nmea: it has no positions") as error:
        evaluate(*tracks.values())
    assert error.value.code == "nothing-to-compare"


def test_antenna_offset__epochs_far_from_any_known_heading_are_skipped_and_counted() -> None:
    """A heading holds for two seconds; the compass of this receiver stops after ten."""
    t = np.arange(0.05, 30.0, 0.1)
    way = np.column_stack([t, 0.0 * t, 0.0 * t])
    heading = np.where(t < 10.0, 90.0, np.nan)
    test = track(T0 + t, way + np.array([1.0, 0.0, 0.0]), heading_deg=heading)
    found = evaluate(test, track(T0 + t, way), antenna_offset_m=(1.0, 0.0, 0.0))
    (notice,) = [notice for notice in found.notices if notice.code == "heading-unknown"]
    skipped = found.matched.without_heading
    assert notice.text.startswith(f"{skipped} epochs are skipped")
    assert skipped + len(found.matched) == 300
    assert len(found.matched) in (119, 120)
    assert found.tables["all"]["2D"].greatest_m < 1e-3


def test_interpolation_error__of_a_reference_with_gaps_between_all_epochs_is_unknown() -> None:
    t = np.arange(0.0, 80.0, 8.0)
    way = np.column_stack([t, 0.0 * t, 0.0 * t])
    found = evaluate(track(T0 + t, way), track(T0 + t, way), max_gap_s=5.0)
    assert len(found.matched) == 10
    assert np.isnan(found.matched.interpolation_m).all()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("35.3,139.5", "neither a file nor a place"),
        ("139.5,35.3,60.0", r"no latitude 139\.5°, longitude 35\.3°"),
        ("-90.1,35.3,60.0", r"no latitude -90\.1°"),
        ("35.3,360.5,60.0", r"longitude 360\.5°"),
    ],
)
def test_place__that_is_none(text: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words) as error:
        evaluate_logs(tmp_path / "gone.nmea", text)
    assert error.value.code == "bad-place"
