"""Bags that are compressed, split, killed, cut or garbled: what can be read is read, and what is lost is reported."""

from __future__ import annotations

import bz2
import gzip
import lzma
import random
import shutil
import sqlite3
import struct
import sys
import tracemalloc
from collections import Counter
from collections.abc import Callable
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Any

import lz4.frame
import pytest

from furrowmap.core.readers.reader import ReadOptions, Recognised, open_recording
from furrowmap.core.readers.rosbag.bag_storage import MAX_RECORD_BYTES, Damage, decompress_message, inflate
from furrowmap.core.readers.rosbag.bags import BagFiles
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.gnss import Fix
from furrowmap.core.values.scan import Clock
from tests.core.readers.small_bags import ROS1, ROS2, T0_NS, mixed, nav_sat_fix, velodyne_scan, write_bag1, write_bag2
from tests.core.readers.velodyne_packets import turning

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

Make = Callable[[Path], Path]

KINDS: dict[str, Make] = {
    "plain.bag": lambda folder: write_bag1(folder / "plain.bag", mixed(ROS1)),
    "lz4.bag": lambda folder: write_bag1(folder / "lz4.bag", mixed(ROS1), "LZ4"),
    "bz2.bag": lambda folder: write_bag1(folder / "bz2.bag", mixed(ROS1), "BZ2"),
    "plain.mcap": lambda folder: write_bag2(folder / "plain", mixed()) / "plain.mcap",
    "zstd.mcap": lambda folder: write_bag2(folder / "zstd", mixed(), mode="STORAGE") / "zstd.mcap",
    "plain.db3": lambda folder: write_bag2(folder / "sql", mixed(), "SQLITE3") / "sql.db3",
}


def codes(inspection: Any) -> set[str]:
    return {notice.code for notice in inspection.notices}


def bag_codes(inspection: Any) -> set[str]:
    return {code for code in codes(inspection) if code.startswith("bag-")}


def counts(path: Path) -> dict[str, int]:
    return {topic: facts["messages"] for topic, facts in Recognised.by_content(path).inspect().facts["topics"].items()}


WHOLE = {"/points": 3, "/fix": 6, "/imu": 1}


@pytest.mark.parametrize("pack", [gzip.compress, lzma.compress, zstd.compress], ids=["gz", "xz", "zst"])
@pytest.mark.parametrize("kind", sorted(KINDS))
def test_compressed_bags_are_read_as_they_are(tmp_path: Path, kind: str, pack: Callable[[bytes], bytes]) -> None:
    packed = tmp_path / "recording.packed"
    packed.write_bytes(pack(KINDS[kind](tmp_path).read_bytes()))
    inspection = Recognised.by_content(packed).inspect()
    assert {topic: facts["messages"] for topic, facts in inspection.facts["topics"].items()} == WHOLE
    assert inspection.facts["scans"]["points"] == 3 * 64
    assert inspection.facts["positions"]["epochs"] == 6


@pytest.mark.parametrize("plugin", ["MCAP", "SQLITE3"])
@pytest.mark.parametrize("mode", ["FILE", "MESSAGE"])
def test_what_rosbag2_compresses_itself(tmp_path: Path, plugin: str, mode: str) -> None:
    folder = write_bag2(tmp_path / "bag", mixed(), plugin, mode)
    assert counts(folder) == WHOLE
    assert sum(map(len, open_recording([folder], ReadOptions()).scans())) == 3 * 64


def test_a_compression_that_is_none__is_damage_by_its_name() -> None:
    with pytest.raises(Damage, match=r"unsupported compression 'brotli' of a chunk \(supported: lz4, bz2, zstd\)"):
        inflate(bytes(10), "brotli", 100)


def test_promise_06__a_folder_is_read_with_and_without_its_metadata(tmp_path: Path) -> None:
    folder = write_bag2(tmp_path / "bag", mixed())
    with_metadata = Recognised.by_content(folder).inspect()
    (folder / "metadata.yaml").unlink()
    without = Recognised.by_content(folder).inspect()
    assert with_metadata.facts == without.facts
    assert bag_codes(without) == {"bag-no-metadata"}


def test_parts_of_a_split_bag_are_read_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    for part, name in enumerate(("bag_2", "bag_10")):
        recorded = [
            ("/fix", T0_NS + part * 10**9 + k * 10**8, nav_sat_fix(T0_NS + part * 10**9 + k * 10**8)) for k in range(5)
        ]
        made = write_bag2(tmp_path / name, recorded)
        shutil.move(made / f"{name}.mcap", folder / f"{name}.mcap")
    track = open_recording([folder], ReadOptions()).track()
    assert len(track) == 10
    received = [message.received_ns for message in BagFiles([folder]).messages()]
    assert received == sorted(received)


