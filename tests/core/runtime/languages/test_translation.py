"""The language of the user, and texts in it."""

from __future__ import annotations

import pytest

from furrowmap.core.runtime.errors import InputError, Notice, UsageError
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.runtime.settings import LANGUAGE_VARIABLE, language_of_user, using
from furrowmap.core.session.session_file import parse_session


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
        (
            InputError("surface-unusable", path="dsm.tif", why=Text("has cells that are not square and north-up")),
            "dsm.tif：セルが正方形で北上ではありません。",
        ),
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
