"""The response of a trial from tables: products, figures against the sample's truth, charts, growth, refusals."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import openpyxl
import pytest

import furrowmap
from furrowmap.cli.main import command_line
from furrowmap.core.runtime.errors import InputError, RefusedError, UsageError
from furrowmap.exporters.files.workbooks import write_workbook

RATES = np.array([0, 50, 100, 150, 200, 250, 300])
SVG = "{http://www.w3.org/2000/svg}"


def table(file: Path, seed: int, add_m: float = 0.0) -> Path:
    """Four complete blocks of the sample's curve, with sigmas of 1 cm."""
    rng, lines = np.random.default_rng(seed), ["id,block,mean_height_m,height_sigma_m"]
    for k, dose in enumerate(np.tile(RATES, 4)):
        height = 0.34 + add_m + 0.24 / (1.0 + np.exp(-0.028 * (dose - 85.0))) + rng.normal(0.0, 0.01)
        lines.append(f"{k + 1},{k // 7 + 1},{height:.4f},0.01")
    file.write_text("\n".join(lines))
    return file


def doses(file: Path) -> Path:
    file.write_text(
        "\n".join(["id,treatment,n_kg_ha", *(f"{k + 1},N{d},{d}" for k, d in enumerate(np.tile(RATES, 4)))])
    )
    return file


@pytest.fixture
def trial(tmp_path: Path) -> tuple[Path, Path]:
    return table(tmp_path / "parcels.csv", 1), doses(tmp_path / "treatments.csv")


def test_sample__its_true_heights_give_its_true_curve(shared_data: Path, tmp_path: Path) -> None:
    folder = shared_data / "uav_wheat"
    settings = furrowmap.ResponseSettings(measure="mean_height_crop_m")
    account = furrowmap.response(
        [folder / "truth" / "parcels_truth.csv"], folder / "treatments.csv", tmp_path / "out", settings
    )
    flight = account["flights"][0]
    assert flight["models"][0]["name"] == "logistic"
    left = 0.05 / (1.0 + np.exp(-0.028 * 85.0))
    plateau = 85.0 + np.log((1.0 - left) / left) / 0.028  # 95 % of the rise above the lowest dose
    assert flight["agronomic"]["low"] <= plateau <= flight["agronomic"]["high"]
    truth = {"lower": 0.340, "rise": 0.240, "gradient": 0.028, "midpoint": 85.0}
    assert flight["models"][0]["coefficients"] == pytest.approx(truth, rel=0.2)
    assert account["dose"] == "n_kg_ha"


def test_products__are_whole(trial: tuple[Path, Path], tmp_path: Path) -> None:
    account = furrowmap.response([trial[0]], trial[1], tmp_path / "out")
    written = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert sorted(account["products"]) == written
    assert set(written) >= {
        "response.json",
        "response.svg",
        "residuals.svg",
        "treatments.svg",
        "blocks.svg",
        "trial.csv",
        "trial.xlsx",
    }
    assert json.loads((tmp_path / "out" / "response.json").read_text()) == account
    book = openpyxl.load_workbook(tmp_path / "out" / "trial.xlsx")
    assert book.sheetnames == ["parcels", "treatments", "variance", "shapes", "gains"]
    fit = ["expected", "residual"]
    heads = [cell.value for cell in book["parcels"][1]]
    assert heads == ["id", "block", "height_sigma_m", "treatment", "n_kg_ha", "mean_height_m", "sigma", *fit]
    assert book["parcels"].max_row == 29
    with pytest.raises(RefusedError) as refused:
        furrowmap.response([trial[0]], trial[1], tmp_path / "out")
    assert refused.value.code == "output-exists"


