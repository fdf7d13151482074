"""Messages in every language: the same keys, parts and holes, and no English sentence."""

from __future__ import annotations

import pickle
import re
import string
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.runtime.errors import SETTING_REMEDIES, InputError, Notice, RefusedError, printable
from furrowmap.core.runtime.languages.expansions import expansions
from furrowmap.core.runtime.languages.messages import ERROR_PARTS, holes, printed, sentences
from furrowmap.core.runtime.languages.templates import Choice, Hole, fill, parts_of, walk
from furrowmap.core.runtime.languages.texts import LANGUAGES, templates

ENGLISH = re.compile(r"\b[a-z]{2,} [a-z]{2,}\b")
"""Two words of English beside each other."""
QUOTED = re.compile(
    r"'[^']*'|\"[^\"]*\"|\([^)]*--[^)]*\)|--[a-z-]+(?: [\w.,]+)?|GRANT [A-Z ,]+|（例：[^）]*）|\[[a-z_]+\] [a-z_]+"
)
"""Commands, keys and values, which are the same in every language."""
NAMES = (
    "adjusted standard GPS time",
    "adjusted standard time",
    "cloth-simulation-filter",
    "pip install",
    "furrowmap qgis install",
)
KEYS = [(key, part) for key, parts in templates("en").items() for part in parts]


@pytest.mark.parametrize("language", LANGUAGES[1:])
def test_languages__have_the_same_keys_and_parts(language: str) -> None:
    assert {key: set(parts) for key, parts in templates("en").items()} == {
        key: set(parts) for key, parts in templates(language).items()
    }


@pytest.mark.parametrize("language", LANGUAGES[1:])
def test_messages__have_the_same_holes_in_every_language(language: str) -> None:
    for key in templates("en"):
        for part, english in sentences("en", key).items():
            ours, theirs = ({hole.name for hole in walk(parts)} for parts in (english, sentences(language, key)[part]))
            assert ours == theirs, (key, part)


@pytest.mark.parametrize("language", LANGUAGES[1:])
def test_messages__are_translated_in_every_choice(language: str) -> None:
    for key, part in KEYS:
        for english, other in expansions(templates("en")[key][part], templates(language)[key][part]):
            if re.search(r"[a-z]{3,} [a-z]{3,}", _without_names(english)):
                assert re.sub(r"{\d+}", "…", other) != english, (key, part)
            assert english.count("…") >= len(set(re.findall(r"\{\d+\}", other))), (key, part)
            assert "\0" not in other, (key, part)


COUNTED = (
    "addresses|attitudes|blocks|bytes|cells|channels|chunks|clouds|columns|control points|days|epochs|features|fields|"
    "files|folders|frames|gaps|images|lines|logs|measurements|messages|packets|parcels|pauses|places|points|poses|"
    "positions|ranges|records|rows|satellites|scans|sections|sentences|sessions|stamps|surveyed points|talkers|"
    r"times(?! as | its | the | those |\.)|of the control points (?:are|take)"
)
PLURAL = re.compile(rf"(?<!x )(?<!× )(?<!Fewer than )(?<![-.,\w])1 (?:{COUNTED})\b")
MEAN_NUMBERS = {"implement-not-seen"}
"""Messages with means, such as 0.4 points."""


@pytest.mark.parametrize("language", LANGUAGES)
def test_choices_by_a_number__have_that_number_in_their_text(language: str) -> None:
    for key, part in KEYS:
        parts = list(walk(parts_of(templates(language)[key][part])))
        by_number = {each.name for each in parts if isinstance(each, Choice) and each.by_number}
        english = {each.name for each in walk(parts_of(templates("en")[key][part])) if isinstance(each, Hole)}
        assert by_number <= english, (key, part)


def test_one__is_no_plural_in_english() -> None:
    wrong = []
    for key, part in KEYS:
        parts = parts_of(templates("en")[key][part])
        said = fill(parts, {each.name: "1" for each in walk(parts)})
        if PLURAL.search(said) and key not in MEAN_NUMBERS:
            wrong.append((key, said))
    assert wrong == []


def test_choice_by_a_number__is_of_one_and_others_in_each_language() -> None:
    assert Notice("ground-control-few", used=1, fewest=3).text.startswith("Only 1 of the control points takes part:")
    assert Notice("ground-control-few", used=2, fewest=3).text.startswith("Only 2 of the control points take part:")
    assert Notice("late-packets", late=1).text == "1 packet has an earlier stamp than the one before."
    assert Notice("late-packets", late=21_001).text == "21,001 packets have an earlier stamp than the one before."
    assert list(expansions("{n} {n#point is|points are} here", "{n} 点")) == [("… points are here", "{1} 点")]


