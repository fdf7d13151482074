"""Sentences and tables of the page on supported recordings, each tried on small recordings."""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyubx2
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from furrowmap.core.readers.isoxml.log import read_tasks
from furrowmap.core.readers.reader import GivesScans, ReadOptions, open_recording
from furrowmap.core.readers.rosbag.bag_storage import BagMessage
from furrowmap.core.readers.rosbag.cloud_messages import CloudScans
from furrowmap.core.readers.states_csv import StatesCsv
from furrowmap.core.values.gnss import Fix, GnssTrack
from furrowmap.core.values.tool_states import ToolState, ToolStates
from tests.core.readers.isoxml.time_logs import Record, header, task_data
from tests.core.readers.small_bags import T0_NS, nav_sat_fix, point_cloud, revolution, write_bag2
from tests.core.readers.small_bags import header as header_of
from tests.core.readers.test_nmea import gga, rmc
from tests.core.readers.test_sbf import pvt
from tests.core.readers.velodyne_packets import turning

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "reference" / "readers.md").read_text(encoding="utf-8")
T0_S = T0_NS * 1e-9


def stated(*sentences: str) -> None:
    """The page has these words, wherever its lines break."""
    flat = " ".join(PAGE.split())
    assert [words for words in sentences if words not in flat] == []


def rows(head: str) -> list[list[str]]:
    """The cells of the table below a head row."""
    table = re.search(r"\n\|[-| ]+\|\n((?:\|.*\n)+)", PAGE[PAGE.index(head) + len(head) :])
    assert table is not None
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in table[1].splitlines()]


def track_of(path: Path) -> GnssTrack:
    return open_recording([path], ReadOptions()).track()


def first_scan(points: Any) -> tuple[Any, set[str]]:
    decoder = CloudScans("test")
    (scan,) = decoder.push(point_cloud(T0_NS, points), BagMessage("/points", "PointCloud2", "cdr", T0_NS, b""))
    return scan, {notice.code for notice in decoder.notices()}


def names_of(field: str) -> Iterator[str]:
    (names,) = (cells[1] for cells in rows("| field of a PointCloud2 |") if cells[0] == field)
    yield from re.findall(r"`(\w+)`", names)


@pytest.mark.parametrize(
    ("own", "alias"),
    [(own, alias) for own, field in {"intensity": "intensity", "ring": "laser", "time": "time"}.items()
     for alias in names_of(field)],
)  # fmt: skip
def test_cloud__a_field_is_known_by_each_of_its_names(own: str, alias: str) -> None:
    points = revolution()
    renamed = points.view(points.dtype.newbyteorder("="))
    renamed.dtype.names = tuple(alias if name == own else name for name in points.dtype.names or ())
    expected, _ = first_scan(points)
    scan, codes = first_scan(renamed)
    assert codes == set()
    for values in ("t_s", "intensity", "laser"):
        np.testing.assert_array_equal(getattr(scan, values), getattr(expected, values))


@pytest.mark.parametrize(
    ("turn_s", "used"), [(0.0045, False), (0.0055, True), (0.012, True), (1.4, True), (1.6, False)]
)
def test_cloud__a_revolution_takes_5_ms_to_1_5_s(turn_s: float, used: bool) -> None:
    stated("the duration of a revolution, which is between 5 ms and 1.5 s")
    points = revolution()
    points["time"] = np.linspace(0, turn_s, len(points))
    scan, codes = first_scan(points)
    assert codes == (set() if used else {"no-point-times"})
    assert np.ptp(scan.t_s) == pytest.approx(turn_s if used else 0.0, abs=1e-6)


@pytest.mark.parametrize("field", ["intensity", "ring", "time"])
def test_cloud__what_a_missing_field_means(field: str) -> None:
    meaning = {cells[0]: cells[2] for cells in rows("| field of a PointCloud2 |")}
    assert meaning == {
        "coordinates": "error",
        "intensity": "0",
        "laser": "0, with a notice",
        "time": "the message's stamp for all points, with a notice",
    }
    points = revolution()
    scan, codes = first_scan(points[[name for name in points.dtype.names or () if name != field]])
    values = {"intensity": scan.intensity, "ring": scan.laser, "time": np.round(scan.t_s - T0_S, 6)}[field]
    assert set(values.tolist()) == {0}
    assert codes == {"intensity": set(), "ring": {"no-rings"}, "time": {"no-point-times"}}[field]