def test_a_missing_part_and_an_empty_part_are_reported(tmp_path: Path) -> None:
    folder = write_bag2(tmp_path / "bag", mixed())
    metadata = folder / "metadata.yaml"
    text = metadata.read_text()
    for change, code in (("  - gone.mcap\n", "bag-file-missing"), ("  - empty.mcap\n", "empty-file")):
        (folder / "empty.mcap").touch()
        metadata.write_text(text.replace("  relative_file_paths:\n", f"  relative_file_paths:\n{change}"))
        inspection = Recognised.by_content(folder).inspect()
        assert inspection.facts["messages"] == 10
        assert code in codes(inspection)


def test_nothing_outside_a_bag_s_folder_is_read(tmp_path: Path) -> None:
    folder = write_bag2(tmp_path / "bag", mixed())
    outside = write_bag1(tmp_path / "outside.mcap", mixed(ROS1))
    metadata = folder / "metadata.yaml"
    for name in (str(outside), "../outside.mcap"):
        metadata.write_text(metadata.read_text().replace("- bag.mcap", f"- {name}"))
        assert "bag-file-missing" in codes(Recognised.by_content(folder).inspect())


@pytest.mark.parametrize(
    "text", ["", "&", "rosbag2_bagfile_information: 5", "[" * 5000, "a: !!python/name:os.system"], ids=len
)
def test_damaged_metadata_are_reported_and_ignored(tmp_path: Path, text: str) -> None:
    folder = write_bag2(tmp_path / "bag", mixed())
    (folder / "metadata.yaml").write_text(text)
    inspection = Recognised.by_content(folder).inspect()
    assert inspection.facts["messages"] == 10
    assert bag_codes(inspection) == {"bag-metadata-damaged"}


def test_metadata_that_count_other_messages_are_reported(tmp_path: Path) -> None:
    folder = write_bag2(tmp_path / "bag", mixed())
    metadata = folder / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("\n  message_count: 10\n", "\n  message_count: 12\n"))
    assert "bag-count" in codes(Recognised.by_content(folder).inspect())


@pytest.mark.parametrize("name", ["50 % #1?.db3", "圃場 'a'.db3", "-rf.db3", "a?mode=memory.db3"])
def test_names_of_any_kind(tmp_path: Path, name: str) -> None:
    shutil.copy(KINDS["plain.db3"](tmp_path), tmp_path / name)
    assert counts(tmp_path / name) == WHOLE


@pytest.mark.parametrize("mode", ["wal", "delete"])
def test_promise_06__a_killed_recorder_s_journal_is_taken_in_and_left_as_it_was(tmp_path: Path, mode: str) -> None:
    """A .db3 whose recorder was killed: newest messages in the write-ahead log, or half a transaction to undo."""
    database = KINDS["plain.db3"](tmp_path)
    writer = sqlite3.connect(database, isolation_level=None)
    writer.execute(f"PRAGMA journal_mode={mode}")
    writer.execute("PRAGMA wal_autocheckpoint=0")
    writer.execute("PRAGMA cache_size=2")
    writer.execute("PRAGMA cache_spill=1")
    writer.execute("BEGIN")
    writer.execute(
        "INSERT INTO messages (topic_id, timestamp, data) SELECT topic_id, timestamp + 1, data FROM messages"
    )
    if mode == "wal":
        writer.execute("COMMIT")
    killed = tmp_path / "killed"
    killed.mkdir()
    for file in database.parent.glob(f"{database.name}*"):
        shutil.copy(file, killed / file.name)
    writer.close()
    before = {file.name: file.read_bytes() for file in killed.iterdir()}
    inspection = Recognised.by_content(killed / database.name).inspect()
    assert inspection.facts["messages"] == (20 if mode == "wal" else 10)
    assert "bag-unclosed" in codes(inspection)
    assert {file.name: file.read_bytes() for file in killed.iterdir()} == before


