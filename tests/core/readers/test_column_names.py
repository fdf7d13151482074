"""Names of columns by other programs: what they mean, in every reader of tables; what is ambiguous is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyproj import CRS
from pyproj.database import get_units_map

from furrowmap.core.readers.areas.area import read_area
from furrowmap.core.readers.attitude_csv import AttitudeCsv
from furrowmap.core.readers.column_names import standard_name, with_units
from furrowmap.core.readers.csv_file import head_columns
from furrowmap.core.readers.image_table import read_image_table
from furrowmap.core.readers.poses.csv import PoseCsv
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.source import look
from furrowmap.core.readers.states_csv import StatesCsv
from furrowmap.core.readers.surveyed_points import read_points
from furrowmap.core.runtime.errors import InputError

MAP = CRS.from_epsg(25832)
FEET = CRS.from_epsg(2263)
MEANT = {
    "lat_deg": ("Latitude", "LAT", "lat_deg", "Lat (°)", "latitude_degrees", "Latitude [deg]"),
    "lon_deg": ("Longitude", "Long", "lng", "lon (deg)", "LONGITUDE"),
    "h_m": ("Height (m)", "height_m", "Altitude", "Elev. [m]", "Height（m）", "elevation-m", "H"),
    "h_ellipsoidal_m": ("Ellipsoidal height", "H-Ell", "Height (ellipsoidal) [m]", "ellipsoid_height_m"),
    "h_orthometric_m": ("H-MSL", "Orthometric height", "altitude_amsl (m)"),
    "e_m": ("Easting", "East [m]", "E", "easting_metres", "Y (Easting)"),
    "n_m": ("Northing (m)", "north_m", "X (Northing)"),
    "time_gps_s": ("GPS Time", "GPSTime", "gps_time_s", "GPS seconds", "TOW (s)"),
    "time_unix_s": ("Unix time", "unix_timestamp_s", "POSIX time [s]", "epoch"),
    "heading_true_deg": ("True heading (deg)", "heading_true [°]"),
    "gyro_x_dps": ("Gyro X (deg/s)", "GyroX [°/s]", "gyro_x_deg_s", "rate_x_dps", "Angular velocity x [degrees/sec]"),
    "gyro_x_radps": ("Gyro X (rad/s)", "angular_velocity_x_rad_s"),
    "force_z_mps2": ("Acc Z (m/s^2)", "AccZ [m/s²]", "accel_z_m_s2", "Specific force z [m/s/s]"),
    "force_z_g": ("AccZ [g]", "acceleration_z_g"),
    "sigma_h_m": ("SD H (m)", "sdu(m)", "sigma_height_m"),
}
UNKNOWN = (
    "Roll", "Gyro X", "AccZ", "Height (ft)", "Latitude (rad)", "GPS time [ms]", "Linear acceleration z [m/s2]",
    "Base longitude", "Base elevation (m)", "Samples", "", "m", "deg", "Point_X", "Date", "Geoid undulation",
)  # fmt: skip


@pytest.mark.parametrize(("meant", "name"), [(meant, name) for meant, names in MEANT.items() for name in names])
def test_names_of_other_programs__mean_what_they_say(meant: str, name: str) -> None:
    assert standard_name(name) == meant
    assert standard_name(meant) == meant


@pytest.mark.parametrize("name", UNKNOWN)
def test_names_that_leave_quantity_or_unit_open__mean_nothing(name: str) -> None:
    assert standard_name(name) is None


def table(path: Path, header: str, *rows: str) -> Path:
    path.write_text("\n".join([header, *rows, ""]), encoding="utf-8")
    return path


def poses(path: Path) -> PoseCsv:
    return PoseCsv([path], ReadOptions(week=2422))


def test_trajectory__of_another_program_is_read_by_meaning_and_says_so(tmp_path: Path) -> None:
    header = "GPS Time,Latitude [deg],Longitude [deg],Ellipsoidal height,H-MSL,Roll (deg),Pitch (deg),Heading (deg)"
    path = table(tmp_path / "t.csv", header, *(f"{k}.5,51.5,10.25,95.5,50,1,2,{80 + k}" for k in range(3)))
    reader = poses(path)
    track = reader.poses()
    np.testing.assert_array_equal(track.position[0], [10.25, 51.5, 95.5])
    np.testing.assert_array_equal(track.heading_deg, [80, 81, 82])
    (told,) = (notice.text for notice in reader.notices if notice.code == "columns-by-meaning")
    assert "`Latitude [deg]` → lat_deg" in told
    assert "`Ellipsoidal height` → h_ellipsoidal_m" in told
    assert "H-MSL" not in told


def test_trajectory__heights_of_unknown_kind_beside_degrees_are_noticed(tmp_path: Path) -> None:
    header = "time_gps_s,lat_deg,lon_deg,Altitude,roll_deg,pitch_deg,heading_deg"
    reader = poses(table(tmp_path / "t.csv", header, *(f"{k},51.5,10.25,95.5,1,2,80" for k in range(3))))
    assert reader.poses().position[0, 2] == 95.5
    assert {notice.key for notice in reader.notices} == {"columns-by-meaning", "columns-by-meaning.height"}


def by_poses(folder: Path) -> Any:
    header = "time_unix_s,Easting,east_m,n_m,h_m,roll_deg,pitch_deg,heading_deg"
    return poses(table(folder / "a.csv", header, "1780000000,1,2,3,4,5,6,7", "1780000001,1,2,3,4,5,6,7")).poses()


def by_attitude(folder: Path) -> Any:
    path = table(folder / "a.csv", "time_unix_s,roll_deg,Pitch (deg),pitch [°]", "1780000000,1,2,3")
    return AttitudeCsv([path], ReadOptions()).attitude()


def by_states(folder: Path) -> Any:
    return StatesCsv(
        [table(folder / "a.csv", "Time,Timestamp,state", "2026-05-01,2026-05-02,up")], ReadOptions()
    ).states()


def by_points(folder: Path) -> Any:
    header = "name,Easting (m),East [m],n_m,h_m"
    return read_points(table(folder / "a.csv", header, "A,580000,580001,5700000,90"), MAP)


def by_heights(folder: Path) -> Any:
    header = "name,e_m,n_m,Height [m],Altitude (m)"
    return read_points(table(folder / "a.csv", header, "A,580000,5700000,90,91"), MAP)


def by_corners(folder: Path) -> Any:
    header = "id,EASTING_M,East (m),n_m"
    return read_area(table(folder / "a.csv", header, *(f"A,{k},{k + 1},{k * k}" for k in range(4))), MAP)


def by_images(folder: Path) -> Any:
    return read_image_table(table(folder / "a.csv", "File,File name,time", "a.jpg,b.jpg,2026-05-01"), folder)


@pytest.mark.parametrize(
    "read", [by_poses, by_attitude, by_states, by_points, by_corners, by_images], ids=lambda read: str(read.__name__)
)
def test_two_columns_that_mean_the_same__are_refused_in_three_lines(
    read: Callable[[Path], Any], tmp_path: Path
) -> None:
    with pytest.raises(InputError) as refused:
        read(tmp_path)
    assert refused.value.code == "column-twice"
    assert len(str(refused.value).splitlines()) == 3


def test_heights_in_feet__by_the_name_of_the_column_become_metres(tmp_path: Path) -> None:
    for number, name in enumerate(("Height (ft)", "height_ft", "Elevation [US ft]")):
        found = read_points(table(tmp_path / f"{number}.csv", f"name,e_m,n_m,{name}", "A,580000,5700000,300"), MAP)
        assert found.xyz_m[0, 2] == pytest.approx(91.44, abs=2e-4)
        assert [notice.code for notice in found.notices] == ["heights-in-feet"]


LENGTHS = {
    "US survey foot": (
        "Height (US survey feet)",
        "Elev [survey ft]",
        "Height_USft",
        "Elev ftUS",
        "Elevation (U.S. ft)",
    ),
    "foot": ("Elevation (pieds)", "Höhe (Fuß)", "標高(フィート)", "Altitude (pies)"),
    "yard": ("h (yd)", "Elevation yards", "Height (ヤード)"),
    "inch": ("Height (in)", "Elevation [inches]"),
    "metre": ("Höhe (Meter)", "標高(メートル)", "Altitude [metros]", "Height"),
    "fathom": ("Height (fathoms)",),
    "kilometre": ("Height (km)",),
}
"""Names of heights by the unit that they state, as PROJ calls it."""


@pytest.mark.parametrize(("unit", "name"), [(unit, name) for unit, names in LENGTHS.items() for name in names])
@pytest.mark.parametrize("below", [False, True])
def test_units_of_heights__are_those_of_proj_in_the_name_or_in_the_row_below(
    unit: str, name: str, below: bool, tmp_path: Path
) -> None:
    in_name = name.rstrip(")]").replace("[", "(").rpartition("(")[2] if "(" in name or "[" in name else ""
    if below and not in_name:
        return
    title, units = ("Height", [f",m,m,{in_name}"]) if below else (name, [])
    path = table(tmp_path / "a.csv", f"name,e_m,n_m,{title}", *units, "A,580000,5700000,300")
    wanted_m = 300.0 * get_units_map(category="linear")[unit].conv_factor
    assert read_points(path, MAP).xyz_m == pytest.approx(np.array([[580000.0, 5700000.0, wanted_m]]), abs=1e-6)


def test_rows_of_units__are_one_at_most_and_dashes_alone_are_none(tmp_path: Path) -> None:
    path = table(tmp_path / "a.csv", "name,e_m,n_m,Height", *20_000 * ["m,m,m,m"], "A,580000,5700000,90")
    found = read_points(path, MAP)
    assert (found.name, found.xyz_m[0, 2]) == (("A",), 90.0)
    assert with_units(["plot", "yield"], ["-", "–"]) is None
    assert with_units(["plot", "yield"], ["-", "m"]) == ["plot", "yield [m]"]


def test_a_row_of_units__is_none_where_anything_else_stands_in_it(tmp_path: Path) -> None:
    names = read_points(table(tmp_path / "a.csv", "name,e_m,n_m,h_m", "m,580000,5700000,90"), MAP).name
    assert names == ("m",)


def test_a_row_of_units__is_read_in_every_table(tmp_path: Path) -> None:
    """Angular rates need a unit; all others have one that is usual, here another one."""
    rows = ("1780000000,580000,5700000,90,1,2,3", "1780000001,580001,5700000,90,1,2,3")
    units = table(tmp_path / "p.csv", "unix,Easting,Northing,Height,Roll,Pitch,Heading", "s,m,m,m,deg,deg,°", *rows)
    plain = table(tmp_path / "q.csv", "time_unix_s,e_m,n_m,h_m,roll_deg,pitch_deg,heading_deg", *rows)
    assert head_columns(look(units)) == head_columns(look(plain))
    by_units, by_names = (poses(path).poses() for path in (units, plain))
    for name in ("t_s", "position", "roll_deg", "pitch_deg", "heading_deg"):
        np.testing.assert_array_equal(getattr(by_units, name), getattr(by_names, name))
    corners = table(tmp_path / "c.csv", "id,Easting,Northing", ",ft,ft", "A,0,0", "A,9,0", "A,9,9")
    assert read_area(corners, FEET).polygons[0].area == 40.5
    states = table(tmp_path / "s.csv", "t,state", "s,", "1780000000,down", "1780000001,up")
    assert len(StatesCsv([states], ReadOptions()).states()) == 2


def test_columns_of_heights__that_differ_are_named(tmp_path: Path) -> None:
    rows = ["A,580000,5700000,135.2,90.1", "B,580010,5700000,135.3,90.2"]
    path = table(tmp_path / "a.csv", "name,e_m,n_m,Ellipsoidal height,Elevation (m)", *rows)
    found = read_points(path, MAP)
    assert found.xyz_m[:, 2].tolist() == [90.1, 90.2]
    (notice,) = found.notices
    assert (notice.key, dict(notice.values)["apart_m"]) == ("points-two-heights.columns", pytest.approx(45.1))
    above_ellipsoid = CRS.from_epsg(25832).to_3d()
    assert read_points(path, above_ellipsoid).xyz_m[:, 2].tolist() == [135.2, 135.3]


def test_standard_deviations__have_the_unit_of_their_column(tmp_path: Path) -> None:
    header = "name,e_m,n_m,h_m,SD E (mm),SD N [cm],sigma_h_m"
    found = read_points(table(tmp_path / "a.csv", header, "A,580000,5700000,90,12,1.5,0.02"), MAP)
    np.testing.assert_allclose(found.sigma_m, [[0.012, 0.015, 0.02]])


def test_eastings_in_feet__are_those_of_a_crs_in_feet_as_they_are(tmp_path: Path) -> None:
    """Either foot: tables write `ft` for that of the CRS."""
    path = table(tmp_path / "a.csv", "name,Easting (ft),Northing (ft),Height (m)", "A,980000,200000,9")
    found = read_points(path, FEET)
    np.testing.assert_array_equal(found.xyz_m, [[980000.0, 200000.0, 9.0]])
    assert found.notices == ()
    corners = table(tmp_path / "b.csv", "id,Easting (ft),Northing (ft)", "A,0,0", "A,9,0", "A,9,9")
    assert read_area(corners, FEET).polygons[0].area == 40.5
    metres = table(tmp_path / "c.csv", "name,e_m,n_m,h_m", "A,304800,60960,9")
    foot_m = FEET.axis_info[0].unit_conversion_factor
    np.testing.assert_allclose(read_points(metres, FEET).xyz_m[0, :2], [304800 / foot_m, 60960 / foot_m], rtol=1e-12)


PLACES = (
    ("e_m", "n_m"), ("Easting", "Northing"), ("E", "N"), ("X", "Y"), ("EAST", "north"), ("Y (Easting)", "X (Northing)"),
    ("Rechtswert", "Hochwert"), ("RECHTSWERT", "hochwert"), ("Ostwert", "Nordwert"), ("Ost", "Nord"), ("Est", "Nord"),
    ("Este", "Norte"), ("Oost", "Noord"), ("Y座標", "X座標"), ("東距", "北距"),
)  # fmt: skip
"""Names of eastings and northings."""
PLACE_UNITS = {
    "metre": ("m", "metres", "Meter", "メートル"),
    "centimetre": ("cm", "centimetres"),
    "millimetre": ("mm", "millimetres"),
    "kilometre": ("km",),
    "foot": ("ft", "feet", "Fuß", "フィート"),
    "US survey foot": ("US ft", "ftUS", "US survey feet"),
    "yard": ("yd",),
}
"""Units in names, by that of PROJ."""
HEIGHT_NAMES = ("h_m", "Höhe", "HÖHE", "Hoehe", "Hauteur", "Altitude", "Altura", "Cota", "Quota", "z", "標高")


@pytest.mark.parametrize("place", PLACES, ids="/".join)
@pytest.mark.parametrize("unit", PLACE_UNITS)
def test_eastings_and_northings__by_any_name_in_any_unit_become_those_of_the_crs(
    place: tuple[str, str], unit: str, tmp_path: Path
) -> None:
    unit_m = get_units_map(category="linear")[unit].conv_factor
    names = [name.removesuffix("_m") for name in place]
    row = f"A,{580000 / unit_m:.9f},{5700000 / unit_m:.9f},90"
    titles = [[f"{name} [{word}]" for name in names] for word in PLACE_UNITS[unit]]
    if "座標" not in place[0] and "(" not in place[0]:
        titles += [[f"{name}_{PLACE_UNITS[unit][0]}" for name in names]]
    titles += [list(place)] if unit == "metre" else []
    for number, (east, north) in enumerate(titles):
        found = read_points(table(tmp_path / f"{number}.csv", f"name,{east},{north},h_m", row), MAP)
        np.testing.assert_allclose(found.xyz_m, [[580000.0, 5700000.0, 90.0]], rtol=0, atol=1e-5)
        told = [] if unit == "metre" else ["eastings-in-other-unit"]
        assert [notice.code for notice in found.notices] == told
        corners = table(tmp_path / f"{number}-corners.csv", f"id,{east},{north}", "A,0,0", "A,9,0", "A,9,9")
        if "座標" not in place[0]:
            assert read_area(corners, MAP).polygons[0].area == pytest.approx(40.5 * unit_m**2)


@pytest.mark.parametrize("name", HEIGHT_NAMES)
def test_heights__are_known_in_other_languages(name: str, tmp_path: Path) -> None:
    path = table(tmp_path / "a.csv", f"Name,Rechtswert,Hochwert,{name}", "A,580000,5700000,90")
    np.testing.assert_array_equal(read_points(path, MAP).xyz_m, [[580000.0, 5700000.0, 90.0]])
    feet = table(tmp_path / "b.csv", f"Name,Rechtswert,Hochwert,{name.removesuffix('_m')}_ft", "A,580000,5700000,300")
    assert read_points(feet, MAP).xyz_m[0, 2] == pytest.approx(91.44)


@pytest.mark.parametrize(("east", "north"), [("Längengrad", "Breitengrad"), ("Longitud", "Latitud"), ("経度", "緯度")])
def test_longitudes_and_latitudes__are_known_in_other_languages(east: str, north: str, tmp_path: Path) -> None:
    found = read_points(table(tmp_path / "a.csv", f"Name,{east},{north},h_m", "A,9.0,51.5,90"), MAP)
    np.testing.assert_allclose(found.xyz_m[0, 0], 500000.0, atol=0.01)


def test_brackets_that_change_the_meaning__are_not_dropped(tmp_path: Path) -> None:
    swapped = table(tmp_path / "a.csv", "name,X (Northing),Y (Easting),Height (NHN)", "A,5700000,580000,90")
    np.testing.assert_array_equal(read_points(swapped, MAP).xyz_m, [[580000.0, 5700000.0, 90.0]])
    two = table(tmp_path / "b.csv", "name,e_m,n_m,Height (ft),Height (m)", "A,580000,5700000,300,91.5")
    assert read_points(two, MAP).xyz_m[0, 2] == 91.5
    radians = table(tmp_path / "c.csv", "name,Longitude (rad),Latitude (rad),h_m", "A,0.17,0.9,90")
    with pytest.raises(InputError, match="no column"):
        read_points(radians, MAP)
