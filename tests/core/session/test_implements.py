"""Several implements in sessions and machine profiles."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.coverage.field_work import ImplementTracker
from furrowmap.core.geodesy.projection import map_frame
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.session.machine_file import machine_of, machine_text, parse_machine
from furrowmap.core.session.proposal import implement_table
from furrowmap.core.session.session_file import apart, parse_session, together
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.session import Implement, Session
from furrowmap.core.values.trajectory import trajectory_from_attitude

LEAST = """\
furrowmap = 1
recording = { lidar = ["a.pcap"], gnss = ["a.nmea"] }
crs = { map = "EPSG:6677" }
"""
FRONT = '[[implement]]\nname = "front roller"\nwidth_m = 2.2\nxy_m = [3.0, 0.0]\n'
REAR = '[[implement]]\nname = "rear tiller"\nwidth_m = 1.7\nxy_m = [-1.6, 0.0]\nworking_depth_m = 0.12\n'

TOOLS = st.lists(
    st.builds(
        Implement, width_m=st.floats(0.1, 12.0), xy_m=st.tuples(*[st.floats(-15, 15)] * 2), name=st.text(max_size=9)
    ),
    min_size=1,
    max_size=3,
    unique_by=lambda tool: tool.name.strip(),
)


def names(session: Session) -> list[str]:
    return [tool.name for tool in session.implements]


def test_the_rearmost__moves_the_soil_unless_another_is_stated() -> None:
    assert names(parse_session(LEAST + FRONT + REAR)) == ["rear tiller", "front roller"]
    assert names(parse_session(LEAST + REAR + FRONT)) == ["rear tiller", "front roller"]
    assert names(parse_session(LEAST + FRONT + "moves_soil = true\n" + REAR)) == ["front roller", "rear tiller"]
    assert names(parse_session(LEAST)) == []


def test_one_of_several_tables__is_as_a_single_table() -> None:
    assert parse_session(LEAST + REAR) == parse_session(LEAST + REAR.replace("[[implement]]", "[implement]"))


@given(tools=TOOLS)
def test_apart_and_together__are_the_reverse_of_each_other(tools: list[Implement]) -> None:
    data = {"implement": [msgspec.to_builtins(tool) for tool in tools]}
    split = apart(msgspec.convert(data, dict))
    again = apart(together(split))
    assert again.get("implement") == split["implement"]
    assert again.get("further_implements", []) == split["further_implements"]
    assert sorted(tool["name"] for tool in (split["implement"], *split["further_implements"])) == sorted(
        tool.name for tool in tools
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (FRONT + REAR.replace('name = "rear tiller"\n', ""), "needs a name"),
        (FRONT + REAR.replace("rear tiller", "front roller"), "have the name 'front roller'"),
        (FRONT + "moves_soil = true\n" + REAR + "moves_soil = true\n", "more than one"),
        (FRONT + REAR + FRONT.replace("roller", "a") + FRONT.replace("roller", "b"), "at most 3"),
        (FRONT.replace("2.2", "0") + REAR, "implement.width_m"),
        (FRONT + REAR.replace("1.7", "0"), "implement.width_m"),
        (FRONT.replace("3.0", "300") + REAR, "holds 300"),
        (FRONT + "states_use = 'check'\nstates = ['s', 's']\n" + REAR, "implement.states names 's' twice"),
        ("implement = []\n", "implement"),
    ],
)
def test_faults__of_any_are_refused(text: str, words: str) -> None:
    with pytest.raises(InputError) as error:
        parse_session(LEAST + text)
    assert error.value.code == "session-value"
    assert words in error.value.what


def test_keys__of_any_are_checked_and_the_inner_name_is_none() -> None:
    for text in (FRONT + REAR + "widht_m = 1\n", "further_implements = []\n"):
        with pytest.raises(InputError) as error:
            parse_session(LEAST + text)
        assert error.value.code == "session-unknown-key"


@given(tools=TOOLS)
def test_machine__keeps_all(tools: list[Implement]) -> None:
    named = [msgspec.structs.replace(tool, name=f"{number} {tool.name}") for number, tool in enumerate(tools)]
    session = msgspec.structs.replace(parse_session(LEAST), implement=named[0], further_implements=tuple(named[1:]))
    machine = machine_of(session, "Tractor")
    back = parse_machine(machine_text(machine))
    assert {tool.name: tool for tool in back.implements} == {tool.name: tool for tool in machine.implements}
    again = parse_session(LEAST + implement_table(machine))
    assert {tool.name: tool for tool in again.implements} == {tool.name: tool for tool in named}


def test_machine__refuses_what_is_no_profile() -> None:
    head = "furrowmap_machine = 1\n"
    for text in ("further_implements = []\n", FRONT + FRONT):
        with pytest.raises(InputError) as error:
            parse_machine(head + text)
        assert error.value.code == "machine-value"


def test_tools_in_one_place__are_noticed() -> None:
    near = REAR.replace("rear tiller", "seeder").replace("-1.6", "-2.4")
    t_s = np.arange(0.0, 10.0)
    still = trajectory_from_attitude(t_s, np.zeros((10, 3)), 0.0, 0.0, 0.0 * t_s, max_gap_s=2.0)
    for text, expected in ((REAR + near, True), (REAR + FRONT, False)):
        session = parse_session(LEAST + text)
        tracker = ImplementTracker(session)
        tracker.learn(still)
        found = tracker.work(still, map_frame(session.crs), None)
        texts = [notice.text for notice in found.notices if notice.code == "implements-overlap"]
        assert bool(texts) == expected
        assert all("seeder and rear tiller" in text for text in texts)
        assert any(notice.text.startswith("rear tiller: ") for notice in found.notices)
        assert [notice.code for notice in found.notices].count(
            "machine-not-known"
        ) == 1  # of the vehicle, not of a tool


@pytest.mark.parametrize("place", ["[1" + 400 * "0" + ", 0]", "[nan, 0.0]", '["3", 0]', "[]", "3.0"])
def test_a_place_that_is_none__is_refused(place: str) -> None:
    with pytest.raises(InputError):
        parse_session(LEAST + FRONT + REAR.replace("[-1.6, 0.0]", place))


def test_rosette__shows_no_implement_and_says_so() -> None:
    """Four lasers that look anywhere, as those of a Livox."""
    chance, t_s = np.random.default_rng(4), np.arange(0.0, 10.0)
    still = trajectory_from_attitude(t_s, np.zeros((10, 3)), 0.0, 0.0, 0.0 * t_s, max_gap_s=2.0)
    session = parse_session(LEAST + REAR)
    tracker = ImplementTracker(session)
    for number in range(5):
        few = np.ones(400, np.uint8)
        xyz_m = chance.uniform(-6.0, 6.0, (400, 3)).astype(np.float32)
        line, column = (np.arange(400) % 4).astype(np.uint8), np.arange(400, dtype=np.uint16)
        tracker.add_scan(Scan(number, number + np.arange(400) * 2e-4, xyz_m, few, line, column, few, few))
    assert tracker.learn(still) is None
    found = tracker.work(still, map_frame(session.crs), None)
    assert found.states is None
    assert "implement-no-rings" in {notice.code for notice in found.notices}
