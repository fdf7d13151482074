"""Treatments of parcels: tables by parcel and by treatment, doses by date, spreadsheets, and what is refused."""

from __future__ import annotations

import datetime as dt
import sys
from pathlib import Path

import openpyxl
import pytest
import shapely
from pyproj import CRS

from furrowmap.core.crops.parcel_areas import read_parcels
from furrowmap.core.crops.trial_tables import read_treatments, with_treatments
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.parcel import Parcel

BOX = shapely.box(0.0, 0.0, 10.0, 2.5)
PARCELS = [Parcel(str(k), BOX, BOX, None, {"treatment": float(t)}) for k, t in ((7, 1), (18, 2), (8, 7))]
DAY = dt.date(2017, 5, 23)
PLAN = [
    ["Treatment", "2017-03-16", "2017-04-20", "2017-05-05", "2017-06-07"],
    [1, 0, None, None, None],
    [2, 50, 50, None, None],
    [7, 50, 50, 100, 50],
]
"""Treatments 1, 2 and 7 of Christiansen et al. 2017, table A1, the last with a dose after the flight."""


def csv(path: Path, rows: list[list[object]]) -> Path:
    path.write_text("\n".join(";".join("" if cell is None else str(cell) for cell in row) for row in rows))
    return path


def sheet(path: Path, rows: list[list[object]]) -> Path:
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append(row)
    book.save(path)
    return path


def test_doses_by_date__are_summed_up_to_the_day_of_the_flight(tmp_path: Path) -> None:
    for file in (csv(tmp_path / "plan.csv", PLAN), sheet(tmp_path / "plan.xlsx", PLAN)):
        done, notices = with_treatments(PARCELS, read_treatments(file, DAY))
        assert [parcel.attributes["dose"] for parcel in done] == [0.0, 100.0, 200.0]
        assert done[2].attributes["dose_by_day"] == "03-16: 50, 04-20: 50, 05-05: 100"
        assert not notices
        late, _ = with_treatments(PARCELS, read_treatments(file, dt.date(2017, 6, 7)))
        assert late[2].attributes["dose"] == 250.0


def test_days_of_a_spreadsheet__are_columns_as_well(tmp_path: Path) -> None:
    head = ["id", *(dt.date.fromisoformat(str(day)) for day in PLAN[0][1:])]
    file = sheet(tmp_path / "plan.xlsx", [head, [7, 0, 0, 0, 0], [8, 50.5, 50, 100, 50]])
    done, notices = with_treatments(PARCELS, read_treatments(file, DAY))
    assert done[2].attributes["dose"] == 200.5
    assert [(notice.code, notice.text) for notice in notices] == [
        ("treatments-missing", "plan.xlsx has no treatment for 1 parcel (18).")
    ]


def test_rows_with_a_date__are_summed(tmp_path: Path) -> None:
    rows = [["plot", "date", "n_kg_ha", "variety"], [7, "2017-03-16", "50,5", "Benchmark"], [7, "2017-06-07", 9, ""]]
    done, _ = with_treatments(PARCELS, read_treatments(csv(tmp_path / "t.csv", rows), DAY))
    assert done[0].attributes == {
        "treatment": 1.0,
        "n_kg_ha": 50.5,
        "n_kg_ha_by_day": "03-16: 50.5",
        "variety": "Benchmark",
    }


def test_units_behind_doses_by_date__are_read_over(tmp_path: Path) -> None:
    plan = [["Treatment", "2017-03-16", "2017-04-20"], [1, "0 kg", ""], [2, "50 kg", "50,5 kg"], [7, "60 kg", ""]]
    done, _ = with_treatments(PARCELS, read_treatments(csv(tmp_path / "plan.csv", plan), DAY))
    assert [parcel.attributes["dose"] for parcel in done] == [0.0, 100.5, 60.0]
    rows = [["plot", "date", "n", "remark"], [7, "2017-03-16", "50 kg", "late"], [7, "2017-04-20", "9 kg", "2"]]
    done, _ = with_treatments(PARCELS, read_treatments(csv(tmp_path / "rows.csv", rows), DAY))
    assert (done[0].attributes["n"], done[0].attributes["remark"]) == (59.0, "late")


