"""Line scanners in bags and in CSV: each return at its time and place."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import furrowmap
from furrowmap.core.readers.line_csv import LineCsv
from furrowmap.core.readers.reader import ReadOptions, Recognised
from furrowmap.core.readers.rosbag.bags import RosBag2
from furrowmap.core.readers.source import Head
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.session.examination import Examined
from furrowmap.core.session.proposal import propose_session
from furrowmap.core.session.session_file import parse_session
from furrowmap.core.values.scan import Scan
from tests.core.readers.small_bags import ROS2, T0_NS, header, write_bag2

T0_S = 1_779_529_272.0


def laser_scan(stamp_ns: int, ranges: Any, step: float = np.radians(0.5), each_s: float = 5e-5, **parts: Any) -> Any:
    """Ranges from −135° on; limits of 0.1 and 30 m."""
    return ROS2.types["sensor_msgs/msg/LaserScan"](
        header=header(stamp_ns),
        angle_min=parts.get("first", np.radians(-135.0)),
        angle_max=0.0,
        angle_increment=step,
        time_increment=each_s,
        scan_time=0.025,
        range_min=0.1,
        range_max=30.0,
        ranges=np.asarray(ranges, np.float32),
        intensities=np.asarray(parts.get("intensities", []), np.float32),
    )


def bag(tmp_path: Path, *messages: Any, apart_ns: int = 25_000_000) -> RosBag2:
    recorded = [("/scan", T0_NS + apart_ns * k, message) for k, message in enumerate(messages)]
    return RosBag2([write_bag2(tmp_path / "bag", recorded)], ReadOptions())


def test_laser_scan__gives_each_return_its_time_and_place(tmp_path: Path) -> None:
    ranges = np.linspace(1.0, 20.0, 540)
    ranges[[3, 50, 51, 52, 539]] = (0.05, np.nan, np.inf, 31.0, 0.0)
    message = laser_scan(T0_NS, ranges, intensities=np.arange(540))
    reader = bag(tmp_path, message)
    (scan,) = reader.scans()
    kept = np.setdiff1d(np.arange(540), [3, 50, 51, 52, 539])
    place = ranges[kept] * np.exp(1j * np.radians(-135.0 + 0.5 * kept))
    np.testing.assert_allclose(scan.xyz_m, np.column_stack([place.real, place.imag, 0 * kept]), atol=1e-4)
    np.testing.assert_allclose(scan.t_s, T0_NS * 1e-9 + 5e-5 * kept, atol=1e-6)
    np.testing.assert_array_equal(scan.intensity, kept)
    np.testing.assert_array_equal(scan.column, kept)
    facts = reader.inspect().facts["scans"]
    assert (facts["scans"], facts["points"], facts["angle_step_deg"]) == (1, 535, 0.5)


def test_laser_scans__with_faults_are_left_out_or_noted(tmp_path: Path) -> None:
    good = np.full(100, 4.0)
    messages = (
        laser_scan(T0_NS, good, each_s=0.0),
        laser_scan(T0_NS, good),  # not later
        laser_scan(T0_NS + 10**8, good, step=np.nan),
        laser_scan(T0_NS + 2 * 10**8, good, step=1.0),
        laser_scan(T0_NS + 3 * 10**8, good, each_s=-1e-3),
        laser_scan(T0_NS + 4 * 10**8, np.full(100, np.inf)),
        laser_scan(T0_NS + 5 * 10**8, good),
    )
    reader = bag(tmp_path, *messages)
    assert [len(scan) for scan in reader.scans()] == [100, 100]
    assert {n.code for n in reader.notices} == {"no-point-times", "clouds-late", "bag-messages-damaged"}


def line_csv(tmp_path: Path, head: str, rows: list[str]) -> LineCsv:
    path = tmp_path / "line.csv"
    path.write_text("\n".join([head, *rows, ""]), encoding="utf-8")
    return LineCsv([path], ReadOptions())


def rows_of(angles_deg: Any, each_s: float = 1e-4, range_m: float = 5.0) -> list[str]:
    return [f"{T0_S + each_s * k:.6f},{angle:.3f},{range_m},{k % 7}" for k, angle in enumerate(angles_deg)]


HEAD = "time_unix_s,angle_deg,range_m,intensity"


@pytest.mark.parametrize(
    ("angles", "sizes"),
    [
        (np.tile(np.arange(-90, 91, 1.0), 4), [181] * 4),
        (np.tile(np.arange(90, -91, -1.0), 3), [181] * 3),
        (np.arange(100, 900) % 360.0, [260, 360, 180]),
        (np.concatenate([np.arange(0, 50), np.arange(50, 0, -1), np.arange(0, 50)]), [51, 50, 49]),
        (np.tile(np.repeat(np.arange(-90, 91, 1.0), 3), 2), [543] * 2),
        (np.tile(np.repeat(np.arange(90, -91, -1.0), 3), 2), [543] * 2),
        (np.full(40, 12.0), [40]),
    ],
    ids=["line", "clockwise", "turning", "swinging", "three-echoes", "three-echoes-clockwise", "standing"],
)
def test_csv__is_cut_into_sweeps(tmp_path: Path, angles: Any, sizes: list[int]) -> None:
    scans = list(line_csv(tmp_path, HEAD, rows_of(angles)).scans())
    assert [len(scan) for scan in scans] == sizes
    place = 5.0 * np.exp(1j * np.radians(angles))
    whole = Scan.joined(scans)
    np.testing.assert_allclose(whole.xyz_m[:, 0] + 1j * whole.xyz_m[:, 1], place, atol=1e-5)
    np.testing.assert_allclose(whole.t_s, T0_S + 1e-4 * np.arange(len(angles)), atol=1e-6)
    np.testing.assert_array_equal(whole.intensity, np.arange(len(angles)) % 7)


def test_csv__units_and_firings_without_return(tmp_path: Path) -> None:
    rows = [f"{T0_S + 0.01 * k},{0.1 * k},{'' if k == 2 else 0 if k == 4 else 1500 + k}" for k in range(8)]
    (scan,) = line_csv(tmp_path, "time_unix_s,angle_rad,range_mm", rows).scans()
    assert scan.column.tolist() == [0, 1, 3, 5, 6, 7]
    assert np.hypot(*scan.xyz_m[:, :2].T) == pytest.approx([1.5, 1.501, 1.503, 1.505, 1.506, 1.507])


def test_csv__a_pause_begins_a_sweep_and_pieces_do_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = rows_of(np.tile(np.arange(0, 90.0), 6))
    rows[200:] = [row.replace(str(int(T0_S)), str(int(T0_S) + 5)) for row in rows[200:]]
    whole = [len(scan) for scan in line_csv(tmp_path, HEAD, rows).scans()]
    assert whole == [90, 90, 20, 70, 90, 90, 90]
    monkeypatch.setattr("furrowmap.core.readers.csv_file.CSV_CHUNK_BYTES", 700)
    assert [len(scan) for scan in line_csv(tmp_path, HEAD, rows).scans()] == whole


@pytest.mark.parametrize(
    ("head", "change", "code"),
    [
        ("time_unix_s,angle,range_m,intensity", ("", ""), "missing-column"),
        (HEAD, (",5.0,", ",5000.0,"), "points-mostly-invalid"),
        (HEAD, (",5.0,", ",x,"), "not-a-number"),
    ],
)
def test_csv__faults_are_errors(tmp_path: Path, head: str, change: tuple[str, str], code: str) -> None:
    rows = [row.replace(*change) for row in rows_of(np.arange(50.0))]
    with pytest.raises(InputError) as caught:
        list(line_csv(tmp_path, head, rows).scans())
    assert caught.value.code == code


def test_csv__rows_out_of_order(tmp_path: Path) -> None:
    rows = rows_of(np.arange(300.0))
    reader = line_csv(tmp_path, HEAD, [*rows[:200], rows[100], *rows[200:]])
    assert sum(map(len, reader.scans())) == 300
    assert [notice.code for notice in reader.notices] == ["time-runs-back"]
    with pytest.raises(InputError) as caught:
        list(line_csv(tmp_path, HEAD, rows[::-1]).scans())
    assert caught.value.code == "time-disorder"


def flight(folder: Path) -> None:
    """A line scanner 2 m above the ground of a vehicle that rolls and pitches, across its track; ground at 30 m."""
    t = np.arange(0.0, 20.0, 0.02)
    angles = np.stack([8 * np.sin(t), 5 * np.cos(1.3 * t)])
    rows = [
        f"{T0_S + a:.4f},{500_000 + 1.5 * a:.4f},6134000.0,30.0,{r:.6f},{p:.6f},90.0"
        for a, r, p in zip(t, *angles, strict=True)
    ]
    head = "time_unix_s,e_m,n_m,h_m,roll_deg,pitch_deg,heading_deg"
    (folder / "trajectory.csv").write_text("\n".join([head, *rows, ""]), encoding="utf-8")
    fired = np.arange(1.0, 18.0, 0.0005)
    beam = np.radians(-60.0 + 120.0 * (fired * 10.0 % 1.0))
    roll, pitch = (np.interp(fired, t, angle) for angle in angles)
    turn = Rotation.from_euler("ZYX", np.column_stack([0 * roll, -pitch, roll]), degrees=True)
    down = turn.apply(np.column_stack([0 * beam, np.sin(beam), -np.cos(beam)]))
    height = turn.apply([0.0, 0.0, 2.0])[:, 2]
    rows = [f"{T0_S + a:.6f},{b:.6f},{r:.5f}" for a, b, r in zip(fired, beam, -height / down[:, 2], strict=True)]
    (folder / "line.csv").write_text("\n".join(["time_unix_s,angle_rad,range_m", *rows, ""]), encoding="utf-8")


def test_run__places_a_line_scanner(tmp_path: Path) -> None:
    flight(tmp_path)
    (tmp_path / "session.toml").write_text(
        'furrowmap = 1\n[recording]\nlidar = ["line.csv"]\n[crs]\nmap = "EPSG:25832"\n[lidar]\nxyz_m = [0, 0, 2]\n'
        'rpy_deg = [0, 90, 0]\n[trajectory]\nfiles = ["trajectory.csv"]\n'.replace(
            "[0, 0, 2]", "[0.0, 0.0, 2.0]"
        ).replace("[0, 90, 0]", "[0.0, 90.0, 0.0]"),
        encoding="utf-8",
    )
    furrowmap.run(tmp_path / "session.toml", tmp_path / "result")
    cloud = laspy.read(tmp_path / "result" / "cloud.copc.laz")
    assert len(cloud.z) == 34_000
    assert np.abs(cloud.z - 30.0).max() < 0.004
    assert np.ptp(cloud.y) > 6.5
    report = json.loads((tmp_path / "result" / "report.json").read_text(encoding="utf-8"))
    assert report["figures"]["scans"] == pytest.approx(170, abs=2)


def test_init__names_a_line_scanner_as_lidar(tmp_path: Path) -> None:
    flight(tmp_path)
    assert Recognised.by_content(tmp_path / "line.csv").reader is LineCsv
    recordings = [Examined.read(tmp_path / name) for name in ("line.csv", "trajectory.csv")]
    assert recordings[0].inspection.facts["sweeps_per_s"] == pytest.approx(10.0, abs=0.1)
    proposal = propose_session(recordings, tmp_path)
    assert parse_session(proposal.text).recording.lidar == ("line.csv",)
    assert "time-overlap" in {notice.code for notice in proposal.found}


@pytest.mark.parametrize("greatest", [1.0, 0.4, 1.5])
def test_intensity__in_fractions_of_one_is_scaled_to_255(greatest: float, tmp_path: Path) -> None:
    given = np.array([0.0, 0.5 * greatest, greatest])
    (scan,) = bag(tmp_path, laser_scan(T0_NS, [5.0, 6.0, 7.0], intensities=[*given])).scans()
    factor = 255.0 if greatest <= 1.0 else 1.0
    assert scan.intensity.tolist() == np.rint(factor * given.astype(np.float32)).tolist()


def test_laser_scans__mostly_beyond_any_scanner_are_refused(tmp_path: Path) -> None:
    """The message states its own limits; millimetres with limits in millimetres are within them."""
    messages = [laser_scan(T0_NS + 25_000_000 * k, np.full(9, 5000.0)) for k in range(3)]
    for message in messages:
        message.range_max = 30_000.0
    with pytest.raises(InputError) as caught:
        list(bag(tmp_path, *messages).scans())
    assert caught.value.code == "points-mostly-invalid"


def test_csv__far_ranges_are_left_out_and_counted(tmp_path: Path) -> None:
    rows = rows_of(np.arange(50.0))
    rows[7] = rows[7].replace(",5.0,", ",5000.0,")
    reader = line_csv(tmp_path, HEAD, rows)
    (scan,) = reader.scans()
    assert scan.column.tolist() == [k for k in range(50) if k != 7]
    (notice,) = reader.notices
    assert notice.code == "points-invalid"
    assert notice.text.endswith("line.csv: 1 range beyond 2,000 m is left out.")


def test_csv__that_was_cut_within_its_compression_is_read_up_to_there(tmp_path: Path) -> None:
    rows = rows_of(np.tile(np.arange(0, 90.0), 60))
    whole = gzip.compress("\n".join([HEAD, *rows, ""]).encode())
    (tmp_path / "cut.csv.gz").write_bytes(whole[: len(whole) // 2])
    reader = LineCsv([tmp_path / "cut.csv.gz"], ReadOptions())
    points = sum(map(len, reader.scans()))
    assert 0.3 * len(rows) < points < 0.7 * len(rows)
    assert "stream-cut" in {notice.code for notice in reader.notices}


def test_csv__without_any_firing_has_no_scans_and_no_times(tmp_path: Path) -> None:
    for rows in ([], [f"{T0_S + k}," for k in range(5)], [f",{k}.0,5.0,1" for k in range(5)]):
        reader = line_csv(tmp_path, HEAD, [f"{row},," if row.count(",") == 1 else row for row in rows])
        assert list(reader.scans()) == []
        assert reader.clocks == ()
        facts = reader.inspect().facts
        assert facts["scans"] == "none"
        assert facts["points"] == 0
        assert "span_s" not in facts


def test_csv__a_sweep_without_end_is_cut(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("furrowmap.core.readers.line_csv.MAX_SWEEP_RETURNS", 40)
    scans = list(line_csv(tmp_path, HEAD, rows_of(np.arange(100.0))).scans())
    assert [len(scan) for scan in scans] == [40, 40, 20]
    assert np.concatenate([scan.t_s for scan in scans]) == pytest.approx(T0_S + 1e-4 * np.arange(100), abs=2e-6)


@pytest.mark.parametrize(
    ("ranges", "step", "each_s", "is_sweep"),
    [
        (720, 4.0 * np.pi / 721, 1e-5, True),
        (720, 4.0 * np.pi / 719, 1e-5, False),
        (720, -4.0 * np.pi / 721, 1e-5, True),
        (720, -4.0 * np.pi / 719, 1e-5, False),
        (65_535, 1e-4, 1e-5, True),
        (65_536, 1e-4, 1e-5, False),
        (100, 0.01, 0.0999, True),
        (100, 0.01, 0.1001, False),
        (100, 0.01, 0.0, True),
        (100, 0.01, -1e-9, False),
    ],
)
def test_laser_scan__up_to_two_turns_and_ten_seconds(
    ranges: int, step: float, each_s: float, is_sweep: bool, tmp_path: Path
) -> None:
    odd = laser_scan(T0_NS + 10**9, np.full(ranges, 4.0), step=step, each_s=each_s)
    reader = bag(tmp_path, laser_scan(T0_NS, np.full(10, 4.0)), odd)
    assert [len(scan) for scan in reader.scans()] == [10, *([ranges] if is_sweep else [])]
    assert ("bag-messages-damaged" in {notice.code for notice in reader.notices}) is not is_sweep


def test_laser_scan__returns_are_from_the_least_range_to_the_greatest(tmp_path: Path) -> None:
    message = laser_scan(T0_NS, [0.0, 0.4, 0.5, 1.0, 30.0, 31.0, -1.0, np.inf, np.nan])
    message.range_min = 0.5
    (scan,) = bag(tmp_path, message).scans()
    assert scan.column.tolist() == [2, 3, 4]
    message.range_min = message.range_max = 0.0
    assert list(bag(tmp_path / "none", message).scans()) == []


def test_ranges__up_to_2_km_are_returns_in_both_formats(tmp_path: Path) -> None:
    message = laser_scan(T0_NS, [5.0, 2000.0, 2001.0])
    message.range_max = 1e6
    (scan,) = bag(tmp_path, message).scans()
    assert scan.column.tolist() == [0, 1]
    ranges = (5.0, 2000.0, 2000.1, 0.0, 0.001, -1.0)
    rows = [f"{T0_S + 1e-4 * k:.6f},{k},{range_m},1" for k, range_m in enumerate(ranges)]
    (scan,) = line_csv(tmp_path, HEAD, rows).scans()
    assert scan.column.tolist() == [0, 1, 4]


@pytest.mark.parametrize(("late", "is_read"), [(3, True), (4, False)])
def test_csv__one_row_in_a_hundred_may_be_late(late: int, is_read: bool, tmp_path: Path) -> None:
    rows = rows_of(np.arange(350.0 - late))
    rows = [*rows[:200], *rows[100 : 100 + late], *rows[200:]]
    reader = line_csv(tmp_path, HEAD, rows)
    if is_read:
        assert sum(map(len, reader.scans())) == 350 - late
        assert f"{late} of 350 rows" in reader.notices[0].text
    else:
        with pytest.raises(InputError, match=f"{late} of 350 rows"):
            list(reader.scans())


@pytest.mark.parametrize(("pause_s", "sweeps"), [(0.99, 1), (1.01, 2)])
def test_csv__a_pause_of_more_than_a_second_begins_a_sweep(pause_s: float, sweeps: int, tmp_path: Path) -> None:
    rows = rows_of(np.arange(20.0))
    rows[10:] = [f"{T0_S + 1e-4 * k + pause_s:.6f},{k}.0,5.0,1" for k in range(10, 20)]
    assert len(list(line_csv(tmp_path, HEAD, rows).scans())) == sweeps


@pytest.mark.parametrize(
    ("columns", "sure"),
    [
        ("time_unix_s,angle_deg,range_m", 1.0),
        ("stamp,angle_deg,range_m", 0.5),  # whose missing column can be told
        ("time_unix_s,angle_deg,height_m", 0.0),
        ("time_unix_s,range_m,height_m", 0.0),  # of a range finder or a radar
        ("stamp,angle,range_m", 0.0),
    ],
)
def test_csv__is_recognised_by_angles_and_ranges(columns: str, sure: float) -> None:
    assert LineCsv.recognise(Head(Path("scan.csv"), f"{columns}\n1,2,3\n".encode(), "", ".csv")) == sure
