"""Sections of task data: which bits and elements they are, where they lie, what is named where they cannot be used."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from furrowmap.core.coverage.task_work import task_works
from furrowmap.core.readers.isoxml.log import LoggedTask, TaskDataLog, read_tasks
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.values.sections import Link
from furrowmap.core.values.tool_states import ToolState
from tests.core.coverage.section_tasks import elements_xml
from tests.core.readers.isoxml.time_logs import Record, header, task_data

STATE, CONDENSED, WIDTH, MAXIMUM, DEFAULT, AHEAD, RIGHT, CONNECTOR = 141, 161, 67, 70, 68, 134, 135, 157
Part = tuple[str, int, int, dict[int, int]]
DEVICE: Part = ("1", 1, 0, {})
BOOM: Part = ("2", 2, 1, {})


def sections(count: int, width_mm: int = 3000, parent: int = 2, kind: str = "4", first: int = 10) -> list[Part]:
    """Sections side by side, from left to right, the middle of all at 0."""
    left_mm = -width_mm * (count - 1) // 2
    return [(kind, first + k, parent, {RIGHT: left_mm + k * width_mm, WIDTH: width_mm}) for k in range(count)]


def task_of(
    folder: Path,
    parts: Sequence[Part],
    channels: Sequence[tuple[int, str]],
    values: Sequence[Mapping[int, int]],
    more: str = "",
    connection: str = "",
    name: str = "DVC-1",
) -> LoggedTask:
    """A task whose log has a record a second, at 2 m/s northwards, with values by channel."""
    rows = [
        Record(43_200_000 + 1000 * k, 15_000, {"A": 500_000_000 + 180 * k, "B": 100_000_000, "D": 4}, one)
        for k, one in enumerate(values)
    ]
    device = elements_xml(name, parts, name="sprayer")
    body = f'{device}{more}<TSK A="TSK1" B="run" G="4">{connection}<TLG A="TLG1"/></TSK>'
    log = header(channels), b"".join(row.pack() for row in rows)
    (task,) = read_tasks(task_data(folder, body, {"TLG1": log}))[1]
    return task


def codes(task: LoggedTask) -> set[str]:
    return {notice.code for notice in (*task.notices, *task.placement_notices)} - {"local-time"}


def table(task: LoggedTask) -> list[list[int]]:
    """States of the sections from left to right in each interval."""
    assert task.sections is not None
    found: list[list[int]] = task.sections.state.tolist()
    return found


def test_condensed__lowest_bits_are_the_leftmost_section(tmp_path: Path) -> None:
    """Left in driving direction; y is to the left here, offsets in the file are to the right."""
    task = task_of(tmp_path, [DEVICE, BOOM, *sections(3)], [(CONDENSED, "DVC-1-2")], [{0: 0b010001}, {0: 0b000100}, {}])
    assert task.sections is not None
    assert [(one.y_m, one.width_m) for one in task.sections.sections] == [(3.0, 3.0), (0.0, 3.0), (-3.0, 3.0)]
    assert table(task) == [[1, 0, 1], [0, 1, 0]]
    assert task.sections.span_m == (-4.5, 4.5)
    assert task.width_m.tolist() == [6.0, 3.0, 3.0]
    assert task.states.state.tolist() == [ToolState.DOWN]


def test_condensed__order_is_by_place_not_by_the_order_of_the_file(tmp_path: Path) -> None:
    parts = [DEVICE, BOOM, *sections(3)[::-1]]
    task = task_of(tmp_path, parts, [(CONDENSED, "DVC-1-2")], [{0: 0b000001}, {}])
    assert task.sections is not None
    assert task.sections.sections[0].name.endswith(" 10")
    assert table(task) == [[1, 0, 0]]


@pytest.mark.parametrize(("bits", "state"), [(0, 0), (1, 1), (2, -1), (3, 0)])
def test_condensed__off_on_error_not_installed(bits: int, state: int, tmp_path: Path) -> None:
    values = [{0: 0b000001 | bits << 2}, {}, {}]
    assert table(task_of(tmp_path, [DEVICE, BOOM, *sections(3)], [(CONDENSED, "DVC-1-2")], values)) == [[1, state, 0]]


def test_condensed__sections_beyond_sixteen_are_in_the_next_value(tmp_path: Path) -> None:
    channels = [(CONDENSED, "DVC-1-2"), (CONDENSED + 1, "DVC-1-2")]
    first = 0x55555555
    task = task_of(tmp_path, [DEVICE, BOOM, *sections(20, 500)], channels, [{0: first, 1: 0b0100}, {}])
    assert table(task) == [[1] * 16 + [0, 1, 0, 0]]


def test_states_of_sections__before_the_first_are_unknown(tmp_path: Path) -> None:
    channels = [(STATE, f"DVC-1-{10 + k}") for k in range(3)]
    task = task_of(tmp_path, [DEVICE, BOOM, *sections(3)], channels, [{0: 1}, {1: 0}, {2: 1}, {0: 0}, {}])
    assert table(task) == [[1, -1, -1], [1, 0, -1], [1, 0, 1], [0, 0, 1]]


def test_a_section_without_any_state__beside_others_is_unknown(tmp_path: Path) -> None:
    channels = [(STATE, "DVC-1-10"), (STATE, "DVC-1-12")]
    task = task_of(tmp_path, [DEVICE, BOOM, *sections(3)], channels, [{0: 1, 1: 0}, {}])
    assert table(task) == [[1, -1, 0]]


def test_master__off_is_off_for_all_its_sections(tmp_path: Path) -> None:
    channels = [(CONDENSED, "DVC-1-2"), (STATE, "DVC-1-1")]
    values = [{0: 0b010101, 1: 1}, {1: 0}, {1: 1}, {}]
    assert table(task_of(tmp_path, [DEVICE, BOOM, *sections(3)], channels, values)) == [[1] * 3, [0] * 3, [1] * 3]


def test_units__stand_for_sections_where_there_are_none(tmp_path: Path) -> None:
    parts = [DEVICE, BOOM, *sections(4, 750, kind="5")]
    task = task_of(tmp_path, parts, [(CONDENSED, "DVC-1-2")], [{0: 0b01000001}, {}])
    assert table(task) == [[1, 0, 0, 1]]


@pytest.mark.parametrize(("ddi", "more"), [(WIDTH, {}), (MAXIMUM, {DEFAULT: 1000}), (DEFAULT, {})])
def test_widths__actual_then_maximum_then_default(ddi: int, more: dict[int, int], tmp_path: Path) -> None:
    parts = [(kind, own, parent, {RIGHT: stated[RIGHT], ddi: 3000} | more) for kind, own, parent, stated in sections(3)]
    task = task_of(tmp_path, [DEVICE, BOOM, *parts], [(CONDENSED, "DVC-1-2")], [{0: 0b010101}, {}])
    assert task.sections is not None
    assert [one.width_m for one in task.sections.sections] == [3.0] * 3


def test_widths__of_sections_that_are_off_are_not_0(tmp_path: Path) -> None:
    """A log that sets the actual width of a section to 0 while it is off."""
    parts = [(kind, own, parent, {RIGHT: stated[RIGHT]}) for kind, own, parent, stated in sections(2)]
    channels = [(CONDENSED, "DVC-1-2"), (WIDTH, "DVC-1-10"), (WIDTH, "DVC-1-11")]
    task = task_of(tmp_path, [DEVICE, BOOM, *parts], channels, [{0: 5, 1: 3000, 2: 3000}, {0: 1, 2: 0}, {}])
    assert task.sections is not None
    assert [one.width_m for one in task.sections.sections] == [3.0, 3.0]
    assert task.width_m.tolist() == [6.0, 3.0, 3.0]


def test_places__without_offsets_sections_lie_side_by_side_by_their_numbers(tmp_path: Path) -> None:
    parts: list[Part] = [("4", 10 + k, 2, {WIDTH: 1000 * (k + 1)}) for k in range(3)]
    task = task_of(tmp_path, [DEVICE, BOOM, *parts], [(CONDENSED, "DVC-1-2")], [{0: 0b010101}, {}])
    assert task.sections is not None
    assert [(one.y_m, one.width_m) for one in task.sections.sections] == [(2.5, 1.0), (1.0, 2.0), (-1.5, 3.0)]
    assert "sections-side-by-side" in codes(task)


def test_places__ahead_are_those_of_what_a_section_is_part_of(tmp_path: Path) -> None:
    parts: list[Part] = [("1", 1, 0, {AHEAD: -1000}), ("2", 2, 1, {AHEAD: -2500}), *sections(2)]
    own: Part = ("4", 12, 2, {RIGHT: 4500, WIDTH: 3000, AHEAD: -4000})
    task = task_of(tmp_path, [*parts, own], [(CONDENSED, "DVC-1-2")], [{0: 0b010101}, {}])
    assert task.sections is not None
    assert [one.x_m for one in task.sections.sections] == [-2.5, -2.5, -4.0]


@pytest.mark.parametrize(
    "stated",
    [
        {WIDTH: 3000},
        {RIGHT: 0},
        {RIGHT: 0, WIDTH: 0},
        {RIGHT: 0, WIDTH: 200_000},
        {RIGHT: 99_000_000, WIDTH: 3000},
        {RIGHT: 99_900, WIDTH: 3000},
    ],
)
def test_a_section_without_a_place__is_named_and_the_width_is_whole(stated: dict[int, int], tmp_path: Path) -> None:
    parts: list[Part] = [DEVICE, ("2", 2, 1, {}), *sections(2), ("4", 12, 2, stated)]
    channels = [(CONDENSED, "DVC-1-2"), (WIDTH, "DVC-1-2")]
    task = task_of(tmp_path, parts, channels, [{0: 0b010001, 1: 9000}, {}, {}])
    assert task.sections is None
    assert codes(task) == {"sections-not-placed"}
    assert task.width_m.tolist() == [9.0] * 3


@pytest.mark.parametrize("count", [0, 1, 2])
def test_states_of_more_sections_than_there_are__are_named(count: int, tmp_path: Path) -> None:
    parts = [DEVICE, BOOM, *(sections(count) if count else [])]
    task = task_of(tmp_path, parts, [(CONDENSED, "DVC-1-2")], [{0: 0b010101}, {0: 0b010000}, {}])
    assert task.sections is None
    assert codes(task) == {"sections-not-matched"}


def test_one_section__is_the_whole_machine(tmp_path: Path) -> None:
    task = task_of(tmp_path, [DEVICE, BOOM, *sections(1)], [(CONDENSED, "DVC-1-2")], [{0: 1}, {0: 0}, {}])
    assert task.sections is None
    assert codes(task) == set()
    assert task.states.state.tolist() == [ToolState.DOWN, ToolState.UP]


def test_several_functions__the_widest_counts(tmp_path: Path) -> None:
    other: Part = ("2", 3, 1, {})
    parts = [DEVICE, BOOM, other, *sections(3), *sections(3, 1000, parent=3, first=20)]
    channels = [(CONDENSED, "DVC-1-3"), (CONDENSED, "DVC-1-2")]
    task = task_of(tmp_path, parts, channels, [{0: 0b010101, 1: 0b000001}, {}])
    assert task.sections is not None
    assert task.sections.width_m == 9.0
    assert table(task) == [[1, 0, 0]]
    assert "sections-of-others" in codes(task)


@pytest.mark.parametrize("width", [{}, {WIDTH: 12_000}])
def test_another_machine__that_worked_is_named_if_it_has_a_width(width: dict[int, int], tmp_path: Path) -> None:
    other = elements_xml("DVC-5", [("1", 1, 0, width)], name="other")
    channels = [(CONDENSED, "DVC-1-2"), (STATE, "DVC-5-1")]
    task = task_of(tmp_path, [DEVICE, BOOM, *sections(2)], channels, [{0: 5, 1: 1}, {}], other)
    assert ("sections-of-others" in codes(task)) is bool(width)


def test_places__that_vary_are_named(tmp_path: Path) -> None:
    channels = [(CONDENSED, "DVC-1-2"), (RIGHT, "DVC-1-10")]
    values = [{0: 0b010101, 1: -3000}, {1: -3000}, {1: -3300}, {}]
    task = task_of(tmp_path, [DEVICE, BOOM, *sections(3)], channels, values)
    assert task.sections is not None
    assert task.sections.sections[0].y_m == 3.0
    assert "sections-shift" in codes(task)


@pytest.mark.parametrize(
    ("reference", "link"),
    [
        ({AHEAD: 1500, RIGHT: 200}, Link((0.0, 0.2), 1.5)),
        ({AHEAD: -800, RIGHT: -100}, Link((0.8, -0.1), 0.0)),
        ({AHEAD: 200}, Link((-0.2, 0.0), 0.0)),
    ],
)
def test_positions__are_those_of_the_navigation_reference(
    reference: dict[int, int], link: Link, tmp_path: Path
) -> None:
    """Ahead of the reference point it is followed by that; behind it the machine is as rigid as its course."""
    parts: list[Part] = [DEVICE, ("7", 5, 1, reference), BOOM, *sections(2)]
    task = task_of(tmp_path, parts, [(CONDENSED, "DVC-1-2")], [{0: 5}, {}])
    assert task.sections is not None
    assert task.sections.links == (link,)
    assert codes(task) == set()


def test_positions__without_a_reference_are_those_of_the_reference_point(tmp_path: Path) -> None:
    task = task_of(tmp_path, [DEVICE, BOOM, *sections(2)], [(CONDENSED, "DVC-1-2")], [{0: 5}, {}])
    assert task.sections is not None
    assert task.sections.links == ()
    assert codes(task) == {"sections-from-reference-point"}


@pytest.mark.parametrize(
    ("kind", "drawbar_mm", "links", "is_drawn"),
    [
        (1, 4000, (Link((-1.2, 0.1), 4.0), Link((0.0, 0.05), 0.0)), True),
        (3, 4000, (Link((-5.2, pytest.approx(0.15)), 0.0),), False),
        (0, 0, (Link((-1.2, pytest.approx(0.15)), 0.0),), False),
        (5, 0, (Link((-1.2, pytest.approx(0.15)), 0.0),), False),
    ],
)
def test_connectors__turn_or_not_by_their_type(
    kind: int, drawbar_mm: int, links: tuple[Link, ...], is_drawn: bool, tmp_path: Path
) -> None:
    """A tractor's connector 1.2 m behind its axle and 0.1 m to the left, the implement's 0.05 m to the right."""
    tractor = elements_xml(
        "DVC-0", [DEVICE, ("7", 2, 1, {}), ("6", 3, 1, {AHEAD: -1200, RIGHT: -100, CONNECTOR: kind})], name="tractor"
    )
    parts: list[Part] = [DEVICE, ("6", 5, 1, {AHEAD: drawbar_mm, RIGHT: 50, CONNECTOR: kind}), BOOM, *sections(2)]
    joined = '<CNN A="DVC-0" B="DVC-0-3" C="DVC-1" D="DVC-1-5"/>'
    task = task_of(tmp_path, parts, [(CONDENSED, "DVC-1-2")], [{0: 5}, {}], tractor, joined)
    assert task.sections is not None
    assert task.sections.links == links
    assert task.sections.is_drawn is is_drawn
    assert codes(task) == ({"drawbar-unknown"} if kind == 5 else set())


def test_a_train__of_two_joints_is_followed_to_the_last(tmp_path: Path) -> None:
    """A tractor, a cart, and behind it the drill with the sections; the cart's connector is 2 m behind its axle."""
    tractor = elements_xml(
        "DVC-0", [DEVICE, ("7", 2, 1, {}), ("6", 3, 1, {AHEAD: -1000, CONNECTOR: 1})], name="tractor"
    )
    cart = [DEVICE, ("6", 2, 1, {AHEAD: 3000, CONNECTOR: 1}), ("6", 3, 1, {AHEAD: -2000, CONNECTOR: 1})]
    drill: list[Part] = [DEVICE, ("6", 5, 1, {AHEAD: 5000, CONNECTOR: 1}), BOOM, *sections(2)]
    joined = (
        '<CNN A="DVC-2" B="DVC-2-3" C="DVC-1" D="DVC-1-5"/><CNN A="DVC-0" B="DVC-0-3" C="DVC-2" D="DVC-2-2"/>'
        '<CNN A="DVC-9" B="DVC-9-1" C="DVC-1" D="DVC-1-5"/>'
    )
    more = tractor + elements_xml("DVC-2", cart, name="cart")
    task = task_of(tmp_path, drill, [(CONDENSED, "DVC-1-2")], [{0: 5}, {}], more, joined)
    assert task.sections is not None
    assert task.sections.links == (Link((-1.0, 0.0), 3.0), Link((-2.0, 0.0), 5.0))