def test_chart__has_a_dot_for_each_parcel_a_curve_a_band_and_the_rate(trial: tuple[Path, Path], tmp_path: Path) -> None:
    furrowmap.response([trial[0]], trial[1], tmp_path / "out")
    chart = ET.parse(tmp_path / "out" / "response.svg").getroot()
    assert chart.tag == f"{SVG}svg"
    assert len(chart.findall(f"{SVG}circle")) == 28 + 4  # and the legend
    assert 1 <= len(chart.findall(f"{SVG}polyline")) <= 6
    assert len(chart.findall(f"{SVG}polygon")) == 1
    dots = np.array([[float(c.get("cx", 0)), float(c.get("cy", 0))] for c in chart.findall(f"{SVG}circle")[:28]])
    assert (np.ptp(dots[::7, 0]), np.ptp(dots[:7, 0])) == pytest.approx((0.0, 520.8), abs=0.2)  # 300 of 318 kg/ha
    assert dots[0, 1] > dots[6, 1]  # more nitrogen, taller
    by_treatment = ET.parse(tmp_path / "out" / "treatments.svg").getroot()
    names = [each.text for each in by_treatment.findall(f"{SVG}text")]
    assert [name for name in names if name and name.startswith("N")] == [f"N{rate}" for rate in RATES]


def test_growth__between_two_days(trial: tuple[Path, Path], tmp_path: Path) -> None:
    later = table(tmp_path / "later.csv", 1, 0.2)
    settings = furrowmap.ResponseSettings(days=("2017-05-13", "2017-05-23"))
    account = furrowmap.response([trial[0], later], trial[1], tmp_path / "out", settings)
    assert [flight["day"] for flight in account["flights"]] == ["2017-05-13", "2017-05-23"]
    assert [each["rate_m_day"] for each in account["growth"]] == pytest.approx([0.02] * 28, abs=1e-9)
    assert account["growth"][0]["sigma_m_day"] == pytest.approx(0.01 * np.sqrt(2.0) / 10.0)
    assert (tmp_path / "out" / "growth.svg").is_file()
    assert "mean_height_m_2017-05-13" in (tmp_path / "out" / "trial.csv").read_text().splitlines()[0]


@pytest.mark.parametrize(
    ("settings", "code"),
    [
        (furrowmap.ResponseSettings(measure="yield_t_ha"), "parcel-table-unreadable"),
        (furrowmap.ResponseSettings(dose="p_kg_ha"), "dose-unknown"),
        (furrowmap.ResponseSettings(factors=("variety",)), "trial-column-unknown"),
        (furrowmap.ResponseSettings(days=("2017-05-23", "2017-05-24")), "response-days"),
        (furrowmap.ResponseSettings(days=("23 May",)), "usage"),
    ],
)
def test_what_does_not_fit__is_refused(
    trial: tuple[Path, Path], tmp_path: Path, settings: furrowmap.ResponseSettings, code: str
) -> None:
    with pytest.raises((InputError, UsageError)) as refused:
        furrowmap.response([trial[0]], trial[1], tmp_path / "out", settings)
    assert refused.value.code == code
    assert not (tmp_path / "out").exists()


def test_tables__of_several_days_need_them_and_each_parcel_once(trial: tuple[Path, Path], tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="2 tables need as many different days"):
        furrowmap.response([trial[0], trial[0]], trial[1], tmp_path / "out")
    twice = tmp_path / "twice.csv"
    twice.write_text("id,mean_height_m\n1,0.3\n1,0.4\n")
    with pytest.raises(InputError, match="parcel '1' is there twice"):
        furrowmap.response([twice], None, tmp_path / "out")
    with pytest.raises(InputError, match="No such file"):
        furrowmap.response([tmp_path / "none.csv"], None, tmp_path / "out")


def test_without_statsmodels_and_openpyxl__the_rest_is_there(
    trial: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "statsmodels.formula.api", None)
    account = furrowmap.response([trial[0]], trial[1], tmp_path / "out")
    assert [notice["code"] for notice in account["warnings"]] == ["variance-missing"]
    assert account["flights"][0]["variance"] is None
    assert account["flights"][0]["models"]
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    write_workbook(tmp_path / "x.xlsx", {"a": [{"b": 1}]})
    assert not (tmp_path / "x.xlsx").exists()


