"""The form's reading and changing of a session file, against Python's own TOML reader."""

from __future__ import annotations

import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.session.examination import Examined
from furrowmap.core.session.proposal import propose_session
from furrowmap.plugin.dock.machines import add_machine

TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
NUMBER = st.integers(-(10**9), 10**9) | st.floats(allow_nan=False, allow_infinity=False)
VALUE = TEXT | NUMBER | st.booleans() | st.lists(TEXT, max_size=3) | st.lists(NUMBER, max_size=3)
KEY = st.from_regex(r"[A-Za-z0-9_-]{1,6}", fullmatch=True)
TABLES = st.dictionaries(KEY, st.dictionaries(KEY, VALUE, max_size=4), max_size=3)


@given(tables=TABLES, table=KEY, key=KEY, value=VALUE)
def test_set__changes_one_value_and_no_other(
    session_lines: ModuleType, tables: dict[str, dict[str, Any]], table: str, key: str, value: Any
) -> None:
    empty = session_lines.SessionLines("")
    for name, entries in tables.items():
        for entry, content in entries.items():
            empty.set(name, entry, content)
    written = {name: entries for name, entries in tables.items() if entries}
    assert tomllib.loads(empty.text) == written

    lines = session_lines.SessionLines(empty.text)
    lines.set(table, key, value)
    expected = {name: dict(entries) for name, entries in written.items()}
    expected.setdefault(table, {})[key] = value
    assert tomllib.loads(lines.text) == expected
    assert session_lines.SessionLines(lines.text).get(table, key) == value


@given(tables=TABLES)
def test_get__gives_what_tomllib_gives(session_lines: ModuleType, tables: dict[str, dict[str, Any]]) -> None:
    text = tomli_w.dumps(tables)
    lines = session_lines.SessionLines(text)
    for name, entries in tomllib.loads(text).items():
        for key, value in entries.items():
            assert lines.get(name, key) == value


@pytest.mark.parametrize(
    "line", ["a = [1,", 'a = """x', "[[a]", "a = null", "a = 1 2", "a = 01", "x = 2", "[b]\n[b]", "a = 1 b = 2"]
)
def test_lines__what_is_no_toml_is_refused_with_its_line(session_lines: ModuleType, line: str) -> None:
    with pytest.raises(session_lines.NotSimpleError) as raised:
        session_lines.SessionLines(f"x = 1\n{line}\n")
    assert raised.value.number == 2 + line.count("\n")


@pytest.mark.parametrize(
    ("line", "table", "key"),
    [
        ("a.b = 1", "a", "b"),
        ("a = {b = 1}", "a", "b"),
        ("a = 2026-06-11", "", "a"),
        ('"a" = 1', "", "a"),
        ("a = nan", "", "a"),
        ("a = [{b = 1}]", "", "a"),
        ("['a']\nb = 1", "a", "b"),
        ("[a]\nb = {c = 1}", "a", "b"),
        ("[a]\nb.c = 1", "a", "b"),
    ],
)
def test_lines__what_is_not_shown_is_kept_and_not_changed(
    session_lines: ModuleType, line: str, table: str, key: str
) -> None:
    text = f"x = 1\n{line}\n[other]\nz = 1\n"
    lines = session_lines.SessionLines(text)
    with pytest.raises(session_lines.NotSimpleError) as raised:
        lines.get(table, key)
    assert raised.value.number in (2, 2 + line.count("\n"))
    with pytest.raises(session_lines.NotSimpleError):
        lines.set(table, key, 2)
    assert lines.text == text
    lines.set("other", "z", 2)
    assert lines.text == text.replace("z = 1", "z = 2")
    assert lines.get("x", "y") is None


@pytest.mark.parametrize(
    "value", ["1_000", "0xff", "+1.5", "['one', \"two\"]", "[1, # first\n  2.5,\n]", '"""one\ntwo"""']
)
def test_get__reads_all_ways_to_write_a_value(session_lines: ModuleType, value: str) -> None:
    text = f"[a]\nb = {value}   # of it\nc = 1\n"
    lines = session_lines.SessionLines(text)
    known = tomllib.loads(text)["a"]
    assert (lines.get("a", "b"), lines.get("a", "c")) == (known["b"], 1)
    lines.set("a", "b", 7)
    assert lines.text == "[a]\nb = 7   # of it\nc = 1\n"


@pytest.mark.parametrize("text", ["a = 1", "a = 1\n\n\n", "a = 1\r\n[b]\r\nc = 2\r\n", "\ufeffa = 1\n", ""])
def test_text__is_as_it_was_read_but_for_what_is_set(session_lines: ModuleType, text: str) -> None:
    lines = session_lines.SessionLines(text)
    assert lines.text == text
    if text:
        lines.set("", "a", 3)
        assert lines.text == text.replace("a = 1", "a = 3") + ("" if "\n" in text else "\n")
        lines.set("", "a", 1)
        assert lines.text == text