def test_inspect__lists_the_sections(tmp_path: Path) -> None:
    task_of(tmp_path, [DEVICE, BOOM, *sections(2)], [(CONDENSED, "DVC-1-2")], [{0: 5}, {0: 4}, {}])
    facts = TaskDataLog([tmp_path], ReadOptions()).inspect().facts["tasks"]["TSK1"]["sections"]
    assert facts == [
        {"name": "sprayer 10", "left_m": 1.5, "ahead_m": 0.0, "width_m": 3.0, "working_s": 1.0},
        {"name": "sprayer 11", "left_m": -1.5, "ahead_m": 0.0, "width_m": 3.0, "working_s": 2.0},
    ]


def test_states__are_told_with_those_of_the_sections_of_all_tasks(tmp_path: Path) -> None:
    task_of(tmp_path / "a", [DEVICE, BOOM, *sections(2)], [(CONDENSED, "DVC-1-2")], [{0: 5}, {0: 4}, {}])
    states = TaskDataLog([tmp_path / "a"], ReadOptions()).states()
    assert len(states.sections) == 1
    later = states.sections[0].later(10.0)
    np.testing.assert_allclose(later.begin_s - states.sections[0].begin_s, 10.0)


def test_ground__of_a_section_of_unknown_state_is_in_doubt(tmp_path: Path) -> None:
    """It is not counted as worked, not as missed, and makes the area less certain."""
    figures = []
    for bits in (0b010001, 0b011001):  # the middle one of three is off, or has an error
        values: list[dict[int, int]] = [{0: bits}, *({} for _ in range(200))]
        task_of(tmp_path / str(bits), [DEVICE, BOOM, *sections(3)], [(CONDENSED, "DVC-1-2")], values)
        (work,) = task_works(tmp_path / str(bits)).works
        assert work.work.ground is not None
        figures.append(work.work.ground.figures)
    off, in_doubt = figures
    assert off.worked.grid_m2 == pytest.approx(400.0 * 6.0, rel=0.01)
    assert in_doubt.worked.grid_m2 == pytest.approx(off.worked.grid_m2)
    assert off.missed.grid_m2 == pytest.approx(400.0 * 3.0, rel=0.01)
    assert in_doubt.missed.grid_m2 == 0.0
    assert in_doubt.worked.sigma_m2 > off.worked.sigma_m2 + 300.0