def test_workbook__keeps_texts_that_look_like_formulas(tmp_path: Path) -> None:
    write_workbook(tmp_path / "x.xlsx", {"a": [{"id": "=1+1", "h": float("nan")}, {"id": "2", "h": 0.5}]})
    sheet = openpyxl.load_workbook(tmp_path / "x.xlsx")["a"]
    assert [cell.value for cell in sheet[2]] == ["'=1+1", None]
    assert sheet["A2"].data_type == "s"
    assert sheet["B3"].value == 0.5


def test_command__says_what_the_trial_shows(
    trial: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["response", str(trial[0]), "--treatments", str(trial[1]), "-o", str(tmp_path / "out")]
    assert command_line(line) == 0
    words = capsys.readouterr().out
    assert "28 parcels" in words
    assert "nothing is gained" in words
    assert "F of treatment" in words


def test_sites_and_years__of_a_table_without_identifiers(shared_data: Path, tmp_path: Path) -> None:
    """Engelstad and Parks 1971: ten trials, of which those of Knoxville 1965 and 1966 show no response."""
    settings = furrowmap.ResponseSettings(
        measure="yield_dt_ha", dose_price=0.11, measure_price=1.15, sites=("location", "year")
    )
    account = furrowmap.response([shared_data / "trials" / "engelstad.csv"], None, tmp_path / "out", settings)
    (flight,) = account["flights"]
    assert account["price_ratio"] == pytest.approx(0.11 / 1.15)
    alone = {part["label"]: part for part in flight["parts"]}
    assert len(alone) == 10
    silent = [label for label, part in alone.items() if not part["models"]]
    assert silent == ["Knoxville 1965", "Knoxville 1966"]
    assert alone["Jackson 1962"]["economic"]["low"] < 140.0 < alone["Jackson 1962"]["economic"]["high"]
    assert 90.0 < flight["economic"]["value"] < 190.0


def test_published_trial__by_the_command(shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = str(shared_data / "trials" / "bachmaier_low.csv")
    prices = ["--dose-price", "0.6", "--measure-price", "110"]
    line = ["response", table, "--measure", "yield_t_ha", *prices, "-o", str(tmp_path / "out")]
    assert command_line([*line, "--model", "quadratic", "--without-blocks"]) == 0
    words = capsys.readouterr().out
    assert "The economic optimum is 199 kg/ha (95 %: 173 to above the highest dose, 260)." in words
    assert command_line([*line, "--overwrite"]) == 0
    words = capsys.readouterr().out
    assert "Shapes by weight" in words
    assert "F of block" in words
    assert "lack of fit" in words


@pytest.mark.parametrize(
    "given",
    [{"dose_price": 0.6}, {"measure_price": 110.0}, {"dose_price": 0.6, "measure_price": 110.0, "price_ratio": 0.005}],
)
def test_prices__are_both_or_a_ratio(given: dict[str, float]) -> None:
    with pytest.raises(UsageError, match="belong together"):
        furrowmap.ResponseSettings(**given)  # type: ignore[arg-type]


PAPER_DOSES = [
    [], [50, 50], [50, 100], [50, 150], [50, 200], [50, 250], [50, 50, 100], [50, 50, 150], [50, 50, 200],
    [50, 100, 50], [50, 100, 100], [50, 100, 150], [50, 50, 100, 50], [100], [200], [], [50, 50], [50, 100],
    [50, 150], [50, 150], [50, 150, 100],
]  # fmt: skip
"""Table A1 of Christiansen et al. 2017: kg/ha of nitrogen at four dates; treatments 16 to 19 with an inoculant."""


def test_plan_of_the_paper__is_dose_inoculant_and_dates(tmp_path: Path) -> None:
    """Heights of equation 3, a centimetre more with the inoculant, and two more where a third dose was given."""
    plan = ["treatment,2017-03-16,2017-04-20,2017-05-05,2017-06-07,inoculant"]
    for k, each in enumerate(PAPER_DOSES):
        cells = [*each, *[0] * (4 - len(each))]
        plan.append(",".join(map(str, [k + 1, *cells, "JumpStart" if 15 <= k < 19 else "none"])))
    (tmp_path / "plan.csv").write_text("\n".join(plan))
    rng = np.random.default_rng(4)
    rows = ["id,block,treatment,mean_height_m"]
    for k in range(84):
        treatment = k % 21
        given = PAPER_DOSES[treatment][:3]
        height = 0.34 + 0.24 / (1.0 + np.exp(-0.028 * (sum(given) - 85.0))) + rng.normal(0.0, 0.006)
        height += 0.02 * (15 <= treatment < 19) + 0.02 * (len(given) == 3)
        rows.append(f"{k + 1},{k // 21},{treatment + 1},{height:.4f}")
    (tmp_path / "heights.csv").write_text("\n".join(rows))
    settings = furrowmap.ResponseSettings(days=("2017-05-23",), factors=("inoculant",))
    account = furrowmap.response([tmp_path / "heights.csv"], tmp_path / "plan.csv", tmp_path / "out", settings)
    (flight,) = account["flights"]
    assert flight["differs"]["split"] < 0.001
    assert flight["differs"]["inoculant"] > 0.05  # the same at all doses
    assert any("different single doses differ" in sentence for sentence in flight["sentences"])
    sources = {row["source"]: row["p"] for row in flight["variance"]["rows"]}
    assert sources["inoculant"] < 0.001
    assert {part["label"] for part in flight["parts"]} == {"none", "JumpStart"}
    assert len(flight["variance"]["cells"]) == 2 * 6
    assert flight["doses"] == 6


def yields(file: Path, head: str, rows: list[str]) -> Path:
    file.write_text("\n".join([head, *rows]), encoding="utf-8")
    return file


def doubled(dose: float, k: int) -> str:
    """A yield of a parcel, in t/ha."""
    return f"{3.0 + 5.0 * (1.0 - np.exp(-0.012 * dose)) + 0.1 * np.sin(7.0 * k):.4f}"


def trial_rows(wrong: dict[int, tuple[str, str]] | None = None) -> list[str]:
    """Four blocks of the doses; cells of the dose and the yield of some rows are others."""
    rows = []
    for k, dose in enumerate(np.tile(RATES, 4).tolist()):
        cells = (wrong or {}).get(k, (str(dose), doubled(dose, k)))
        rows.append(f"{k + 1},{k // 7 + 1},{cells[0]},{cells[1]}")
    return rows


YIELD = furrowmap.ResponseSettings(measure="yield_t_ha")


def test_cells_without_a_number__leave_out_their_parcels_and_no_others(tmp_path: Path) -> None:
    """One cell of the dose and one of the yield that are texts: the result is that without the two rows."""
    head = "id,block,n_kg_ha,yield_t_ha"
    wrong = {3: ("k.A.", doubled(150, 3)), 9: ("100", "n.a."), 12: ("250", "-9999")}
    table = yields(tmp_path / "wrong.csv", head, trial_rows(wrong))
    kept = [row for k, row in enumerate(trial_rows()) if k not in wrong]
    found = furrowmap.response([table], None, tmp_path / "a", YIELD)
    expected = furrowmap.response([yields(tmp_path / "kept.csv", head, kept)], None, tmp_path / "b", YIELD)
    assert [notice["code"] for notice in found["warnings"]] == [
        "trial-cells-unread",
        "trial-cells-nodata",
        "trial-cells-unread",
    ]
    assert "'k.A.' (parcel 4)" in found["warnings"][2]["text"]
    assert found["flights"][0]["models"] == expected["flights"][0]["models"]
    assert found["flights"][0]["variance"] == expected["flights"][0]["variance"]
    assert expected["warnings"] == []


@pytest.mark.parametrize("unit", ["kg", "kg/ha"])
def test_units_behind_doses__are_read_over(tmp_path: Path, unit: str) -> None:
    head = "id,block,n_kg_ha,yield_t_ha"
    rows = [",".join([*cells[:2], f"{cells[2]} {unit}", cells[3]]) for row in trial_rows() if (cells := row.split(","))]
    found = furrowmap.response([yields(tmp_path / "unit.csv", head, rows)], None, tmp_path / "a", YIELD)
    plain = furrowmap.response([yields(tmp_path / "plain.csv", head, trial_rows())], None, tmp_path / "b", YIELD)
    assert found["flights"][0]["models"] == plain["flights"][0]["models"]
    assert found["warnings"] == []


def test_a_treatment_table__with_one_text_for_a_dose_keeps_the_others(trial: tuple[Path, Path], tmp_path: Path) -> None:
    text = trial[1].read_text(encoding="utf-8").replace("4,N150,150", "4,N150,unknown")
    trial[1].write_text(text, encoding="utf-8")
    found = furrowmap.response([trial[0]], trial[1], tmp_path / "out")
    assert [notice["code"] for notice in found["warnings"]] == ["trial-cells-unread"]
    assert "n_kg_ha: 1 of 28 cells holds no number, the first 'unknown' (parcel 4)" in found["warnings"][0]["text"]
    assert found["flights"][0]["doses"] == 7


def test_columns__may_be_stated_as_their_title_stands_in_the_table(tmp_path: Path) -> None:
    head = "Parzelle;Wiederholung;N-Düngung [kg/ha];Ertrag [t/ha]"
    rows = [row.replace(",", ";").replace(".", ",") for row in trial_rows()]
    table = yields(tmp_path / "german.csv", head, rows)
    answers = []
    for k, (measure, dose) in enumerate((("Ertrag [t/ha]", "N-Düngung [kg/ha]"), ("ertrag", "n-düngung"))):
        settings = furrowmap.ResponseSettings(measure=measure, dose=dose)
        answers.append(furrowmap.response([table], None, tmp_path / str(k), settings)["flights"][0])
    plain = yields(tmp_path / "plain.csv", "id,block,n_kg_ha,yield_t_ha", trial_rows())
    expected = furrowmap.response([plain], None, tmp_path / "plain", YIELD)["flights"][0]
    assert answers[0] == answers[1]
    assert answers[0]["models"] == expected["models"]
    assert answers[0]["variance"] == expected["variance"]
    assert len(answers[0]["blocks"]) == 4


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        (furrowmap.ResponseSettings(), "there is no column mean_height_m.*--measure: n_kg_ha, yield_t_ha"),
        (furrowmap.ResponseSettings(measure="yeld"), "there is no column yeld.*--measure: n_kg_ha, yield_t_ha"),
        (furrowmap.ResponseSettings(measure="variety"), "no cell under variety is a number.*--measure: n_kg_ha"),
        (furrowmap.ResponseSettings(measure="yield_t_ha", sites=("farm",)), "no column farm.*--site: id, .*variety"),
    ],
)
def test_a_wrong_column__is_named_with_those_that_fit(
    tmp_path: Path, settings: furrowmap.ResponseSettings, says: str
) -> None:
    rows = [f"{row},{'AB'[k % 2]}" for k, row in enumerate(trial_rows())]
    table = yields(tmp_path / "t.csv", "id,block,n_kg_ha,yield_t_ha,variety", rows)
    with pytest.raises(InputError) as refused:
        furrowmap.response([table], None, tmp_path / "out", settings)
    assert refused.value.code == "parcel-table-unreadable"
    assert re.search(says, " ".join(refused.value.lines))


