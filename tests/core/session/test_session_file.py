"""The session file: what is accepted, and how everything else is refused."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import msgspec
import pytest

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.session import session_file as module
from furrowmap.core.session.opened import resolve
from furrowmap.core.session.session_file import FURTHER, load_session, parse_session
from furrowmap.core.values import session as values
from furrowmap.core.values.session import EXAMPLES, Session

LEAST = """
furrowmap = 1
[recording]
lidar = ["a.pcap"]
gnss = ["a.nmea"]
[crs]
map = "EPSG:6677"
"""


def refusal(text: str) -> InputError:
    with pytest.raises(InputError) as error:
        parse_session(text, "field.toml")
    assert "field.toml" in error.value.what
    assert all(error.value.lines)
    return error.value


def keys() -> list[tuple[str, str]]:
    """Every table ("" for the top) and key of the schema."""
    tables = {"": Session} | {
        name: part
        for name in Session.__struct_encode_fields__
        for part in vars(values).values()
        if isinstance(part, type) and issubclass(part, msgspec.Struct) and f"`[{name}]`" in (part.__doc__ or "")
    }
    found = [(name, key) for name, part in tables.items() for key in part.__struct_encode_fields__]
    return [one for one in found if one[1] not in FURTHER.values()]


def test_least__the_rest_has_its_defaults() -> None:
    session = parse_session(LEAST)
    assert session.crs.heights == "ellipsoidal"
    assert session.lidar.mounting.xyz_m == (0.0, 0.0, 0.0)
    assert session.antenna is None
    assert session.trajectory is None
    assert session.run.standing


@pytest.mark.parametrize("name", ["tractor_loop", "tractor_fishtail"])
def test_samples__are_understood(name: str, shared_data: Path) -> None:
    session = load_session(shared_data / name / "session.toml")
    assert session.antenna is not None
    assert session.implement is not None
    assert session.implement.width_m == 1.7
    assert session.lidar.rpy_deg[2] == pytest.approx(180.0, abs=2.0)


def test_keys__the_schema_has_all_tables() -> None:
    tables = {table for table, _ in keys()}
    assert tables == {
        "",
        "recording",
        "crs",
        "antenna",
        "lidar",
        "imu",
        "attitude",
        "mount",
        "implement",
        "field",
        "trajectory",
        "camera",
        "parcels",
        "features",
        "run",
        "report",
    }


@pytest.mark.parametrize(("table", "key"), keys())
def test_keys__a_misspelt_one_is_refused_with_the_nearest_known_one(table: str, key: str) -> None:
    wrong = key[:2] + key[3:] if len(key) > 3 else key + "s"
    text = LEAST if table else LEAST.replace("furrowmap = 1", f"furrowmap = 1\n{wrong} = 1")
    if table:
        head = f"[{table}]\n"
        text = text.replace(head, head + f"{wrong} = 1\n") if head in text else text + head + f"{wrong} = 1\n"
    error = refusal(text)
    path = f"{table}." if table else ""
    assert error.code == "session-unknown-key"
    assert f"`{path}{wrong}`" in error.what
    assert error.remedy == f"Did you mean `{path}{key}`?"


def test_keys__one_like_no_other_is_refused_with_all_that_are_known() -> None:
    error = refusal(LEAST + "[run]\nqwrtz = 1\n")
    assert "standing, fixes" in error.remedy


@pytest.mark.parametrize(
    ("change", "code", "words"),
    [
        (("furrowmap = 1", "furrowmap = 2"), "session-schema", "reads 1"),
        (("furrowmap = 1", ""), "session-schema", "missing"),
        (('map = "EPSG:6677"', 'map = "EPSG:6677'), "session-syntax", "line"),
        (('map = "EPSG:6677"', ""), "session-value", "map"),
        (('map = "EPSG:6677"', "map = 6677"), "session-value", "crs.map"),
        (('lidar = ["a.pcap"]', "lidar = []"), "session-value", "names no file"),
        (('gnss = ["a.nmea"]', ""), "session-value", "names no file"),
        (('lidar = ["a.pcap"]', 'lidar = "a.pcap"'), "session-value", "recording.lidar"),
        (("[crs]", '[trajectory]\nfiles = ["a"]\ntime = "tai"\n[crs]'), "session-value", "trajectory.time"),
        (("[crs]", "[trajectory]\nfiles = []\n[crs]"), "session-value", "trajectory.files"),
        (("[crs]", '[trajectory]\nfiles = ["a"]\nweek = -1\n[crs]'), "session-value", "trajectory.week"),
        (("[crs]", "[run]\nthreads = 0\n[crs]"), "session-value", "run.threads"),
        (("[crs]", 'from = "2026-06-11T14:00:00"\n[crs]'), "session-value", "offset from UTC"),
        (("[crs]", "to = 2026-06-11T14:00:00\n[crs]"), "session-value", "offset from UTC"),
        (("[crs]", "to = 2026-06-11\n[crs]"), "session-value", "offset from UTC, not a date alone"),
        (("[crs]", 'from = "two o\'clock"\n[crs]'), "session-value", "recording.from"),
        (("[crs]", "from = 2026-06-11T14:00:00Z\nto = 2026-06-11T23:00:00+09:00\n[crs]"), "session-value", "later"),
        (('"a.pcap"', '"a.pcap", "b.pcap", "./a.pcap"'), "session-value", "recording.lidar names 'a.pcap' twice"),
        (('"a.nmea"', '"a.nmea", "a.nmea"'), "session-value", "recording.gnss names 'a.nmea' twice"),
        (("[crs]", '[trajectory]\nfiles = ["t", "t"]\n[crs]'), "session-value", "trajectory.files names 't' twice"),
        (("[crs]", "[implement]\nwidth_m = 0\nxy_m = [0, 0]\n[crs]"), "session-value", "implement.width_m"),
        (("[crs]", "[implement]\nwidth_m = 0\nxy_m = [0, 0]\n[crs]"), "session-value", "must be > 0"),
        (("[crs]", "[implement]\nwidth_m = 1\nxy_m = [0, 0]\nlift_m = 1.3\n[crs]"), "session-value", "must be <= 1.2"),
        (
            ("[crs]", '[implement]\nwidth_m = 1\nxy_m = [0, 0]\nstates_use = "no"\n[crs]'),
            "session-value",
            "implement.states_use` must be 'check' or 'replace', not 'no'",
        ),
        (("[crs]", "[antenna]\nxyz_m = [0, 0]\n[crs]"), "session-value", "antenna.xyz_m"),
        (("[crs]", "[antenna]\nxyz_m = [0, nan, 0]\n[crs]"), "session-value", "antenna.xyz_m"),
        (("[crs]", "[lidar]\nrpy_deg = [0, inf, 0]\n[crs]"), "session-value", "lidar.rpy_deg"),
        (("[crs]", "lidar_minus_gnss_s = nan\n[crs]"), "session-value", "recording.lidar_minus_gnss_s"),
        (("[crs]", 'date = "11.6.2026"\n[crs]'), "session-value", "recording.date"),
        (("[crs]", '[field]\ntime_zone = "JST"\n[crs]'), "session-value", "field.time_zone 'JST' is no time zone"),
        (("[crs]", "date = 2026-06-11T01:23:40Z\n[crs]"), "session-value", "recording.date"),
    ],
)
def test_values__that_mean_nothing_are_refused(change: tuple[str, str], code: str, words: str) -> None:
    text = LEAST.replace(*change)
    assert text != LEAST
    error = refusal(text)
    assert error.code == code
    assert words in error.what


@pytest.mark.parametrize(
    ("change", "what", "remedy"),
    [
        (("furrowmap = 1", ""), "`furrowmap`, the version of the file format, is missing", "`furrowmap = 1`"),
        (('[crs]\nmap = "EPSG:6677"', ""), "table [crs] is missing", "`[crs]`"),
        (('map = "EPSG:6677"', ""), "key `crs.map` is missing", '`map = "EPSG:6677"` under [crs]'),
        (
            ('map = "EPSG:6677"', "map = 6677"),
            "`crs.map` must be text in double quotes, not a whole number",
            "EPSG:6677",
        ),
        (('["a.pcap"]', '"a.pcap"'), "`recording.lidar` must be a list in square brackets, not text", "recording.pcap"),
        (('["a.pcap"]', "[1]"), "`recording.lidar[0]` must be text in double quotes, not a whole", "recording.pcap"),
        (
            ("[crs]", "[antenna]\nxyz_m = [0, 0]\n[crs]"),
            "`antenna.xyz_m` must be a list of 3 numbers, but has 2",
            "1.62",
        ),
        (("[crs]", '[lidar]\nxyz_m = [0, 0, "1"]\n[crs]'), "`lidar.xyz_m[2]` must be a number, not text", "2.35"),
        (("[crs]", "[run]\nstanding = 1\n[crs]"), "`run.standing` must be true or false", "`standing = true`"),
        (
            ("[crs]", '[run]\nfixes = "fixed"\n[crs]'),
            "`run.fixes` must be a list in square brackets, not text",
            "float",
        ),
        (
            ("[recording]", "antenna = 3\n[recording]"),
            "table [antenna] must be a table, not a whole number",
            "[antenna]",
        ),
    ],
)
def test_values__of_the_wrong_kind_are_told_in_plain_words(change: tuple[str, str], what: str, remedy: str) -> None:
    error = refusal(LEAST.replace(*change))
    assert what in error.what
    assert remedy in error.remedy


def test_examples__there_is_one_for_every_key_and_all_are_a_session() -> None:
    tables: dict[str, list[str]] = {}
    for key, value in EXAMPLES.items():
        table, _, last = key.rpartition(".")
        tables.setdefault(table, []).append(f"{last} = {value}")
    text = "furrowmap = 1\n" + "\n".join(f"[{t}]\n".replace("[]\n", "") + "\n".join(v) for t, v in tables.items())
    parse_session(text)
    named = set(module._tables()) | {"furrowmap"}
    assert set(EXAMPLES) | named == {f"{table}.{key}" if table else key for table, key in keys()}


@pytest.mark.parametrize("line", ["[lidar]\nxyz_m", "[antenna]\nxyz_m", "[implement]\nwidth_m = 1.7\nxy_m"])
def test_places__typed_in_millimetres_are_refused(line: str) -> None:
    third = "" if "xy_m" in line else ", 2.35"
    assert parse_session(f"{LEAST}{line} = [-15, 0{third}]\n").furrowmap == 1
    error = refusal(f"{LEAST}{line} = [-550, 0{third}]\n")
    assert error.code == "session-value"
    assert "holds -550, more than" in error.what


@pytest.mark.parametrize("written", ['"2026-06-11"', "2026-06-11"])
def test_date__with_quotes_or_as_toml_has_it(written: str) -> None:
    session = parse_session(LEAST.replace("[crs]", f"date = {written}\n[crs]"))
    assert session.recording.date == "2026-06-11"


def test_trajectory__replaces_gnss() -> None:
    text = LEAST.replace('gnss = ["a.nmea"]', "") + '[trajectory]\nfiles = ["t.csv"]\n'
    session = parse_session(text)
    assert session.trajectory is not None
    assert session.trajectory.files == ("t.csv",)


def test_session__is_frozen() -> None:
    session = parse_session(LEAST)
    with pytest.raises(AttributeError):
        session.name = "other"  # type: ignore[misc]


def test_session__comes_back_from_what_it_is_written_as() -> None:
    """What a run writes down as understood is itself a session, and the same."""
    session = parse_session(LEAST)
    data: dict[str, Any] = msgspec.to_builtins(session)
    written = {k: v for k, v in data.items() if v is not None}
    assert msgspec.convert(written, Session) == session
    assert tomllib.loads(LEAST)["crs"]["map"] == written["crs"]["map"]


def test_load__refuses_what_is_no_readable_file(tmp_path: Path) -> None:
    (tmp_path / "latin.toml").write_bytes(b'name = "\xe4"')
    for path in (tmp_path, tmp_path / "none.toml", tmp_path / "latin.toml"):
        with pytest.raises(InputError) as error:
            load_session(path)
        assert error.value.code == "session-unreadable"
        assert str(path) in error.value.what


def test_resolve__stays_inside_the_sessions_folder(tmp_path: Path) -> None:
    folder = tmp_path / "field"
    (folder / "day 1").mkdir(parents=True)
    inside, outside = folder / "day 1" / "圃場.nmea", tmp_path / "secret.nmea"
    inside.write_text("x")
    outside.write_text("x")
    (folder / "link.nmea").symlink_to(outside)
    session = folder / "session.toml"
    assert resolve(session, "day 1/圃場.nmea") == inside.resolve()
    for name in ("../secret.nmea", str(outside), "link.nmea", "day 1/../../secret.nmea"):
        with pytest.raises(InputError) as error:
            resolve(session, name)
        assert error.value.code == "session-path-outside", name
    for name in ("none.nmea", "day 1", ".", "nul\0.nmea", "long" * 100):
        with pytest.raises(InputError) as error:
            resolve(session, name)
        assert error.value.code == "session-file-missing", name


@pytest.mark.parametrize("content", ["metadata.yaml", "bag_0.db3", "bag_0.mcap", "bag_0.db3.zstd"])
def test_resolve__takes_the_folder_of_a_bag_whose_files_stay_inside(content: str, tmp_path: Path) -> None:
    bag = tmp_path / "field" / "bag"
    bag.mkdir(parents=True)
    (bag / content).write_text("x")
    session = tmp_path / "field" / "session.toml"
    assert resolve(session, "bag") == bag.resolve()
    (tmp_path / "secret.db3").write_text("x")
    (bag / "bag_1.db3").symlink_to(tmp_path / "secret.db3")
    with pytest.raises(InputError) as error:
        resolve(session, "bag")
    assert error.value.code == "session-path-outside"
