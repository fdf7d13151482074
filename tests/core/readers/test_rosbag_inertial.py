"""Inertial measurements and NMEA sentences in bags: what was recorded comes out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Reader as Rosbags1
from rosbags.typesys import Stores, get_typestore

from furrowmap.core.readers.nmea.log import NmeaLog
from furrowmap.core.readers.reader import GivesInertial, Reader, ReadOptions, Recognised, open_recording
from furrowmap.core.readers.rosbag.bags import RosBag1, RosBag2
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.session.examination import Examined
from furrowmap.core.session.opened import open_session
from furrowmap.core.session.proposal import propose_session
from furrowmap.core.values.gnss import Fix
from tests.core.readers.inertial_bags import imu, sentences, turning_imu
from tests.core.readers.small_bags import ROS1, T0_NS, nav_sat_fix, write_bag1, write_bag2
from tests.fuzz.positions import mend_nmea, nmea

T0_S = T0_NS * 1e-9


def codes(reader: Reader) -> list[str]:
    return [notice.code for notice in reader.notices]


@pytest.mark.parametrize("ros", [1, 2])
def test_imu__gives_what_was_recorded(tmp_path: Path, ros: int) -> None:
    if ros == 1:
        reader = RosBag1([write_bag1(tmp_path / "a.bag", turning_imu(store=ROS1))], ReadOptions())
    else:
        reader = RosBag2([write_bag2(tmp_path / "a", turning_imu())], ReadOptions())
    track = reader.inertial()
    k = np.arange(40)
    assert track.t_s - T0_S == pytest.approx(0.01 * k, abs=1e-6)
    assert track.rate_radps == pytest.approx(np.column_stack([0.01 * k, np.full(40, -0.2), np.full(40, 0.3)]))
    assert track.force_mps2 == pytest.approx(np.column_stack([np.full(40, 0.5), -0.1 * k, np.full(40, 9.7)]))
    assert reader.notices == []
    facts = reader.inspect().facts["imu"]
    assert (facts["topic"], facts["measurements"], facts["oriented"]) == ("/imu/data", 40, 40)


def test_sample__is_what_rosbags_reads(shared_data: Path) -> None:
    path = shared_data / "rosbag" / "husky_imu_odom_fix.bag"
    store = get_typestore(Stores.ROS1_NOETIC)
    with Rosbags1(path) as bag:
        theirs = [
            store.deserialize_ros1(raw, connection.msgtype)
            for connection, _, raw in bag.messages([c for c in bag.connections if c.topic == "/imu/data"])
        ]
    track = RosBag1([path], ReadOptions()).inertial()
    stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in theirs]
    np.testing.assert_allclose(track.t_s, stamps, rtol=0, atol=1e-6)
    for ours, name in ((track.rate_radps, "angular_velocity"), (track.force_mps2, "linear_acceleration")):
        np.testing.assert_array_equal(ours, [[getattr(getattr(m, name), axis) for axis in "xyz"] for m in theirs])
    assert np.linalg.norm(track.force_mps2.mean(axis=0)) == pytest.approx(9.80, abs=0.02)


@pytest.mark.parametrize("without", ["angular_velocity", "linear_acceleration"])
def test_quantities_not_measured__are_an_error(tmp_path: Path, without: str) -> None:
    reader = RosBag2([write_bag2(tmp_path / "a", turning_imu(without=without))], ReadOptions())
    with pytest.raises(InputError, match=without.replace("_", " ")) as caught:
        reader.inertial()
    assert caught.value.code == "bag-not-measured"
    assert len(reader.attitude()) == 40
    assert reader.inspect().facts["imu"] == "none"


@pytest.mark.parametrize("without", ["angular_velocity", "linear_acceleration"])
def test_quantities_not_measured__another_topic_is_read(tmp_path: Path, without: str) -> None:
    measured = [("/imu/raw", at_ns, message) for _, at_ns, message in turning_imu(12)]
    bag = write_bag2(tmp_path / "a", [*turning_imu(without=without), *measured])
    assert len(RosBag2([bag], ReadOptions()).inertial()) == 12


def test_quantities_not_measured__in_part_are_left_out_and_counted(tmp_path: Path) -> None:
    messages = [*turning_imu(40)[:30], *turning_imu(40, without="linear_acceleration")[30:]]
    reader = RosBag2([write_bag2(tmp_path / "a", messages)], ReadOptions())
    assert len(reader.inertial()) == 30
    assert codes(reader) == ["bag-not-measured"]
    assert "10 messages" in reader.notices[0].text


def test_quantities_not_measured__of_a_sample(shared_data: Path) -> None:
    bag = shared_data / "foreign" / "26-imu-covariance-minus-1" / "ins1.bag"
    if not bag.is_file():
        pytest.skip("the sample inputs of other software are not beside this checkout")
    reader = RosBag1([bag], ReadOptions())
    with pytest.raises(InputError) as caught:
        reader.inertial()
    assert caught.value.code == "bag-not-measured"
    attitude = reader.attitude()
    assert len(attitude) == 10
    assert attitude.roll_deg[0] == pytest.approx(-0.8913, abs=1e-3)


def test_orientation_not_measured__is_no_orientation(tmp_path: Path) -> None:
    reader = RosBag2([write_bag2(tmp_path / "a", turning_imu(without="orientation"))], ReadOptions())
    assert reader.inspect().facts["imu"]["oriented"] == 0


def test_values_in_other_units__are_an_error(tmp_path: Path) -> None:
    wild = [("/imu", T0_NS + 10**7 * k, imu(T0_NS + 10**7 * k, force_mps2=(0, 0, 9810.0))) for k in range(5)]
    with pytest.raises(InputError, match="m/s²") as caught:
        RosBag2([write_bag2(tmp_path / "a", wild)], ReadOptions()).inertial()
    assert caught.value.code == "value-out-of-range"


def test_topic__may_be_stated(tmp_path: Path) -> None:
    second = [("/imu/raw", at_ns, message) for _, at_ns, message in turning_imu(12)]
    bag = write_bag2(tmp_path / "a", [*turning_imu(), *second])
    reader = RosBag2([bag], ReadOptions())
    assert len(reader.inertial()) == 40
    assert codes(reader) == ["bag-topic-chosen"]
    assert len(RosBag2([bag], ReadOptions(topic="/imu/raw")).inertial()) == 12
    with pytest.raises(InputError, match="/imu/other"):
        RosBag2([bag], ReadOptions(topic="/imu/other")).inertial()


def test_bag_without_imu__holds_none(tmp_path: Path) -> None:
    bag = write_bag2(tmp_path / "a", [("/fix", T0_NS, nav_sat_fix(T0_NS))])
    examined = Examined.read(bag)
    assert isinstance(examined.reader, GivesInertial)
    assert not examined.gives(GivesInertial)


def test_session__is_proposed_and_reads_the_imu(tmp_path: Path) -> None:
    fixes = [("/fix", T0_NS + 10**8 * k, nav_sat_fix(T0_NS + 10**8 * k, lat_deg=43.0 + 1e-6 * k)) for k in range(5)]
    write_bag2(tmp_path / "bag", [*turning_imu(), *fixes])
    path = tmp_path / "session.toml"
    path.write_text(propose_session([Examined.read(tmp_path / "bag")], tmp_path).text, encoding="utf-8")
    opened = open_session(path)
    assert opened.session.imu is not None
    assert opened.session.imu.files == opened.session.recording.gnss == ("bag",)
    assert len(opened.inertial(T0_S).inertial()) == 40


def test_sentences__give_the_positions_of_the_same_log(tmp_path: Path) -> None:
    log = nmea()
    (tmp_path / "gnss.nmea").write_bytes(log)
    bag = write_bag2(tmp_path / "bag", sentences(log))
    ours, truth = RosBag2([bag], ReadOptions()).track(), NmeaLog([tmp_path / "gnss.nmea"], ReadOptions()).track()
    for name in truth.columns():
        np.testing.assert_array_equal(getattr(ours, name), getattr(truth, name))
    assert set(ours.fix) == {Fix.FIXED}
    assert ours.heading_deg[3] == pytest.approx(53.4)


def test_sentences_without_dates__have_the_date_of_their_stamps(tmp_path: Path) -> None:
    tod = T0_S % 86_400
    time = f"{int(tod // 3600):02d}{int(tod // 60 % 60):02d}{tod % 60:05.2f}"
    line = f"$GNGGA,{time},4303.5000,N,14120.4000,E,4,20,0.6,55.5,M,29.1,M,1.0,0000*00"
    bag = write_bag2(tmp_path / "bag", sentences(mend_nmea(line.encode())))
    assert RosBag2([bag], ReadOptions()).track().t_s == pytest.approx([T0_S], abs=0.006)


def test_sentences_without_positions__leave_them_to_nav_sat_fix(tmp_path: Path) -> None:
    recorded = [*sentences(mend_nmea(b"$GNHDT,53.10,T*00\r\n" * 3)), ("/fix", T0_NS, nav_sat_fix(T0_NS))]
    reader = RosBag2([write_bag2(tmp_path / "bag", recorded)], ReadOptions())
    assert len(reader.track()) == 1
    assert "bag-sentences-unused" in codes(reader)
    with pytest.raises(InputError, match="no intact GGA or GNS") as caught:
        RosBag2([write_bag2(tmp_path / "none", recorded[:3])], ReadOptions()).track()
    assert caught.value.code == "no-positions"


def as_gns(log: bytes, mode: bytes) -> bytes:
    """The GGA of a log as GNS with a mode."""
    lines = []
    for line in log.split(b"\r\n"):
        f = line.split(b",")
        if f[0].endswith(b"GGA"):
            line = b",".join([f[0][:3] + b"GNS", *f[1:6], mode, f[7], f[8], f[9], f[11], f[13], b"0000*00"])
        lines.append(line)
    return mend_nmea(b"\r\n".join(lines))


@pytest.mark.parametrize(
    ("mode", "fix"),
    [
        (b"RR", Fix.FIXED),
        (b"NFN", Fix.FLOAT),
        (b"DA", Fix.DGPS),
        (b"A", Fix.SINGLE),
        (b"ANR", Fix.FIXED),
        (b"E", Fix.ESTIMATED),
    ],
)
def test_gns__is_read_as_gga(tmp_path: Path, mode: bytes, fix: Fix) -> None:
    (tmp_path / "gga.nmea").write_bytes(nmea())
    (tmp_path / "gns.nmea").write_bytes(as_gns(nmea(), mode))
    truth = open_recording([tmp_path / "gga.nmea"], ReadOptions()).track()  # type: ignore[attr-defined]
    found = Recognised.by_content(tmp_path / "gns.nmea").open()
    ours = found.track()  # type: ignore[attr-defined]
    assert set(ours.fix) == {fix}
    for name in set(truth.columns()) - {"fix"}:
        np.testing.assert_array_equal(getattr(ours, name), getattr(truth, name))


def test_gns_without_positions__is_none(tmp_path: Path) -> None:
    without_pubx = b"\r\n".join(line for line in nmea().split(b"\r\n") if not line.startswith(b"$PUBX"))
    (tmp_path / "gns.nmea").write_bytes(as_gns(without_pubx, b"NN"))
    with pytest.raises(InputError, match="no intact GGA"):
        NmeaLog([tmp_path / "gns.nmea"], ReadOptions()).track()


def test_values_that_are_no_numbers__are_left_out(tmp_path: Path) -> None:
    recorded = turning_imu()
    recorded[5] = (*recorded[5][:2], imu(T0_NS + 50_000_000, (np.nan, 0.0, 0.0)))
    recorded[6] = (*recorded[6][:2], imu(T0_NS + 60_000_000, force_mps2=(0.0, np.inf, 9.8)))
    reader = RosBag2([write_bag2(tmp_path / "a", recorded)], ReadOptions())
    track = reader.inertial()
    assert len(track) == 38
    assert np.isfinite(track.rate_radps).all()
    assert np.isfinite(track.force_mps2).all()
    (notice,) = [notice for notice in reader.notices if "is not a number" in notice.text]
    assert notice.text.count("2") >= 1
