"""Texts in Japanese: a template takes the values of a text over, and what is unknown stays as it is."""

from __future__ import annotations

import re
import string

import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.runtime.errors import InputError, Notice, UsageError
from furrowmap.core.runtime.languages.catalogue import HOLE, Template, catalogue, translated
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.runtime.settings import LANGUAGE_VARIABLE, language_of_user, using
from furrowmap.core.session.session_file import parse_session


def test_catalogue__takes_every_value_over_once_at_least() -> None:
    for code, table in catalogue("ja").tables.items():
        for source, target in table.items():
            used = {int(number) for number in re.findall(r"\{(\d+)\}", target)}
            numbered = {int(number) for number in re.findall(r"\{(\d+)\}", source)}  # of the lines of map tips
            assert used <= set(range(1, source.count(HOLE) + 1)) | numbered, (code, source)


@given(st.lists(st.text(string.ascii_letters + string.digits, min_size=1), min_size=2, max_size=2))
def test_template__finds_the_values_that_were_put_into_its_source(values: list[str]) -> None:
    template = Template("From … there are … °.", "{2} 度、{1} から")
    text = "From {} there are {} °.".format(*values)
    assert template.values(text) == tuple(values)
    assert template.filled(template.values(text) or ()) == f"{values[1]} 度、{values[0]} から"


def test_translated__sentence_by_sentence_and_in_lists() -> None:
    assert translated("Areas in the map's plane. The relief is lit from the north-west.", "ja") == (
        "面積は地図平面上の値です。陰影は北西からの光によります。"
    )
    assert (
        translated("3.1 ha worked in 2 passes, no strip missed.", "ja")
        == "2 行程で 3.1 ha を作業、行程間の作業残しなし。"
    )


def test_translated__leaves_what_it_does_not_know_and_all_of_english() -> None:
    assert translated("Two passes beside the barn", "ja") == "Two passes beside the barn"
    assert translated("No warnings.", "en") == "No warnings."
    with pytest.raises(ValueError, match="no catalogue"):
        translated("No warnings.", "xx")


def test_language__of_the_command_line_before_that_of_the_session_before_that_of_the_environment(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv(LANGUAGE_VARIABLE, raising=False)
    assert language_of_user() == "en"
    monkeypatch.setenv(LANGUAGE_VARIABLE, "ja")
    assert language_of_user() == "ja"
    assert language_of_user("en") == "en"
    with using(language="ja"):
        assert language_of_user("en") == "ja"
    monkeypatch.setenv(LANGUAGE_VARIABLE, "xx")
    with pytest.raises(UsageError) as refused:
        language_of_user()
    assert refused.value.code == "usage"


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (
            InputError("session-value.check-values", name="session.toml", fault=Text("trajectory.files names no file")),
            "session.toml：trajectory.files にファイルがありません。",
        ),
        (InputError("surface-unusable", path="dsm.tif", why=Text("has no CRS")), "dsm.tif：CRS がありません。"),
        (
            InputError(
                "session-unreadable", path="p.csv", why=Text("it is {kind}, not text", kind=Text("a zip archive"))
            ),
            "p.csv：テキストではなく、zip アーカイブです。",
        ),
    ],
)
def test_error__has_its_reason_in_japanese(error: InputError, said: str) -> None:
    assert error.lines_in("ja")[0] == said


def test_reasons__in_a_list_with_commas_within() -> None:
    few = Text("has {returns} returns within {radius_m:g} m{returns:, too few on all sides|}", returns=5, radius_m=0.25)
    steep = Text("lies on an edge or a steep slope")
    reasons = [Text("{name} {why_not}", name=f"P{k}", why_not=why) for k, why in ((1, few), (2, steep))]
    said = Notice("check-unused", unused=2, checks=9, reasons=reasons, more=False).text_in("ja")
    assert "P1 は周囲 0.25 m 以内の反射が 5 点で、四方に足りません；P2 は縁または急斜面にあります" in said


def test_code__between_backticks_stays_as_it_is() -> None:
    """The key `from` is a word of layers, too."""
    with pytest.raises(InputError) as refused:
        parse_session(
            'furrowmap = 1\ncrs.map = "EPSG:6677"\n[recording]\nlidar = ["a.pcap"]\ngnss = ["a.nmea"]\nfrom = 1\n'
        )
    assert '`from = "2026-06-11T14:00:00+09:00"`' in refused.value.lines_in("ja")[2]
