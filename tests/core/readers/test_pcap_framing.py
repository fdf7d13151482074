"""Datagrams out of captures, against dpkt's reading of the same bytes and against what was put in."""

from __future__ import annotations

import gzip
import struct
from pathlib import Path

import dpkt
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from furrowmap.core.readers.pcap import Capture
from furrowmap.core.readers.source import Source
from furrowmap.core.runtime.errors import InputError
from tests.core.readers.velodyne_packets import Frame, frame, write_pcap

PAYLOADS = [bytes([65 + i]) * (20 + i) for i in range(6)]
T0 = 1_750_000_000.0


def read(path: Path) -> tuple[list[tuple[float, bytes]], Capture]:
    """All datagrams of a capture with their times, and the capture after reading."""
    with Source(path) as source:
        capture = Capture(source)
        found = [
            (float(t), d.data[at : at + n].tobytes())
            for d in capture
            for t, at, n in zip(d.time_s, d.offset, d.length, strict=True)
        ]
    return found, capture


def by_dpkt(path: Path) -> list[tuple[float, bytes]]:
    """The UDP datagrams that dpkt finds."""
    found = []
    with path.open("rb") as file:
        reader = dpkt.pcapng.Reader(file) if path.suffix == ".pcapng" else dpkt.pcap.Reader(file)
        for time_s, data in reader:
            ip = dpkt.ethernet.Ethernet(data).data
            if isinstance(ip, dpkt.ip.IP) and isinstance(ip.data, dpkt.udp.UDP):
                found.append((float(time_s), bytes(ip.data.data)))
    return found


@pytest.mark.parametrize(
    "name",
    [
        "vlp16_single_gps.pcap",
        "vlp16_single_gps.pcapng",
        "vlp16_single_gps_bigendian.pcap",
        "damaged_foreign_traffic_mixed.pcap",
        "hdl32e_single.pcap",
    ],
)
def test_capture__finds_the_datagrams_that_dpkt_finds(shared_data: Path, name: str) -> None:
    path = shared_data / "velodyne" / name
    found, capture = read(path)
    expected = by_dpkt(path)
    assert [data for _, data in found] == [data for _, data in expected]
    np.testing.assert_allclose([t for t, _ in found], [t for t, _ in expected], atol=1e-6, rtol=0)
    assert capture.notices == []


def test_capture__counts_what_is_no_datagram(shared_data: Path) -> None:
    _, capture = read(shared_data / "velodyne" / "damaged_foreign_traffic_mixed.pcap")
    assert (capture.records, dict(capture.skipped)) == (400, {"not IP": 10})


def ethernet(payload: bytes) -> bytes:
    return frame(payload)


def vlan(payload: bytes) -> bytes:
    plain = frame(payload)
    return plain[:12] + b"\x81\0\0\x05" + plain[12:]


def double_vlan(payload: bytes) -> bytes:
    plain = frame(payload)
    return plain[:12] + b"\x88\xa8\0\x07\x81\0\0\x05" + plain[12:]


def ipv6(payload: bytes) -> bytes:
    udp = struct.pack(">HHHH", 2368, 2368, 8 + len(payload), 0) + payload
    header = struct.pack(">IHBB", 6 << 28, len(udp), 17, 64) + bytes(range(16)) + b"\xff" * 16
    return bytes(12) + b"\x86\xdd" + header + udp


def cooked(payload: bytes) -> bytes:
    return struct.pack(">HHH8sH", 0, 1, 6, bytes(8), 0x0800) + frame(payload)[14:]


def cooked2(payload: bytes) -> bytes:
    return struct.pack(">HHIHBB8s", 0x0800, 0, 3, 1, 0, 6, bytes(8)) + frame(payload)[14:]


def raw_ip(payload: bytes) -> bytes:
    return frame(payload)[14:]


def loopback(payload: bytes) -> bytes:
    return b"\x02\0\0\0" + frame(payload)[14:]


def padded(payload: bytes) -> bytes:
    return frame(payload) + bytes(40)


LINKS = [
    (1, ethernet),
    (1, vlan),
    (1, double_vlan),
    (1, ipv6),
    (1, padded),
    (113, cooked),
    (276, cooked2),
    (101, raw_ip),
    (228, raw_ip),
    (0, loopback),
]