def test_a_factor_without_doses__is_analysed_alone(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    value = rng.normal(8.0, 0.3, (4, 3)) + np.array([0.0, 0.5, 1.5])
    rows = [f"{k + 1},{k // 3 + 1},{'ABC'[k % 3]},{value[k // 3, k % 3]:.6f}" for k in range(12)]
    table = yields(tmp_path / "varieties.csv", "id,block,variety,yield_t_ha", rows)
    settings = furrowmap.ResponseSettings(measure="yield_t_ha", factors=("variety",))
    variance = furrowmap.response([table], None, tmp_path / "out", settings)["flights"][0]["variance"]
    value = np.round(value, 6)
    between = 4 * ((value.mean(axis=0) - value.mean()) ** 2).sum()
    assert variance["rows"][0] == pytest.approx(
        {"source": "variety", "freedom": 2, "sum_squares": between} | {n: variance["rows"][0][n] for n in ("f", "p")}
    )
    assert [each["mean"] for each in variance["means"]] == pytest.approx(value.mean(axis=0))
    assert (tmp_path / "out" / "treatments.svg").is_file()


def test_a_table_without_dose_and_treatments__says_how_to_state_them(tmp_path: Path) -> None:
    rows = [f"{k + 1},{30 * (k % 4)},{7.0 + 0.1 * k}" for k in range(12)]
    table = yields(tmp_path / "t.csv", "id,nitrogen,yield_t_ha", rows)
    found = furrowmap.response([table], None, tmp_path / "out", YIELD)
    assert [notice["code"] for notice in found["warnings"]] == ["trial-without-dose"]
    assert "Numbers are in: nitrogen" in found["warnings"][0]["text"]


def test_a_confounded_factor__is_told_and_has_no_test(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [f"{row},{'AB'[(k // 7) % 2]}" for k, row in enumerate(trial_rows())]
    table = yields(tmp_path / "t.csv", "id,block,n_kg_ha,yield_t_ha,variety", rows)
    line = ["response", str(table), "--measure", "yield_t_ha", "--factor", "variety", "-o", str(tmp_path / "out")]
    assert command_line(line) == 0
    told = capsys.readouterr()
    assert "variety is confounded with block" in told.err + told.out
    assert "F of variety" not in told.out
    account = json.loads((tmp_path / "out" / "response.json").read_text())
    assert [notice["code"] for notice in account["warnings"]] == ["trial-confounded"]
    assert sum(row["freedom"] for row in account["flights"][0]["variance"]["rows"]) == 27


def test_a_table_of_treatments__may_name_parcels_in_german(trial: tuple[Path, Path], tmp_path: Path) -> None:
    text = trial[1].read_text(encoding="utf-8").replace("id,treatment", "Parzelle,treatment")
    trial[1].write_text(text, encoding="utf-8")
    assert furrowmap.response([trial[0]], trial[1], tmp_path / "out")["flights"][0]["doses"] == 7


def test_parcels_without_a_block__are_told_where_others_have_one(tmp_path: Path) -> None:
    rows = [row.replace(",1,", ",,", 1) if k in (2, 3) else row for k, row in enumerate(trial_rows())]
    table = yields(tmp_path / "t.csv", "id,block,n_kg_ha,yield_t_ha", rows)
    found = furrowmap.response([table], None, tmp_path / "out", YIELD)
    assert [notice["code"] for notice in found["warnings"]] == ["trial-block-missing"]
    assert found["warnings"][0]["text"].startswith("2 parcels (3, 4) of 28 have no block")
    settings = furrowmap.ResponseSettings(measure="yield_t_ha", without_blocks=True)
    assert furrowmap.response([table], None, tmp_path / "alone", settings)["warnings"] == []


def test_a_spreadsheet__is_read_as_a_text_table(tmp_path: Path) -> None:
    head = ["id", "block", "n_kg_ha", "yield_t_ha"]
    wrong = {3: ("k.A.", doubled(150, 3)), 9: ("100", "<4.5")}
    cells = [row.split(",") for row in trial_rows(wrong)]
    plain = yields(tmp_path / "t.csv", ",".join(head), trial_rows(wrong))
    book = openpyxl.Workbook()
    assert book.active is not None
    book.active.append(head)
    for row in cells:
        book.active.append([float(cell) if re.fullmatch(r"[\d.]+", cell) else cell for cell in row])
    book.save(tmp_path / "t.xlsx")
    found = [
        furrowmap.response([path], None, tmp_path / path.suffix[1:], YIELD) for path in (plain, tmp_path / "t.xlsx")
    ]
    assert found[0]["flights"][0]["models"] == found[1]["flights"][0]["models"]
    assert [each["text"] for each in found[0]["warnings"]] == [each["text"] for each in found[1]["warnings"]]
    assert len(found[0]["warnings"]) == 2