def test_drop_key__takes_the_table_with_its_last_key(session_lines: ModuleType) -> None:
    lines = session_lines.SessionLines("[one]\nb = 2\nc = [\n1,\n]\n[two]\nb = 3\n")
    lines.drop_key("one", "c")
    assert tomllib.loads(lines.text) == {"one": {"b": 2}, "two": {"b": 3}}
    lines.drop_key("one", "b")
    lines.drop_key("two", "c")
    assert tomllib.loads(lines.text) == {"two": {"b": 3}}


def test_set__keeps_comments_and_other_lines(session_lines: ModuleType) -> None:
    text = "# above\nname = 'old'   # of the field\n\n[crs]\n# why\nmap = \"EPSG:6677\"\n"
    lines = session_lines.SessionLines(text)
    lines.set("", "name", "new")
    assert lines.text == text.replace("'old'", '"new"')


def test_drop__takes_the_table_and_leaves_the_rest(session_lines: ModuleType) -> None:
    lines = session_lines.SessionLines('a = 1\n[one]\nb = 2\n# kept\nc = "d"\n[two]\nb = 3\n')
    lines.drop("one")
    assert tomllib.loads(lines.text) == {"a": 1, "two": {"b": 3}}
    assert "# kept" in lines.text


def test_lines__read_what_init_proposes(session_lines: ModuleType, shared_data: Path) -> None:
    recordings = [shared_data / "tractor_loop" / "gnss.nmea"]
    text = propose_session([Examined.read(path) for path in recordings], recordings[0].parent).text
    lines = session_lines.SessionLines(text)
    assert lines.get("crs", "map") == tomllib.loads(text)["crs"]["map"]
    lines.set("antenna", "xyz_m", [1.0, 2.0, 3.0])
    assert tomllib.loads(lines.text)["antenna"] == {"xyz_m": [1.0, 2.0, 3.0]}


SEVERAL = """\
furrowmap = 1
[[implement]]
# in front
name = "front roller"
width_m = 2.2
[[implement]]
name = "rear tiller"   # kept
width_m = 1.7
[field]
name = "North"
"""


def test_add__makes_one_table_the_first_of_several(session_lines: ModuleType) -> None:
    lines = session_lines.SessionLines(
        'furrowmap = 1\n[implement]   # behind\nwidth_m = 1.7\n[field]\nname = "North"\n'
    )
    second = lines.add("implement")
    lines.set(second, "width_m", 1.5)
    lines.set("implement", "width_m", 1.8)
    written = tomllib.loads(lines.text)
    assert written["implement"] == [{"width_m": 1.8}, {"width_m": 1.5}]
    assert written["field"] == {"name": "North"}
    assert "# behind" in lines.text
    assert session_lines.SessionLines(lines.text).get(second, "width_m") == 1.5
    alone = session_lines.SessionLines("furrowmap = 1\n")
    assert alone.add("implement") == "implement"
    assert tomllib.loads(alone.text) == {"furrowmap": 1, "implement": {}}


def test_several_tables_of_one_name__the_first_is_edited_and_the_others_stay(session_lines: ModuleType) -> None:
    lines = session_lines.SessionLines(SEVERAL)
    assert lines.tables("implement") == ["implement", "implement[1]"]
    assert lines.tables("field") == ["field"]
    lines.set("implement", "width_m", 2.5)
    lines.set("implement", "kind", "roller")
    front, rear = tomllib.loads(lines.text)["implement"]
    assert front == {"name": "front roller", "width_m": 2.5, "kind": "roller"}
    assert rear == {"name": "rear tiller", "width_m": 1.7}
    assert "# kept" in lines.text
    lines.drop("implement")
    assert tomllib.loads(lines.text)["implement"] == [rear]
    assert lines.get("implement", "name") == "rear tiller"
    assert lines.get("field", "name") == "North"


def test_profile_that_is_added__brings_its_learned_implement_and_no_other_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FURROWMAP_MACHINES", str(tmp_path / "machines"))
    implements = '[[implement]]\nlearned = "T 1, tiller.npz"\n[[implement]]\nlearned = "../secret.npz"\n'
    (tmp_path / "passed on").mkdir()
    profile = tmp_path / "passed on" / "T 1.toml"
    profile.write_text(f"furrowmap_machine = 1\n{implements}", encoding="utf-8")
    (tmp_path / "passed on" / "T 1, tiller.npz").write_bytes(b"learned")
    (tmp_path / "secret.npz").write_bytes(b"secret")
    assert add_machine(profile) == "T 1"
    added = sorted((tmp_path / "machines").iterdir())
    assert [path.name for path in added] == ["T 1, tiller.npz", "T 1.toml"]
    assert added[0].read_bytes() == b"learned"