@pytest.mark.parametrize(("link", "wrapped"), LINKS, ids=[f"{n}-{f.__name__}" for n, f in LINKS])
def test_promise_04__each_link_type_and_tag_is_unwrapped(tmp_path: Path, link: int, wrapped) -> None:  # type: ignore[no-untyped-def]
    path = write_pcap(tmp_path / "a.pcap", [(T0 + i, wrapped(p)) for i, p in enumerate(PAYLOADS)], link=link)
    assert read(path)[0] == [(T0 + i, p) for i, p in enumerate(PAYLOADS)]


def test_capture__nanoseconds(tmp_path: Path) -> None:
    path = write_pcap(tmp_path / "a.pcap", [(T0 + 0.125, frame(b"x"))], nano=True)
    found, capture = read(path)
    assert found == [(T0 + 0.125, b"x")]
    assert capture.resolution == 1_000_000_000


def test_capture__of_an_unknown_link_type_is_counted_not_guessed(tmp_path: Path) -> None:
    found, capture = read(write_pcap(tmp_path / "a.pcap", [(T0, frame(b"x"))], link=105))
    assert found == []
    assert dict(capture.skipped) == {"of an unsupported link type": 1}


@pytest.mark.parametrize(
    ("damage", "why"),
    [
        (lambda f: f[:30], "cut short by the capture"),
        (lambda f: f[:-1], "cut short by the capture"),
        (lambda f: f[:23] + b"\x06" + f[24:], "not UDP"),
        (lambda f: f[:20] + b"\x20\0" + f[22:], "IP fragments"),
        (lambda f: f[:12] + b"\x08\x06" + f[14:], "not IP"),
        (lambda f: f[:38] + b"\0\x03" + f[40:], "damaged headers"),
    ],
)
def test_capture__counts_why_a_frame_has_no_datagram(tmp_path: Path, damage, why: str) -> None:  # type: ignore[no-untyped-def]
    content: list[Frame] = [(T0, frame(b"good")), (T0 + 1, damage(frame(b"something"))), (T0 + 2, frame(b"good"))]
    found, capture = read(write_pcap(tmp_path / "a.pcap", content))
    assert [data for _, data in found] == [b"good", b"good"]
    assert dict(capture.skipped) == {why: 1}


class PcapNg:
    """Blocks of a pcapng file, in either byte order."""

    def __init__(self, order: str = "<") -> None:
        self.order = order

    def block(self, kind: int, body: bytes) -> bytes:
        body += bytes(-len(body) % 4)
        size = struct.pack(self.order + "I", 12 + len(body))
        return struct.pack(self.order + "I", kind) + size + body + size

    def section(self) -> bytes:
        return self.block(0x0A0D0D0A, struct.pack(self.order + "IHHq", 0x1A2B3C4D, 1, 0, -1))

    def interface(self, link: int = 1, resolution: int | None = None, shift_s: int | None = None) -> bytes:
        options = b""
        if resolution is not None:
            options += struct.pack(self.order + "HHB3x", 9, 1, resolution)
        if shift_s is not None:
            options += struct.pack(self.order + "HHq", 14, 8, shift_s)
        if options:
            options += bytes(4)
        return self.block(1, struct.pack(self.order + "HHI", link, 0, 262_144) + options)

    def packet(self, ticks: int, data: bytes, interface: int = 0) -> bytes:
        head = struct.pack(self.order + "IIIII", interface, ticks >> 32, ticks & 0xFFFFFFFF, len(data), len(data))
        return self.block(6, head + data + bytes(-len(data) % 4))


@pytest.mark.parametrize("order", "<>")
def test_pcapng__of_each_byte_order_and_resolution(tmp_path: Path, order: str) -> None:
    ng = PcapNg(order)
    other = PcapNg("<>".replace(order, ""))
    content = (
        ng.section()
        + ng.interface()
        + ng.block(4, b"name resolution")
        + ng.interface(link=101, resolution=9, shift_s=1000)
        + ng.packet(int(T0) * 1_000_000 + 250_000, frame(b"micro"))
        + ng.packet((int(T0) - 1000) * 1_000_000_000 + 500_000_000, raw_ip(b"nano"), interface=1)
        + other.section()
        + other.interface(resolution=0x80 | 10)
        + other.packet((int(T0) << 10) + 768, frame(b"binary"))
    )
    path = tmp_path / "a.pcapng"
    path.write_bytes(content)
    found, capture = read(path)
    assert found == [(T0 + 0.25, b"micro"), (T0 + 0.5, b"nano"), (T0 + 0.75, b"binary")]
    assert capture.notices == []


