"""Text without a stated code page: what is valid in two is read as the more plausible one, and that is said."""

import struct
from pathlib import Path

import geopandas as gpd
import pyproj
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.crops.parcel_areas import read_parcels
from furrowmap.core.crops.trial_tables import read_treatments
from furrowmap.core.readers.surveyed_points import read_points
from furrowmap.core.readers.text_encoding import decoded, known_page
from furrowmap.core.readers.text_table import read_table
from furrowmap.core.readers.vector_file import read_vector_layer
from furrowmap.core.runtime.errors import InputError, Notice

UTM = pyproj.CRS.from_epsg(32632)
WESTERN = (
    "Témoin", "Müller", "Größe", "Peña", "São João", "l’eau", "Forêt", "Fläche süd", "Schläge", "Ørsted", "Año", "Åker",
    "N°1", "12 m²", "naïve", "Ærø", "œuf", "blé dur", "Maïs", "Mélange", "ÉTÉ", "Hvedemark på bakken", "Città",
    "½ dose",
    "fumé à l’automne", "Süßmost", "Gårdsplads", "Kärnten", "Región", "Plantação", "élevé", "Höhe", "Brâche",
)  # fmt: skip
JAPANESE = (
    "圃場1", "北区", "東", "南", "西", "田", "畑", "麦", "対照", "試験区", "ﾎｼﾞｮｳ", "区画A", "№1", "①", "無施肥", "慣行",
    "水田", "大豆", "小麦", "きたほなみ", "コシヒカリ", "髙橋", "高さ", "標高", "点名", "圃場",
    "A区", "山﨑", "処理区３", "裸地",
)  # fmt: skip


def unreadable(why: str) -> InputError:
    return InputError("treatments-unreadable", path="t.csv", why=why)


@pytest.mark.parametrize(
    ("text", "page"), [*((text, "cp1252") for text in WESTERN), *((text, "cp932") for text in JAPANESE)]
)
def test_a_word_alone__is_read_in_its_own_code_page(text: str, page: str) -> None:
    found = decoded([text.encode(page)])
    assert found is not None
    assert (found.texts, found.page) == ([text], page)


@given(
    st.sampled_from([(WESTERN, "cp1252"), (JAPANESE, "cp932")]).flatmap(
        lambda kind: st.tuples(st.lists(st.sampled_from(kind[0]), min_size=1, max_size=12), st.just(kind[1]))
    ),
    st.sampled_from(["utf-8", None]),
)
def test_tables_of_words__in_their_own_code_page_or_in_utf_8(case: tuple[list[str], str], coding: str | None) -> None:
    words, page = case
    found = decoded([word.encode(coding or page) for word in words])
    assert found is not None
    assert found.texts == words


def test_open__is_said_where_another_code_page_is_as_valid() -> None:
    def is_open(text: str, page: str) -> bool:
        found = decoded([text.encode(page)])
        assert found is not None
        return found.open

    assert is_open("Témoin", "cp1252")
    assert is_open("北区", "cp932")
    assert not is_open("圃場1", "cp932")  # 0x8F is no character of Windows-1252
    assert not is_open("Témoin", "utf-8")
    assert not is_open("plot", "ascii")


@pytest.mark.parametrize(
    ("name", "page"),
    [
        ("932", "cp932"), ("CP932", "cp932"), ("Shift_JIS", "cp932"), ("SJIS", "cp932"), ("ANSI 932", "cp932"),
        ("windows-31j", "cp932"), ("1252", "cp1252"), ("ANSI 1252", "cp1252"), ("ISO-8859-1", "iso8859-1"),
        ("88591", "iso8859-1"), ("ISO 88591", "iso8859-1"), ("UTF-8", "utf-8"), ("65001", "utf-8"), ("1250", "cp1250"),
        ("base64", None), ("System", None), ("", None), ("cp\0", None),
    ],
)  # fmt: skip
def test_names_of_code_pages(name: str, page: str | None) -> None:
    assert known_page(name) == page


def table(folder: Path, text: str, page: str) -> Path:
    path = folder / "table.csv"
    path.write_bytes(text.encode(page))
    return path


@pytest.mark.parametrize(
    ("text", "page", "told"),
    [
        ("Témoin", "cp1252", ["code-page"]),
        ("圃場1", "cp932", []),
        ("北区", "cp932", ["code-page"]),
        ("Témoin", "utf-8", []),
        ("Témoin", "utf-8-sig", []),
        ("圃場1", "utf-16", []),
    ],
)
def test_tables__of_all_kinds_read_names_as_they_are(text: str, page: str, told: list[str], tmp_path: Path) -> None:
    def codes(notices: tuple[Notice, ...]) -> list[str]:
        return [notice.code for notice in notices]

    points = read_points(table(tmp_path, f"name,e_m,n_m,h_m\n{text},1,2,3\n", page), UTM)
    assert (points.name, codes(points.notices)) == ((text,), told)
    treatments = read_treatments(table(tmp_path, f"id,treatment\n1,{text}\n", page))
    assert (treatments.rows["1"]["treatment"], codes(treatments.notices)) == (text, told)
    corners = "".join(f"{text},{x},{y}\n" for x, y in ((0, 0), (9, 0), (9, 9)))
    parcels, notices = read_parcels(table(tmp_path, f"id,e_m,n_m\n{corners}", page), UTM)
    assert (parcels[0].id, codes(tuple(notices))) == (text, told if page != "utf-16" else [])