def test_a_block__of_the_table_is_that_of_the_parcel(tmp_path: Path) -> None:
    file = csv(tmp_path / "t.csv", [["id", "rep", "treatment"], [7, 1, "N0"], [8, 2, "N50"]])
    done, _ = with_treatments(PARCELS, read_treatments(file))
    assert [parcel.block for parcel in done] == ["1", None, "2"]
    assert done[0].attributes["treatment"] == "N0"


@pytest.mark.parametrize(
    ("rows", "code", "says"),
    [
        ([["id", "n_kg_ha"], [7, 0], [99, 50]], "treatments-unknown", r"1 parcel \(99\)"),
        ([["id", "n_kg_ha"], [7, 0], [7, 50]], "treatments-twice", "line 3: id 7"),
        ([["id", "2017-03-16"], [7, "fifty"]], "treatments-unreadable", "'fifty' under 2017-03-16"),
        ([["id", "2017-03-16"], [7, "50"], [8, "-9999"]], "treatments-unreadable", "'-9999' under 2017-03-16"),
        (
            [["id", "date", "n"], [7, "2017-03-16", "50 kg"], [7, "2017-04-20", "k.A."], [8, "2017-04-20", "9 kg"]],
            "treatments-unreadable",
            "line 3 holds 'k.A.' under n",
        ),
        ([["id", "date", "n"], [7, "16 March", 1]], "treatments-unreadable", "'16 March' is no date"),
        ([["id", "n_kg_ha"], [None, 0]], "treatments-unreadable", "has no id"),
        ([["n_kg_ha", "x"], [1, 1]], "treatments-unreadable", "no rows under a column"),
        ([["id", "2017-13-16"], [7, 1]], "treatments-unreadable", "'2017-13-16' is no date"),
    ],
)
def test_what_is_no_table_of_treatments__is_refused(
    tmp_path: Path, rows: list[list[object]], code: str, says: str
) -> None:
    with pytest.raises(InputError, match=says) as refused:
        with_treatments(PARCELS, read_treatments(csv(tmp_path / "t.csv", rows), DAY))
    assert refused.value.code == code


def test_doses_by_date__need_the_day_of_the_flight(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="day of the flight is not known") as refused:
        read_treatments(csv(tmp_path / "plan.csv", PLAN))
    assert refused.value.code == "treatments-day"


def test_damaged_spreadsheets__are_refused(tmp_path: Path) -> None:
    whole = sheet(tmp_path / "plan.xlsx", PLAN).read_bytes()
    for name, data in (("cut.xlsx", whole[:1000]), ("none.xls", b"\xd0\xcf\x11\xe0" + bytes(600))):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(InputError, match="damaged") as refused:
            read_treatments(tmp_path / name)
        assert refused.value.code == "treatments-unreadable"
    with pytest.raises(InputError, match="No such file"):
        read_treatments(tmp_path / "missing.csv")


def test_spreadsheets__need_their_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = sheet(tmp_path / "plan.xlsx", PLAN)
    monkeypatch.setitem(sys.modules, "python_calamine", None)
    with pytest.raises(InputError, match="package python-calamine is not installed") as refused:
        read_treatments(file, DAY)
    assert refused.value.code == "extra-missing"


def test_sample__has_seven_rates_in_four_blocks(shared_data: Path) -> None:
    folder = shared_data / "uav_wheat"
    parcels = read_parcels(folder / "parcels.geojson", CRS.from_epsg(25832), (1.00, 0.11))[0]
    done, notices = with_treatments(parcels, read_treatments(folder / "treatments.csv"))
    assert not notices
    assert {parcel.attributes["n_kg_ha"] for parcel in done} == {0.0, 50.0, 100.0, 150.0, 200.0, 250.0, 300.0}
    assert all(parcel.attributes["treatment"] == f"N{parcel.attributes['n_kg_ha']:.0f}" for parcel in done)