def test_one_damaged_chunk_costs_only_its_own_messages(tmp_path: Path) -> None:
    path = write_bag1(tmp_path / "a.bag", mixed(ROS1, 60, 3000), "BZ2")
    data = bytearray(path.read_bytes())
    every = list(BagFiles([path]).messages())
    second = data.find(b"op=\x05", data.find(b"op=\x05") + 1)
    data[second + 20_000 : second + 20_100] = bytes(100)
    path.write_bytes(data)
    files = BagFiles([path])
    left = list(files.messages())
    assert 0.5 * len(every) < len(left) < len(every)
    assert set(left) <= set(every)
    assert codes(files) == {"bag-chunk-damaged", "bag-count"}


@pytest.mark.parametrize(("compression", "left"), [(None, WHOLE), ("LZ4", {})])
def test_promise_06__the_chunk_that_a_killed_recorder_left_open(
    tmp_path: Path, compression: str | None, left: dict[str, int]
) -> None:
    """Its sizes are still 0, as the recorder fills them in when it closes the chunk; its content ends the file."""
    path = write_bag1(tmp_path / "a.bag.active", mixed(ROS1), compression)
    data = path.read_bytes()
    fields_at = data.index(b"compression=") - 4
    length_at = data.index(b"size=", fields_at) + len("size=") + 4
    (length,) = struct.unpack_from("<I", data, length_at)
    index_pos = data.index(b"index_pos=") + len("index_pos=")
    opened = bytearray(data[: length_at + 4 + length])
    opened[length_at - 4 : length_at + 4] = bytes(8)
    opened[index_pos : index_pos + 8] = bytes(8)
    path.write_bytes(opened)
    files = BagFiles([path])
    found = Counter(message.topic for message in files.messages())
    assert found == left
    assert codes(files) == ({"bag-unindexed"} if left else {"bag-cut"})


def test_a_chunk_with_a_wrong_checksum_is_not_used(tmp_path: Path) -> None:
    path = KINDS["plain.mcap"](tmp_path)
    data = bytearray(path.read_bytes())
    chunk = 8 + 9 + struct.unpack_from("<Q", data, 9)[0]  # behind the magic and the header record
    data[chunk + 9 + 24 : chunk + 9 + 28] = struct.pack("<I", 12345)
    path.write_bytes(data)
    with pytest.raises(InputError, match="checksum is wrong"):
        Recognised.by_content(path).inspect()


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_promise_06__every_cut_gives_the_beginning_or_a_refusal(tmp_path: Path, kind: str) -> None:
    path = KINDS[kind](tmp_path)
    data = path.read_bytes()
    whole = list(BagFiles([path]).messages())
    cut = tmp_path / f"cut{path.suffix}"
    for share in (0.05, 0.3, 0.5, 0.7, 0.9, 0.999):
        cut.write_bytes(data[: int(share * len(data))])
        files = BagFiles([cut])
        left = list(files.messages())
        if kind == "plain.db3":  # SQLite fills pages that are missing with zeros: data may end in them
            left, whole = ([message._replace(data=b"") for message in messages] for messages in (left, whole))
        assert left == whole[: len(left)]
        assert files.notices, share


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_promise_07__a_declared_size_is_not_trusted_before_the_bytes_are_read(tmp_path: Path, kind: str) -> None:
    """Every length field that could be blown up, blown up in turn: no allocation follows it."""
    path = KINDS[kind](tmp_path)
    data = path.read_bytes()
    list(BagFiles([path]).messages())
    tracemalloc.start()
    for at in range(0, 400, 3):
        path.write_bytes(data[:at] + b"\xff\xff\xff\x7f" + data[at + 4 :])
        try:
            list(BagFiles([path]).messages())
        except InputError:
            continue
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 40e6


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_garbled_bags_are_read_in_part_or_refused_in_three_sentences(tmp_path: Path, kind: str) -> None:
    """Seeded mutations: flipped bits, blocks of noise, cuts, doubled and swapped pieces."""
    path = KINDS[kind](tmp_path)
    data = path.read_bytes()
    dice = random.Random(kind)
    garbled = tmp_path / f"garbled{path.suffix}"
    refusals = []
    for _ in range(60):
        garbled.write_bytes(mutated(data, dice))
        try:
            reader = Recognised.by_content(garbled).open()
            reader.inspect()
            for read in (reader.track, lambda reader=reader: list(reader.scans())):
                read()
        except InputError as error:
            refusals.append(error)
    assert all(line.strip() for error in refusals for line in error.lines)