def test_pcapng__has_the_resolution_of_its_first_interface(tmp_path: Path) -> None:
    ng = PcapNg()
    path = tmp_path / "a.pcapng"
    stamp = int(T0) * 1_000_000_000
    path.write_bytes(
        ng.section() + ng.interface(resolution=9) + ng.interface(resolution=3) + ng.packet(stamp, frame(b"x"))
    )
    found, capture = read(path)
    assert (found, capture.resolution) == ([(T0, b"x")], 1_000_000_000)


def test_pcapng__cut_in_a_section_header_ends_there(tmp_path: Path) -> None:
    ng = PcapNg()
    path = tmp_path / "a.pcapng"
    long_header = ng.block(0x0A0D0D0A, struct.pack("<IHHq", 0x1A2B3C4D, 1, 0, -1) + bytes(400))
    path.write_bytes(ng.section() + ng.interface() + ng.packet(1, frame(b"before")) + long_header[:100])
    found, capture = read(path)
    assert [data for _, data in found] == [b"before"]
    assert [n.code for n in capture.notices] == ["cut-capture"]


@pytest.mark.parametrize("size", [0, 24, 30, 1 << 31])
def test_pcapng__with_an_impossible_section_header_is_refused_with_its_place(tmp_path: Path, size: int) -> None:
    ng = PcapNg()
    path = tmp_path / "a.pcapng"
    whole = ng.section() + ng.interface() + ng.packet(1, frame(b"before"))
    path.write_bytes(whole + ng.section()[:4] + struct.pack("<I", size) + ng.section()[8:] + bytes(100))
    with pytest.raises(InputError, match=f"invalid length {size:,} in the section header at byte {len(whole):,}"):
        read(path)


def test_pcapng__of_times_beyond_all_dates_gives_nothing(tmp_path: Path) -> None:
    ng = PcapNg()
    path = tmp_path / "a.pcapng"
    path.write_bytes(ng.section() + ng.interface(shift_s=-(1 << 62)) + ng.packet(1, frame(b"when?")))
    found, capture = read(path)
    assert found == []
    assert dict(capture.skipped) == {"without a plausible time": 1}


def test_pcapng__of_more_interfaces_than_are_kept_gives_those_of_the_first_1024(tmp_path: Path) -> None:
    """What is kept of interfaces does not grow with the file; a section begins a new list."""
    ng = PcapNg()
    described = ng.section() + b"".join(ng.interface(resolution=6) for _ in range(1025))
    packets = [
        ng.packet((int(T0) + k) * 1_000_000, frame(name), on)
        for k, (on, name) in enumerate([(0, b"first"), (1023, b"last kept"), (1024, b"beyond"), (5, b"after")])
    ]
    path = tmp_path / "a.pcapng"
    path.write_bytes(described + b"".join(packets) + ng.section() + ng.interface() + packets[0])
    found, capture = read(path)
    assert [data for _, data in found] == [b"first", b"last kept", b"after", b"first"]
    (notice,) = capture.notices
    assert notice.code == "damaged-records"
    assert f"{len(packets[2])} damaged bytes at 1 place" in notice.text


def test_capture__larger_than_a_block_loses_nothing(tmp_path: Path) -> None:
    content = [(T0 + i, frame(struct.pack("<I", i) * 300)) for i in range(4000)]
    found, capture = read(write_pcap(tmp_path / "a.pcap", content))
    assert [struct.unpack_from("<I", data)[0] for _, data in found] == list(range(4000))
    assert capture.records == 4000


def test_capture__steps_over_damage_in_the_middle(tmp_path: Path) -> None:
    path = write_pcap(tmp_path / "a.pcap", [(T0 + i, frame(bytes([i]) * 1206)) for i in range(20)])
    content = bytearray(path.read_bytes())
    record = 16 + 42 + 1206
    content[24 + 7 * record + 8 : 24 + 7 * record + 12] = b"\xff\xff\xff\x7f"
    path.write_bytes(content)
    found, capture = read(path)
    assert [data[0] for _, data in found] == [i for i in range(20) if i != 7]
    assert [n.code for n in capture.notices] == ["damaged-records"]
    assert f"{record:,} damaged bytes at 1 place (the first at byte {24 + 7 * record:,})" in capture.notices[0].text


