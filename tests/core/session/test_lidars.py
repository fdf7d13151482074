"""Several scanners in sessions and machine profiles."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.session.examination import Examined
from furrowmap.core.session.machine_file import machine_of, machine_text, parse_machine
from furrowmap.core.session.proposal import propose_session
from furrowmap.core.session.session_file import parse_session, together
from furrowmap.core.session.toml_edit import with_value
from tests.core.readers import hesai_packets
from tests.core.readers.velodyne_packets import frame, frames, turning, write_pcap

HEAD = 'furrowmap = 1\ncrs = { map = "EPSG:6677" }\n'
LEAST = HEAD + 'recording = { lidar = ["a.pcap"], gnss = ["a.nmea"], lidar_minus_gnss_s = 0.5 }\n'
REAR = '[[lidar]]\nname = "rear"\nxyz_m = [-0.6, 0.0, 2.4]\nrpy_deg = [0.0, 40.0, 180.0]\n'
FRONT = '[[lidar]]\nname = "front"\nxyz_m = [1.9, 0.0, 2.2]\nrpy_deg = [0.0, 35.0, 0.0]\n'
OWN = 'files = ["b.pcap"]\nminus_gnss_s = 0.02\n'


def test_each_scanner__has_its_files_and_clock() -> None:
    lidars = parse_session(LEAST + REAR + FRONT + OWN).lidars
    assert [(lidar.name, lidar.files, lidar.minus_gnss_s) for lidar in lidars] == [
        ("rear", ("a.pcap",), 0.5),
        ("front", ("b.pcap",), 0.02),
    ]
    sources = parse_session(LEAST + REAR + 'source = "2368"\n' + FRONT + 'source = "2369"\n').lidars
    assert [(lidar.files, lidar.source, lidar.minus_gnss_s) for lidar in sources] == [
        (("a.pcap",), "2368", 0.5),
        (("a.pcap",), "2369", 0.5),
    ]


def test_files_of_the_first__may_stand_in_its_own_table() -> None:
    named = 'recording = { gnss = ["a.nmea"] }\n' + REAR + 'files = ["a.pcap"]\nminus_gnss_s = 0.5\n' + FRONT + OWN
    assert parse_session(HEAD + named) == parse_session(LEAST + REAR + FRONT + OWN)
    single = REAR.replace("[[lidar]]", "[lidar]")
    assert parse_session(LEAST + REAR) == parse_session(LEAST + single)


def test_session__is_the_same_when_it_was_written() -> None:
    session = parse_session(LEAST + REAR + FRONT + OWN)
    written = together(msgspec.to_builtins(session))
    assert [table["name"] for table in written["lidar"]] == ["rear", "front"]
    assert "further_lidars" not in written


@pytest.mark.parametrize(
    ("tables", "fault"),
    [
        (REAR + FRONT.replace('name = "front"\n', "") + OWN, "needs a name"),
        (REAR + REAR + OWN, "two [[lidar]] have the name 'rear'"),
        (REAR + FRONT, "two [[lidar]] read the same file"),
        (REAR + 'source = "2368"\n' + FRONT + 'source = "2368"\n', "two [[lidar]] read the same file"),
        (REAR + 'files = ["b.pcap"]\n' + FRONT + OWN, "lidar.files of the first scanner"),
        (REAR + FRONT + OWN + '[mount]\nattitude = "m.csv"\n', "[mount] moves one scanner"),
        (REAR + FRONT.replace("1.9", "1900.0") + OWN, "lidar.xyz_m holds 1900"),
        (REAR + FRONT + 'files = ["b.pcap", "./b.pcap"]\n', "lidar.files names 'b.pcap' twice"),
        ("".join(FRONT.replace("front", name) + f'source = "{name}"\n' for name in "abcde"), "at most 4"),
    ],
)
def test_scanners__that_cannot_be_told_apart_are_refused(tables: str, fault: str) -> None:
    with pytest.raises(InputError) as error:
        parse_session(LEAST + tables)
    assert error.value.code == "session-value"
    assert fault in error.value.what


def test_unknown_key__of_any_scanner_is_named() -> None:
    for text in (REAR + FRONT + OWN + "rpy = [0.0, 0.0, 0.0]\n", "further_lidars = []\n"):
        with pytest.raises(InputError) as error:
            parse_session(LEAST + text)
        assert error.value.code == "session-unknown-key"


def test_machine__keeps_the_places_of_all_scanners_and_no_files() -> None:
    machine = machine_of(parse_session(LEAST + REAR + FRONT + OWN), "twins")
    again = parse_machine(machine_text(machine))
    assert again.lidar is not None
    assert [lidar.name for lidar in (again.lidar, *again.further_lidars)] == ["rear", "front"]
    assert again.further_lidars[0].files == ()
    assert again.further_lidars[0].rpy_deg == (0.0, 35.0, 0.0)
    with pytest.raises(InputError, match="further_lidars is no table of a profile"):
        parse_machine("furrowmap_machine = 1\nfurther_lidars = []\n")


def test_calibrated_angles__are_written_into_the_first_table() -> None:
    changed = with_value(LEAST + REAR + FRONT + OWN, "lidar", "rpy_deg", "[0.1, 40.2, 179.9]")
    assert changed == LEAST + REAR.replace("[0.0, 40.0, 180.0]", "[0.1, 40.2, 179.9]") + FRONT + OWN


def test_proposed_session__has_a_table_for_each_scanner(tmp_path: Path) -> None:
    packets = turning(60, 0)
    one = frames(packets)
    two = [(t_s, frame(packet, sender="192.168.1.202")) for (t_s, _), packet in zip(one, packets, strict=True)]
    later = frames(turning(60, 20e6), 1.75e9 + 20.0)
    a, b, c = (write_pcap(tmp_path / f"{name}.pcap", of) for name, of in zip("abc", (one, two, later), strict=True))
    both = write_pcap(tmp_path / "both.pcap", [each for pair in zip(one, two, strict=True) for each in pair])

    def proposed(*paths: Path) -> list[tuple[tuple[str, ...], str | None]]:
        text = propose_session([one for path in paths for one in Examined.each(path)], tmp_path).text
        assert text.count("[[lidar]]") in (0, 2)
        text = text.replace('map = "FILL-IN"', 'map = "EPSG:6677"')
        return [(lidar.files, lidar.source) for lidar in parse_session(text).lidars]

    assert proposed(a, b) == [(("a.pcap",), None), (("b.pcap",), None)]
    assert proposed(a, c) == [(("a.pcap", "c.pcap"), None)]
    names = [f"192.168.1.{number} to port 2368" for number in (201, 202)]
    assert proposed(both) == [(("both.pcap",), name) for name in names]
    packets = hesai_packets.turning("PandarXT-32", 60)
    hesai = [(t_s, frame(packet, port=2369)) for (t_s, _), packet in zip(one, packets, strict=True)]
    makers = write_pcap(tmp_path / "makers.pcap", [each for pair in zip(one, hesai, strict=True) for each in pair])
    (first, of_first), (second, of_second) = proposed(makers)
    assert first == second == ("makers.pcap",)
    assert {of_first, of_second} == {f"192.168.1.201 to port {port}" for port in (2368, 2369)}
    alone = write_pcap(tmp_path / "alone.pcap", hesai)
    said = [
        [n.code for n in Examined.read(path).inspection.notices].count("several-makers") for path in (makers, alone)
    ]
    assert said == [1, 0]
    tried = str(Examined.read(alone).inspection.facts["tried_on"])
    assert "checked against points of nebula" in tried
    assert tried not in propose_session([Examined.read(alone)], tmp_path).text, "a session states what a run reads"