def mutated(data: bytes, dice: random.Random) -> bytes:
    out = bytearray(data)
    for _ in range(dice.choice((1, 1, 2, 5))):
        at = int(dice.random() ** 2 * len(out))
        size = dice.choice((1, 4, 64))
        kind = dice.randrange(5)
        if kind == 0:
            out[at] ^= 1 << dice.randrange(8)
        elif kind == 1:
            out[at : at + size] = dice.randbytes(size)
        elif kind == 2:
            out[at : at + 4] = dice.choice((b"\xff\xff\xff\xff", b"\0\0\0\0", b"\0\0\0\x80", b"\xff\xff\xff\x7f"))
        elif kind == 3:
            out[at:at] = out[at : at + size]
        else:
            del out[at : at + size if dice.random() < 0.8 else len(out)]
        if not out:
            return b"\0"
    return bytes(out)


def test_the_topic_with_the_most_messages_is_read_and_the_others_named(tmp_path: Path) -> None:
    recorded = [("/few", T0_NS, nav_sat_fix(T0_NS, lat_deg=1.0))]
    recorded += [("/many", T0_NS + k, nav_sat_fix(T0_NS + k * 10**8, lat_deg=2.0)) for k in range(3)]
    reader = open_recording([write_bag2(tmp_path / "bag", recorded)], ReadOptions())
    assert set(reader.track().lat_deg) == {2.0}
    (notice,) = [notice for notice in reader.notices if notice.code == "bag-topic-chosen"]
    assert "/few (1)" in notice.text


@pytest.mark.parametrize(
    ("status", "sigma_m", "fix"),
    [
        (-1, 0.02, Fix.NONE),
        (0, 1.5, Fix.SINGLE),
        (1, 0.8, Fix.DGPS),
        (2, 0.01, Fix.FIXED),
        (2, 0.4, Fix.FLOAT),
        (2, None, Fix.FLOAT),
        (7, 0.01, Fix.NONE),
    ],
)
def test_the_fix_of_a_nav_sat_fix(tmp_path: Path, status: int, sigma_m: float | None, fix: Fix) -> None:
    recorded = [("/fix", T0_NS, nav_sat_fix(T0_NS, status, sigma_m))]
    reader = open_recording([write_bag2(tmp_path / "bag", recorded)], ReadOptions())
    track = reader.track()
    assert track.fix.tolist() == [fix]
    assert track.sigma_e_m[0] == pytest.approx(sigma_m or float("nan"), nan_ok=True)
    assert track.sigma_h_m[0] == pytest.approx(2 * sigma_m if sigma_m else float("nan"), nan_ok=True)
    assert track.height_m[0] == 55.5
    assert ("gnss-fix-guessed" in codes(reader)) == (status == 2)


def test_positions_out_of_order_are_put_in_order_and_reported(tmp_path: Path) -> None:
    steps = (0, 1, 3, 2, 2, 4)
    recorded = [("/fix", T0_NS + k, nav_sat_fix(T0_NS + step * 10**8)) for k, step in enumerate(steps)]
    reader = open_recording([write_bag2(tmp_path / "bag", recorded)], ReadOptions())
    assert (reader.track().t_s - T0_NS * 1e-9).round(3).tolist() == [0, 0.1, 0.2, 0.3, 0.4]
    assert "gnss-time-back" in codes(reader)


def test_nothing_is_reported_twice(tmp_path: Path) -> None:
    reader = open_recording([write_bag2(tmp_path / "bag", mixed())], ReadOptions())
    reader.inspect()
    notices = list(reader.notices)
    reader.track()
    list(reader.scans())
    assert reader.notices == notices


def test_a_position_nowhere_on_earth_is_left_out(tmp_path: Path) -> None:
    recorded = [("/fix", T0_NS + k, nav_sat_fix(T0_NS + k * 10**8, lat_deg=lat)) for k, lat in enumerate((43.0, 1e9))]
    reader = open_recording([write_bag2(tmp_path / "bag", recorded)], ReadOptions())
    assert len(reader.track()) == 1
    assert "bag-messages-damaged" in codes(reader)


def test_promise_07__an_old_bag_and_an_encrypted_one_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.bag"
    path.write_bytes(b"#ROSBAG V1.2\n" + bytes(100))
    with pytest.raises(InputError, match=r"version 1\.2"):
        Recognised.by_content(path).inspect()
    fields = [b"op=\x03", b"index_pos=" + bytes(8), b"encryptor=rosbag/AesCbcEncryptor"]
    header = b"".join(struct.pack("<I", len(field)) + field for field in fields)
    path.write_bytes(b"#ROSBAG V2.0\n" + struct.pack("<I", len(header)) + header + bytes(4))
    with pytest.raises(InputError, match="encrypted"):
        Recognised.by_content(path).inspect()