def test_pcapng__steps_over_damage_in_the_middle(tmp_path: Path) -> None:
    ng = PcapNg()
    packets = [ng.packet((int(T0) + i) * 1_000_000, frame(bytes([i]) * 1206)) for i in range(20)]
    packets[7] = packets[7][:4] + b"\xff\xff\xff\xff" + packets[7][8:]
    path = tmp_path / "a.pcapng"
    path.write_bytes(ng.section() + ng.interface() + b"".join(packets))
    found, capture = read(path)
    assert [data[0] for _, data in found] == [i for i in range(20) if i != 7]
    assert [n.code for n in capture.notices] == ["damaged-records"]


def test_capture__in_a_truncated_stream_is_reported(tmp_path: Path) -> None:
    path = write_pcap(tmp_path / "a.pcap", [(T0 + i, frame(np.random.default_rng(i).bytes(1206))) for i in range(50)])
    packed = tmp_path / "a.pcap.gz"
    packed.write_bytes(gzip.compress(path.read_bytes())[:30_000])
    found, capture = read(packed)
    assert found == read(path)[0][: len(found)]
    assert 10 < len(found) < 50
    assert [n.code for n in capture.notices] == ["cut-stream", "cut-capture"]


@given(cut=st.integers(0, 6 * 90), kind=st.sampled_from(["pcap", "pcapng"]))
@settings(max_examples=150)
def test_capture__cut_at_any_byte_gives_the_datagrams_before(
    tmp_path_factory: pytest.TempPathFactory, cut: int, kind: str
) -> None:
    ng = PcapNg()
    folder = tmp_path_factory.mktemp("cut")
    if kind == "pcapng":
        whole = ng.section() + ng.interface() + b"".join(ng.packet(i, frame(p)) for i, p in enumerate(PAYLOADS))
    else:
        whole = write_pcap(folder / "w", [(float(i), frame(p)) for i, p in enumerate(PAYLOADS)]).read_bytes()
    path = folder / "a"
    path.write_bytes(whole[:cut])
    if cut < (4 if kind == "pcap" else 12):
        with pytest.raises(InputError, match="is not a packet capture"):
            read(path)
        return
    found, _ = read(path)
    assert [data for _, data in found] == PAYLOADS[: len(found)]
    assert len(found) == sum(whole[:cut].count(p) for p in PAYLOADS) or kind == "pcapng"


@given(data=st.binary(max_size=600), kind=st.sampled_from(["pcap", "pcapng"]), link=st.sampled_from([0, 1, 101, 113]))
@settings(max_examples=300)
def test_capture__of_random_bytes_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, data: bytes, kind: str, link: int
) -> None:
    path = tmp_path_factory.mktemp("random") / "a"
    ng = PcapNg()
    start = (
        b"\xd4\xc3\xb2\xa1" + bytes(16) + struct.pack("<I", link)
        if kind == "pcap"
        else ng.section() + ng.interface(link)
    )
    path.write_bytes(start + data)
    try:
        found, refused = read(path)[0], ""
    except InputError as error:
        found, refused = [], error.code
    assert refused in ("", "damaged-capture")
    assert sum(len(payload) for _, payload in found) <= len(data)


@pytest.mark.parametrize("order", ["<", ">"])
def test_pcapng__obsolete_packet_blocks_are_read_as_enhanced_ones(tmp_path: Path, order: str) -> None:
    ng = PcapNg(order)
    path = tmp_path / "a.pcapng"
    stamp = int(T0) * 1_000_000
    packets = []
    for k in range(3):
        enhanced = ng.packet(stamp + k, frame(bytes([k])), 1)
        body = struct.pack(order + "HH", 1, 7) + enhanced[12:-4]
        packets.append(ng.block(2, body))
    path.write_bytes(ng.section() + ng.interface() + ng.interface() + b"".join(packets))
    found, capture = read(path)
    assert [data for _, data in found] == [b"\0", b"\1", b"\2"]
    np.testing.assert_allclose([t for t, _ in found], T0 + 1e-6 * np.arange(3), atol=1e-6)
    assert not capture.skipped


def test_sample__of_obsolete_packet_blocks(shared_data: Path) -> None:
    path = shared_data / "foreign/20-header-words/opb.pcapng"
    found, capture = read(path)
    times = [t for t, _ in found]
    assert 52 + 1280 * len(found) == path.stat().st_size
    assert not capture.skipped
    assert times == sorted(times)