def test_bag__packets_are_preferred_to_clouds(tmp_path: Path) -> None:
    stated("packets in preference to clouds", "a notice lists the others")
    store, name = get_typestore(Stores.ROS2_HUMBLE), "velodyne_msgs/msg/Velodyne"
    several = "std_msgs/Header header\nvelodyne_msgs/VelodynePacket[] packets\n"
    store.register(get_types_from_msg("builtin_interfaces/Time stamp\nuint8[1206] data\n", f"{name}Packet"))
    store.register(get_types_from_msg(several, f"{name}Scan"))
    time = store.types["builtin_interfaces/msg/Time"](sec=T0_NS // 10**9, nanosec=0)
    datas = [np.frombuffer(data, np.uint8) for data in turning(160)]
    packets = [store.types[f"{name}Packet"](stamp=time, data=data) for data in datas]
    message = store.types[f"{name}Scan"](header=header_of(T0_NS, store), packets=packets)
    clouds = [("/points", T0_NS + k, point_cloud(T0_NS + k * 10**8, revolution())) for k in range(3)]
    with Writer(tmp_path / "bag", version=9) as writer:
        scans = writer.add_connection("/packets", f"{name}Scan", typestore=store)
        points = writer.add_connection("/points", "sensor_msgs/msg/PointCloud2", typestore=store)
        writer.write(scans, T0_NS, store.serialize_cdr(message, f"{name}Scan"))
        for _, at_ns, cloud in clouds:
            writer.write(points, at_ns, store.serialize_cdr(cloud, "sensor_msgs/msg/PointCloud2"))
    reader = open_recording([tmp_path / "bag"], ReadOptions())
    assert reader.inspect().facts["scans"]["topic"] == "/packets"
    assert max(len(scan) for scan in reader.scans()) > len(revolution())
    assert any(notice.code == "bag-topic-chosen" and "/points (3)" in notice.text for notice in reader.notices)


def test_bag_with_two_scanners__gives_the_topic_that_is_chosen(tmp_path: Path) -> None:
    messages = [
        (topic, T0_NS + k * 10**8, point_cloud(T0_NS + k * 10**8, revolution(seed=seed)))
        for k in range(3)
        for topic, seed in (("/front/points", 1), ("/rear/points", 2))
    ]
    bag = write_bag2(tmp_path / "bag", messages)
    reader = open_recording([bag], ReadOptions(source="/rear/points"))
    assert isinstance(reader, GivesScans)
    assert reader.inspect().facts["scans"]["sensors"] == ["/front/points", "/rear/points"]
    (scan, *_) = reader.scans()
    np.testing.assert_array_equal(np.sort(scan.xyz_m[:, 0]), np.sort(revolution(seed=2)["x"]))


@pytest.mark.parametrize(("sigma_m", "fix"), [(0.0999, "fixed"), (0.1001, "float"), (None, "float")])
def test_nav_sat_fix__the_bound_is_that_of_both_axes_together(sigma_m: float | None, fix: str, tmp_path: Path) -> None:
    stated("fixed if the horizontal standard deviation is at most 10 cm; float if it is larger or not stated")
    axis_m = sigma_m / np.sqrt(2.0) if sigma_m is not None else None
    bag = write_bag2(tmp_path / "bag", [("/fix", T0_NS, nav_sat_fix(T0_NS, 2, axis_m))])
    assert labels(track_of(bag)) == [fix]


def labels(track: GnssTrack) -> list[str]:
    return [Fix(kind).label for kind in track.fix.tolist()]


def digits_of(column: int, word: str) -> list[int]:
    """The numbers in a column of the table of qualities, in the row of a word."""
    (cells,) = (cells for cells in rows("| word | meaning |") if f"`{word}`" in cells[0])
    return [int(number) for number in re.findall(r"\b\d\b|\b10\b", cells[column])]


WORDS = ("fixed", "float", "ppp", "dgps", "pps", "single", "estimated")


@pytest.mark.parametrize("word", WORDS)
def test_quality__of_the_digits_of_gga(word: str, tmp_path: Path) -> None:
    for digit in digits_of(2, word):
        log = [gga(f"01234{k}.00", quality=digit) + rmc(f"01234{k}.00", "110626") for k in range(3)]
        (tmp_path / "log.nmea").write_bytes(b"".join(log))
        assert labels(track_of(tmp_path / "log.nmea")) == [word] * 3


@pytest.mark.parametrize("word", WORDS)
def test_quality__of_the_types_of_sbf(word: str, tmp_path: Path) -> None:
    for kind in digits_of(4, word):
        (tmp_path / "log.sbf").write_bytes(b"".join(pvt(1000 * k, mode=kind) for k in range(3)))
        assert labels(track_of(tmp_path / "log.sbf")) == [word] * 3


def pos(folder: Path, *ends: str) -> Path:
    """A solution whose rows, a second apart, end so (from Q on)."""
    head = "%  GPST  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)\n"
    lines = [f"2026/06/11 01:23:{k:02}.000  36.1  140.2  55.5  {end}\n" for k, end in enumerate(ends)]
    (folder / "solution.pos").write_text(head + "".join(lines), encoding="utf-8")
    return folder / "solution.pos"


@pytest.mark.parametrize("word", WORDS)
def test_quality__of_q_in_solutions(word: str, tmp_path: Path) -> None:
    for q in digits_of(5, word):
        assert labels(track_of(pos(tmp_path, *[f"{q}  12  0.01 0.02 0.03"] * 3))) == [word] * 3


def test_solutions__zero_means_unknown(tmp_path: Path) -> None:
    stated("A standard deviation or number of satellites of 0 means unknown.")
    track = track_of(pos(tmp_path, "1  12  0.01 0.02 0.03", "1  0  0 0.02 0.03", "1  12  0.01 0 0"))
    np.testing.assert_array_equal(track.sigma_n_m, [0.01, np.nan, 0.01])
    np.testing.assert_array_equal(track.sigma_e_m, [0.02, 0.02, np.nan])
    np.testing.assert_array_equal(track.sigma_h_m, [0.03, 0.03, np.nan])
    assert track.satellites.tolist()[0::2] == [12, 12]
    assert track.satellites[1] <= 0


def ubx(folder: Path, **values: Any) -> Path:
    """A log of a NAV-PVT, written by pyubx2."""
    usual = {
        "year": 2026,
        "month": 6,
        "day": 11,
        "hour": 1,
        "second": 40,
        "validDate": 1,
        "validTime": 1,
        "fullyResolved": 1,
        "fixType": 3,
        "gnssFixOk": 1,
        "lat": 36.1,
        "lon": 140.2,
        "height": 55500,
        "numSV": 12,
    }
    message = pyubx2.UBXMessage("NAV", "NAV-PVT", pyubx2.GET, **(usual | values))
    (folder / "log.ubx").write_bytes(message.serialize())
    return folder / "log.ubx"


UPPER_S = (np.nan, 1, 2, 5, 10, 15, 20, 30, 45, 60, 90, 120, 120)
"""Of the classes of `lastCorrectionAge`, 0 to 12 (interface description of the F9, UBX-NAV-PVT); the last is open."""


def test_ubx__age_of_corrections_is_the_upper_limit_of_its_class(tmp_path: Path) -> None:
    stated("age of corrections (the upper limit of its class)")
    found = [track_of(ubx(tmp_path, lastCorrectionAge=k)).age_s[0] for k in range(len(UPPER_S))]
    np.testing.assert_array_equal(found, UPPER_S)


def test_ubx__one_estimate_serves_both_axes(tmp_path: Path) -> None:
    stated("without it, NAV-PVT's horizontal estimate divided by √2 for either axis")
    track = track_of(ubx(tmp_path, hAcc=1414, vAcc=300))
    assert [track.sigma_e_m[0], track.sigma_n_m[0]] == pytest.approx([1.0, 1.0], abs=1e-3)
    assert track.sigma_h_m[0] == pytest.approx(0.3)


def states_of(folder: Path, text: str) -> ToolStates:
    (folder / "states.csv").write_text(text, encoding="utf-8")
    return StatesCsv([folder / "states.csv"], ReadOptions()).states()


def test_states__seconds_are_preferred_and_what_is_left_out_has_its_default(tmp_path: Path) -> None:
    stated("`t_s` is preferred if both are there", "0 to 1; default 1", "the same in each row; default 0")
    states = states_of(tmp_path, "time,state,t_s\n2026-06-11T08:00:00Z,down,100\n2026-06-11T07:00:00Z,up,200\n")
    assert states.begin_s.tolist() == [100.0, 200.0]
    assert states.confidence.tolist() == [1.0, 1.0]
    assert states.common_share == 0.0
    assert np.isnan(states.begin_sigma_s).all()
    text = "t_s,state,sigma_s,confidence,common_share\n100,down,0.2,0.7,0.4\n200,up,,,0.4\n"
    states = states_of(tmp_path, text)
    assert states.confidence.tolist() == [0.7, 1.0]
    assert states.common_share == 0.4
    np.testing.assert_array_equal(states.begin_sigma_s, [0.2, np.nan])


def log_of(folder: Path, channels: list[tuple[int, str]], device: str, values: list[dict[int, int]]) -> Any:
    """The task of a time log with a record a second and these values."""
    place = {"A": 500_000_000, "B": 100_000_000, "D": 4}
    packed = [
        Record(36_000_000 + 1000 * k, 15_000, place | {"A": place["A"] + 200 * k}, row) for k, row in enumerate(values)
    ]
    body = f'<TSK A="TSK1" B="run" G="4"><TLG A="TLG00001" C="1"/></TSK><DVC A="DVC1">{device}</DVC>'
    logs = {"TLG00001": (header(channels), b"".join(record.pack() for record in packed))}
    (task,) = read_tasks(task_data(folder / "TASKDATA", body, logs))[1]
    return task


BEGIN_S = dt.datetime(1980, 1, 1, 10, tzinfo=dt.UTC).timestamp() + 15_000 * 86_400
"""10:00 of day 15,000; time logs count days from 1980."""
DEVICE = '<DET A="DET-1" B="1" C="1" F="0"/>'
SECTIONS = DEVICE + '<DET A="DET-2" B="2" C="4" F="1"/><DET A="DET-3" B="3" C="4" F="1"/>'
FUNCTIONS = DEVICE + '<DET A="DET-2" B="2" C="2" F="1"/><DET A="DET-3" B="3" C="2" F="1"/>'


def test_task_data__works_if_any_of_the_smallest_elements_does(tmp_path: Path) -> None:
    stated("The machine works if any of its smallest elements with a state works.")
    channels = [(141, "DET-1"), (141, "DET-2"), (141, "DET-3")]
    values = [{0: 1, 1: 0, 2: 0}, {0: 1, 1: 1, 2: 0}, {0: 0, 1: 0, 2: 1}, {0: 0, 1: 1, 2: 1}]
    task = log_of(tmp_path, channels, SECTIONS, values)
    assert task.state.tolist() == [ToolState.UP, ToolState.DOWN, ToolState.DOWN, ToolState.DOWN]


@pytest.mark.parametrize(("device", "width_m"), [(SECTIONS, [5.0, 2.0, 3.0]), (FUNCTIONS, [3.0, 3.0, 3.0])])
def test_task_data__widths_of_sections_are_added_and_of_functions_the_largest_counts(
    device: str, width_m: list[float], tmp_path: Path
) -> None:
    stated("Widths of working sections are added; of functions one after the other, the largest width is used.")
    channels = [(141, "DET-2"), (141, "DET-3"), (67, "DET-2"), (67, "DET-3")]
    widths = {2: 2000, 3: 3000}
    task = log_of(tmp_path, channels, device, [{0: 1, 1: 1, **widths}, {0: 1, 1: 0}, {0: 0, 1: 1}])
    assert task.width_m.tolist() == width_m


@pytest.mark.parametrize(("ahead_h", "used"), [(0.0, True), (-14.9, True), (14.9, True), (15.1, False), (-15.1, False)])
def test_task_data__gps_time_is_used_within_15_hours(ahead_h: float, used: bool, tmp_path: Path) -> None:
    """Records have the terminal's clock and, as attributes H and I, milliseconds and day of GPS time."""
    stated("If records also have GPS time, with a steady difference of less than 15 hours, that is used")
    gps_ms, day_ms = 36_000_000, 86_400_000
    records = []
    for k in range(30):
        own = 15_000 * day_ms + gps_ms + 1000 * k + round(3_600_000 * ahead_h)
        place = {"A": 500_000_000 + 200 * k, "B": 100_000_000, "D": 4, "H": gps_ms + 1000 * k, "I": 15_000}
        records.append(Record(own % day_ms, own // day_ms, place, {0: 1}).pack())
    body = '<TSK A="TSK1" B="run" G="4"><TLG A="TLG00001" C="1"/></TSK>'
    logs = {"TLG00001": (header([(141, "DET-1")], "ABDHI"), b"".join(records))}
    (task,) = read_tasks(task_data(tmp_path / "TASKDATA", body, logs))[1]
    begin_s = (
        dt.datetime(1980, 1, 1, tzinfo=dt.UTC).timestamp()
        + 15_000 * 86_400
        + gps_ms / 1000.0
        + 3600.0 * ahead_h * (not used)
    )
    assert task.track.t_s[0] == pytest.approx(begin_s, abs=1e-3)
    codes = {notice.code for notice in task.notices}
    assert ("gps-time-unused" in codes, "clock-by-gps" in codes) == (not used, used and ahead_h != 0.0)


@pytest.mark.parametrize(("ddi", "state"), [(160, "unknown"), (161, "down"), (176, "down"), (177, "unknown")])
def test_task_data__entries_of_condensed_states(ddi: int, state: str, tmp_path: Path) -> None:
    stated("work state (data dictionary entry 141), condensed work states (161 to 176)")
    task = log_of(tmp_path, [(ddi, "DET-1")], DEVICE, [{0: 1}, {0: 1}])
    assert {ToolState(one).label for one in task.state.tolist()} == {state}