def test_another_database_is_no_bag(tmp_path: Path) -> None:
    path = tmp_path / "a.db3"
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE things (id INTEGER)")
    with pytest.raises(InputError, match="SQLite"):
        Recognised.by_content(path)


def test_packets_that_are_none__are_left_out_and_counted(tmp_path: Path) -> None:
    packets = turning(150)
    packets[70] = bytes(1206)
    packets[71] = b"\xee\xff" + packets[71][2:]
    recorded = [
        (
            "/velodyne_packets",
            T0_NS + 100_000_000 * k,
            velodyne_scan(T0_NS + 100_000_000 * k, packets[75 * k : 75 * k + 75]),
        )
        for k in range(2)
    ]
    found = Recognised.by_content(write_bag2(tmp_path / "bag", recorded)).inspect()
    (notice,) = (notice for notice in found.notices if notice.code == "packets-damaged")
    assert "2 packets" in notice.text


WORDS = {"within the header of a record", "the last record is truncated by"}


@pytest.mark.parametrize("kind", ["plain.bag", "plain.mcap"])
def test_promise_06__a_cut_at_any_byte_gives_the_messages_before_it(tmp_path: Path, kind: str) -> None:
    """Also within the few bytes of a record's header, where no size is known yet."""
    path = KINDS[kind](tmp_path)
    data = path.read_bytes()
    whole = list(BagFiles([path]).messages())
    cut = tmp_path / f"cut{path.suffix}"
    said = set()
    for at in [*range(20, 400, 7), *range(len(data) - 400, len(data) - 9)]:
        cut.write_bytes(data[:at])
        files = BagFiles([cut])
        left = list(files.messages())
        assert left == whole[: len(left)]
        said |= {word for notice in files.notices for word in WORDS if word in notice.text}
    assert said == WORDS


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_promise_06__a_compressed_bag_that_was_cut_is_read_up_to_there(tmp_path: Path, kind: str) -> None:
    path = KINDS[kind](tmp_path)
    whole = [message.topic for message in BagFiles([path]).messages()]
    packed = gzip.compress(path.read_bytes())
    for share in (0.5, 0.9):
        cut = tmp_path / f"cut{path.suffix}"
        cut.write_bytes(packed[: int(share * len(packed))])
        files = BagFiles([cut])
        with suppress(InputError) if "db3" in kind else nullcontext():  # SQLite may not open half a database
            left = [message.topic for message in files.messages()]
            assert left == whole[: len(left)]
        assert "bag-cut" in codes(files)


def test_rows_of_a_database_that_are_no_messages_are_counted(tmp_path: Path) -> None:
    path = KINDS["plain.db3"](tmp_path)
    with sqlite3.connect(path) as database:
        database.execute("UPDATE messages SET timestamp = 'noon' WHERE id = 2")
        database.execute("UPDATE messages SET data = 'text' WHERE id = 3")
    database.close()
    files = BagFiles([path])
    assert len(list(files.messages())) == 8
    (notice,) = [notice for notice in files.notices if notice.code == "bag-orphans"]
    assert "2 rows that are not messages of a known topic are skipped" in notice.text


@pytest.mark.parametrize("number", ["NULL", "'text'", "-5"])
def test_rows_of_a_database_without_numbers_are_read(tmp_path: Path, number: str) -> None:
    """As of a damaged description of the table, by which `id` is no key any more."""
    path = KINDS["plain.db3"](tmp_path)
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE others AS SELECT * FROM messages")
        database.execute(f"UPDATE others SET id = {number}")
        database.execute("DROP TABLE messages")
        database.execute("ALTER TABLE others RENAME TO messages")
    database.close()
    files = BagFiles([path])
    assert len(list(files.messages())) == 10
    assert 0.0 <= files.share_read <= 1.0


def test_messages_in_another_encoding_are_refused(tmp_path: Path) -> None:
    path = KINDS["plain.db3"](tmp_path)
    with sqlite3.connect(path) as database:
        database.execute("UPDATE topics SET serialization_format = 'xml'")
    database.close()
    with pytest.raises(InputError, match="unsupported encoding 'xml'"):
        open_recording([path], ReadOptions()).track()