def test_japanese__is_japanese() -> None:
    for key, part in KEYS:
        for english, japanese in expansions(templates("en")[key][part], templates("ja")[key][part]):
            if re.search(r"[A-Za-z]{2}", english):
                assert re.search(r"[ぁ-ヿ一-龥（：]", japanese), (key, part, japanese)
            assert not ENGLISH.search(_without_names(japanese)), (key, part, japanese)
            assert english.count("…") >= len(set(re.findall(r"\{\d+\}", japanese))), (key, part)


def test_error_and_notice__in_japanese() -> None:
    error = InputError("no-such-file-in-a-test", what="Nothing.", meaning="Nothing.", remedy="Nothing.")
    assert error.lines_in("ja") == ("Nothing.", "Nothing.", "Nothing.")
    notice = Notice("times-none", **dict.fromkeys(holes("times-none"), 3))
    assert "時刻がありません" in notice.text_in("ja")
    assert "have no time" in notice.text
    assert notice.about("harrow").text == f"harrow: {notice.text}"
    assert notice.about("harrow").text_in("ja") == f"harrow：{notice.text_in('ja')}"


@pytest.mark.parametrize("key", SETTING_REMEDIES)
def test_setting__is_the_line_that_the_remedy_names(key: str) -> None:
    table, name, value, reason = SETTING_REMEDIES[key]
    sentences_of_key = templates("en")[key]
    assert f"{name} = {{{value}" in sentences_of_key.get("remedy", "") + sentences_of_key.get("text", "")
    assert f"[{table}]" in " ".join(sentences_of_key.values())
    values = dict.fromkeys(holes(key), 1.5)
    assert InputError(key, **values).setting == {"table": table, "key": name, "value": 1.5}
    assert InputError(key, **(values | {reason: None})).setting is None


@pytest.mark.parametrize("key", [key for key, parts in templates("en").items() if "what" in parts])
def test_part_of_an_error__is_a_value_of_another_message(key: str) -> None:
    error = InputError(key, **dict.fromkeys(holes(key), 1))
    for language in LANGUAGES:
        parts = [error.words(part).in_language(language) for part in ERROR_PARTS]
        assert [printable(part) for part in parts] == list(error.lines_in(language))


def test_setting__may_be_a_list() -> None:
    error = InputError("imu-turned.likely-upright", name="imu.csv", right="[180.0, 0.0, 0.0]")
    assert error.setting == {"table": "imu", "key": "rpy_deg", "value": [180.0, 0.0, 0.0]}


def test_error__comes_back_from_another_process() -> None:
    error = RefusedError("too-large.memory", what="a.las", needed="3 GB", free="1 GB")
    back = pickle.loads(pickle.dumps(error))
    assert type(back) is RefusedError
    assert (back.lines, back.lines_in("ja"), back.code) == (error.lines, error.lines_in("ja"), "too-large")
    assert Notice.from_error(error).text == " ".join(error.lines)


@given(st.text(string.ascii_letters + " {}", max_size=20), st.integers())
def test_template__gives_literal_braces_and_values_back(text: str, value: int) -> None:
    escaped = text.replace("{", "{{").replace("}", "}}")
    parts = parts_of(escaped + "{count:,}")
    assert parts[-1] == Hole("count", ",", "")
    assert fill(parts, {"count": f"{value:,}"}) == f"{text}{value:,}"


def test_choice__is_one_where_its_value_is_there() -> None:
    parts = parts_of("{near:Did you mean {near}?|Known: {known}.} {flag:a|b}")
    assert isinstance(parts[0], Choice)
    assert fill(parts, {"near": "run", "known": None, "flag": False}) == "Did you mean run? b"
    assert fill(parts, {"near": None, "known": "init", "flag": True}) == "Known: init. a"
    assert list(expansions("{near:Near {near}|None}", "{near:近い {near}|なし}")) == [
        ("Near …", "近い {1}"),
        ("None", "なし"),
    ]


def test_values__are_kept_as_they_are_and_printed_in_the_sentences() -> None:
    values: dict[str, object] = {"what": Path("a.las"), "packed": np.float64(1.5), "unpacked": np.int64(2), "growth": 3}
    kept = InputError("too-large", **values).values
    assert kept == {"what": "a.las", "packed": 1.5, "unpacked": 2, "growth": 3}
    assert [type(value) for value in kept.values()] == [str, float, int, int]
    assert printed("too-large", kept)["packed"] == "1.5"
    with pytest.raises(KeyError):
        InputError("too-large", what="a.las")


def test_values__have_no_passwords() -> None:
    error = InputError("no-such-file.of-cloud", path="https://me:secret@host/a.las", is_path=False)
    assert error.values == {"path": "https://me@host/a.las", "is_path": False}


def _without_names(text: str) -> str:
    text = re.sub(r"`[^`]*`", "", text)
    for name in NAMES:
        text = text.replace(name, "")
    return QUOTED.sub("", text)