def test_table__in_no_known_code_page(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_bytes(b"name,e_m,n_m,h_m\n\x81\xff\x8d,1,2,3\n")
    with pytest.raises(InputError, match="neither UTF-8 nor Shift-JIS nor Windows-1252"):
        read_points(path, UTM)


def shapefile(folder: Path, names: list[str], page: str, language: int = 0, cpg: str | None = None) -> Path:
    """Parcels whose names, and the name of whose column, are in a code page."""
    path = folder / "plots.shp"
    boxes = [shapely.box(20.0 * k, 0.0, 20.0 * k + 9.0, 9.0) for k in range(len(names))]
    gpd.GeoDataFrame({"id": ["x" * 20] * len(names)}, geometry=boxes, crs=UTM).to_file(path, engine="pyogrio")
    dbf = bytearray(path.with_suffix(".dbf").read_bytes())
    dbf[29] = language
    head, width = struct.unpack("<HH", dbf[8:12])
    for k, name in enumerate(names):
        dbf[head + k * width + 1 : head + (k + 1) * width] = name.encode(page)[: width - 1].ljust(width - 1)
    path.with_suffix(".dbf").write_bytes(dbf)
    path.with_suffix(".cpg").unlink(missing_ok=True)
    if cpg is not None:
        path.with_suffix(".cpg").write_text(cpg)
    return path


@pytest.mark.parametrize(
    ("names", "page", "language", "cpg", "told"),
    [
        (["圃場1", "圃場2"], "cp932", 0, None, []),
        (["北区", "南区"], "cp932", 0, None, ["code-page"]),
        (["北区", "南区"], "cp932", 0x57, None, ["code-page"]),
        (["北区", "南区"], "cp932", 0x13, None, []),
        (["北区", "南区"], "cp932", 0, "932", []),
        (["北区", "南区"], "cp932", 0, "Shift_JIS", []),
        (["①区", "②区"], "cp932", 0, "SJIS", []),
        (["北区", "南区"], "cp932", 0, "UTF-8", ["code-page"]),
        (["Témoin", "Blé"], "cp1252", 0, None, ["code-page"]),
        (["Témoin", "Blé"], "cp1252", 0x03, None, []),
        (["Témoin", "Blé"], "cp1252", 0x57, "ISO-8859-1", []),
        (["Témoin", "圃場"], "utf-8", 0, None, []),
        (["Témoin", "圃場"], "utf-8", 0x57, "UTF-8", []),
        (["Łąka", "Żyto"], "cp1250", 0, "1250", []),
        (["Поле", "Рожь"], "cp1251", 0xC9, None, []),
        (["plot", "other"], "ascii", 0, None, []),
    ],
)
def test_shapefiles__with_and_without_a_stated_code_page(
    names: list[str], page: str, language: int, cpg: str | None, told: list[str], tmp_path: Path
) -> None:
    parcels, notices = read_parcels(shapefile(tmp_path, names, page, language, cpg), UTM)
    assert [parcel.id for parcel in parcels] == names
    assert [notice.code for notice in notices] == told


def test_shapefile__in_no_known_code_page_is_said(tmp_path: Path) -> None:
    layer = read_vector_layer(shapefile(tmp_path, ["\x81\xff\x8d", "a"], "latin-1"))
    assert [notice.key for notice in layer.notices] == ["code-page.no-known-page"]


def test_sample__of_a_japanese_shapefile(shared_data: Path) -> None:
    parcels = read_parcels(shared_data / "foreign/11-shapefile-cp932/plots.shp", UTM)[0]
    assert [parcel.id for parcel in parcels] == ["圃場1", "圃場2"]


@pytest.mark.parametrize("first", ["sep=;\n", '"sep=;"\n', "SEP=;\r\n", ""])
def test_separator_line__is_skipped(first: str, tmp_path: Path) -> None:
    points = read_points(table(tmp_path, f"{first}name;e_m;n_m;h_m\nP0;1,5;2,25;3,125\nP1;1;2;x\n", "utf-8"), UTM)
    assert points.xyz_m.tolist() == [[1.5, 2.25, 3.125]]
    parcels = read_parcels(table(tmp_path, f"{first}id;e_m;n_m\na;0;0\na;9,5;0\na;9,5;9\n", "utf-8"), UTM)[0]
    assert parcels[0].gross.area == pytest.approx(42.75)


def test_separator_line__names_any_separator(tmp_path: Path) -> None:
    found = read_table(table(tmp_path, "sep=|\nid|dose\n1|2,5\n", "utf-8"), unreadable)
    assert found.numbers("dose").tolist() == [2.5]


def test_commas_in_quotes__are_decimal_unless_they_may_be_of_thousands(tmp_path: Path) -> None:
    text = 'name,e_m,n_m,h_m\nP0,"580002,25","5700002,5","100,125"\n'
    assert read_points(table(tmp_path, text, "utf-8"), UTM).xyz_m.tolist() == [[580_002.25, 5_700_002.5, 100.125]]
    with pytest.raises(InputError, match="580,002"):
        read_points(table(tmp_path, 'name,e_m,n_m,h_m\nP0,"580,002","700,002","1,125"\n', "utf-8"), UTM)
    with pytest.raises(InputError, match="580,002"):
        read_points(table(tmp_path, 'name,e_m,n_m,h_m\nP0,"580,002","700,002",99.5\n', "utf-8"), UTM)


def test_sample__with_a_separator_line(shared_data: Path) -> None:
    points = read_points(shared_data / "foreign/20-header-words/sep.csv", UTM)
    assert len(points) == 10
    assert points.xyz_m[9].tolist() == [580_017.3, 5_700_013.7, 100.346]