def test_a_position_that_is_no_number_has_no_fix(tmp_path: Path) -> None:
    places = [(43.0, 141.0), (float("nan"), 141.0), (43.0, float("nan")), (43.0, 141.0)]
    recorded = [
        ("/fix", T0_NS + k, nav_sat_fix(T0_NS + k * 10**8, lat_deg=lat, lon_deg=lon))
        for k, (lat, lon) in enumerate(places)
    ]
    track = open_recording([write_bag2(tmp_path / "bag", recorded)], ReadOptions()).track()
    assert track.fix.tolist() == [Fix.FIXED, Fix.NONE, Fix.NONE, Fix.FIXED]


@pytest.mark.parametrize("method", ["bz2", "lz4", "zstd"])
def test_inflate__stops_at_the_declared_size(method: str) -> None:
    """A chunk that holds more than it declares is no bomb; one that holds less says how much is missing."""
    pack = {"bz2": bz2.compress, "lz4": lz4.frame.compress, "zstd": zstd.compress}[method]
    content = random.Random(1).randbytes(50_000) * 4
    packed = pack(content)
    assert inflate(packed, method, len(content)) == (content, None)
    assert inflate(packed + b"more" * 300_000, method, len(content)) == (content, None)
    assert inflate(packed, method, 1000) == (content[:1000], None)
    whole, fault = inflate(packed, method, len(content) + 5)
    assert (whole, str(fault)) == (content, "it has 200000 bytes instead of the declared 200005")
    with pytest.raises(Damage, match=f"a chunk of {MAX_RECORD_BYTES + 1} bytes is declared"):
        inflate(packed, method, MAX_RECORD_BYTES + 1)


def test_decompress_message__a_message_in_zstd_is_whole_or_damaged() -> None:
    content = random.Random(1).randbytes(5000)
    packed = zstd.compress(content)
    assert decompress_message(packed) == content
    assert decompress_message(content) == content
    with pytest.raises(Damage, match="truncated"):
        decompress_message(packed[:-9])
    with pytest.raises(Damage, match="its zstd data are damaged"):
        decompress_message(packed[:4] + b"\xff" * 20)


@pytest.mark.parametrize(
    "field",
    [b"\x05\0\0\0op\x3d\x03", b"\x03\0\0\0opx", b"\x04\0\0", b"\x01"],
    ids=["longer than the header", "without an equals sign", "three bytes", "one byte"],
)
def test_a_header_whose_fields_do_not_fill_it_ends_the_reading_there(field: bytes, tmp_path: Path) -> None:
    """A record with an impossible field after all messages; without it, the bag would be complete."""
    path = write_bag1(tmp_path / "a.bag", mixed(ROS1))
    whole = BagFiles([path])
    expected = list(whole.messages())
    header = struct.pack("<I", 4) + b"op=\x04" + field
    path.write_bytes(path.read_bytes() + struct.pack("<I", len(header)) + header + bytes(4))
    files = BagFiles([path])
    assert list(files.messages()) == expected
    assert not whole.notices
    (notice,) = files.notices
    assert notice.code == "bag-cut"
    assert "the header of a record is damaged" in notice.text


@pytest.mark.parametrize("store", [ROS1, ROS2], ids=["ROS 1", "ROS 2"])
@pytest.mark.parametrize("late_ms", [[10, 10, 10], [20, 40, 600]], ids=str)
def test_inspect__says_how_long_after_their_stamps_positions_were_received(
    store: Any, late_ms: list[int], tmp_path: Path
) -> None:
    stamps_ns = [T0_NS + k * 10**9 for k in range(len(late_ms))]
    recorded = [
        ("/fix", at_ns + late * 10**6, nav_sat_fix(at_ns, store=store))
        for at_ns, late in zip(stamps_ns, late_ms, strict=True)
    ]
    path = write_bag1(tmp_path / "a.bag", recorded) if store is ROS1 else write_bag2(tmp_path / "bag", recorded)
    (clock,) = (clock for clock in Recognised.by_content(path).inspect().clocks if clock.clock is Clock.GNSS)
    assert f"received {late_ms[1] / 1000.0:.3f} s later (median)" in clock.note


def test_positions__without_a_stamp_are_at_the_time_of_their_reception(tmp_path: Path) -> None:
    recorded = [("/fix", T0_NS + k * 10**8, nav_sat_fix(0)) for k in range(3)]
    track = open_recording([write_bag2(tmp_path / "bag", recorded)], ReadOptions()).track()
    assert track.t_s - T0_NS * 1e-9 == pytest.approx([0.0, 0.1, 0.2], abs=1e-6)
