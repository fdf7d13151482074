"""Files of a few megabytes at most that state, repeat or unpack to far more than they hold."""

from __future__ import annotations

import bz2
import gzip
import io
import json
import sqlite3
import struct
import sys
import zipfile
import zlib
from collections.abc import Callable
from contextlib import closing
from functools import reduce
from pathlib import Path
from typing import Final

import numpy as np

from tests.core.readers.osf_files import Blob, buffer, checked, numbers, osf_of, table, tables
from tests.core.readers.test_ouster import recorded
from tests.fuzz.inertial import INERTIAL
from tests.fuzz.positions import POSITIONS

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MB: Final = 1 << 20


def packed(path: Path, head: bytes, block: bytes, size: int) -> Path:
    """A gzip of a beginning and of a block again and again."""
    block *= max(1, MB // len(block))
    with gzip.open(path, "wb", 6) as file:
        file.write(head)
        for _ in range(size // len(block)):
            file.write(block)
    return path


def sentence(body: str) -> bytes:
    return f"${body}*{reduce(lambda a, c: a ^ ord(c), body, 0):02X}\r\n".encode()


FIXES: Final = b"".join(
    sentence(f"GPGGA,1000{k:02d}.00,5222.5480,N,02056.1360,E,4,12,0.7,100.0,M,30.0,M,,") for k in range(40)
)


def osf_parts(entries: Blob, chunks: bytes) -> bytes:
    metadata = checked(buffer(table(None, None, None, None, entries), b"OSF#"))
    size = len(checked(buffer(table(20, 2, 0, 0), b"OSF$")))
    head = checked(buffer(table(20, 2, size + len(chunks), size + len(chunks) + len(metadata)), b"OSF$"))
    return head + chunks + metadata


def aliased(count: int, one: Blob) -> Blob:
    """A vector of tables that all are the same one."""
    offsets = b"".join(struct.pack("<I", 4 * (count - k) + one[1]) for k in range(count))
    return struct.pack("<I", count) + offsets + one[0], 0


def sensor_entries(folder: Path) -> list[Blob]:
    recorded(folder, 1.0, return_mode="dual")
    said = (folder / "drive.json").read_bytes()
    (folder / "drive.pcap").unlink()
    return [
        table(number, numbers(f"ouster/v1/os_sensor/{kind}".encode()), numbers(buffer(table(content))))
        for number, kind, content in ((1, "LidarSensor", numbers(said)), (2, "LidarScanStream", 1))
    ]


def osf_entries(folder: Path) -> Path:
    """100,000 entries of the metadata are one of a megabyte."""
    one = table(1, numbers(b"ouster/v1/os_sensor/LidarSensor"), numbers(bytes(MB)))
    path = folder / "a.osf"
    path.write_bytes(osf_parts(aliased(100_000, one), b""))
    return path


def osf_messages(folder: Path) -> Path:
    """100,000 messages of a chunk are one of a turn."""
    path = recorded(folder, 1.0, return_mode="dual")
    whole = osf_of([path])
    path.unlink()
    begin = whole.index(b"OSF!") - 8
    chunk = whole[begin : begin + 8 + int.from_bytes(whole[begin : begin + 4], "little")]
    root = 4 + int.from_bytes(chunk[4:8], "little")
    fields = root - struct.unpack_from("<i", chunk, root)[0]
    place = root + struct.unpack_from("<H", chunk, fields + 4)[0]
    vector = place + struct.unpack_from("<I", chunk, place)[0]
    message = vector + 4 + struct.unpack_from("<I", chunk, vector + 4)[0]
    inside = message - vector - 8
    one = chunk[vector + 8 :], inside
    path = folder / "a.osf"
    path.write_bytes(osf_parts(tables(sensor_entries(folder)), checked(buffer(table(aliased(100_000, one)), b"OSF!"))))
    return path


def osf_turns(folder: Path) -> Path:
    """Thousands of turns of the same number without returns, which compress to nothing."""
    beams = 32
    columns = 1024
    image = struct.pack("<2sHHBB", b"\xf8\xfb", columns, beams, 4, 1) + zstd.compress(bytes(4 * beams * columns))
    stamps = (1_750_000_000_000_000_000 + np.arange(columns)).astype("<u8")
    turn = table(
        tables([table(numbers(image))]), numbers(np.array([0x301], "<u2")), numbers(stamps),
        numbers(np.arange(columns, dtype="<u2")), numbers(np.ones(columns, "<u4")), 7, None, numbers(stamps[:64]),
    )  # fmt: skip
    one = numbers(buffer(turn))
    chunks = checked(buffer(table(tables([table(1_750_000_000_000_000_000, 2, one)])), b"OSF!")) * 250
    path = folder / "a.osf"
    path.write_bytes(osf_parts(tables(sensor_entries(folder)), chunks))
    return path


def shifted(value: int) -> int:
    for _ in range(8):
        value = value >> 1 ^ 0x82F63B78 * (value & 1)
    return value


CRC_TABLE: Final = np.array([shifted(k) for k in range(256)], np.uint32)
"""Of CRC-32C, by bytes."""


def e57_of(content: bytes, xml: str, page: int) -> bytes:
    """An E57 file of content behind the header and XML, in pages of a size."""
    at = 48 + len(content)
    place = at // (page - 4) * page + at % (page - 4)
    text = xml.encode()
    whole = struct.pack("<8sIIQQQQ", b"ASTM-E57", 1, 0, 0, place, len(text), page) + content + text
    step = page - 4
    whole = whole.ljust(-(-len(whole) // step) * step, b"\0")
    rows = np.frombuffer(whole, np.uint8).reshape(-1, step)
    crc = np.full(len(rows), 0xFFFFFFFF, np.uint32)
    for k in range(step):
        crc = CRC_TABLE[(crc ^ rows[:, k]) & 0xFF] ^ (crc >> np.uint32(8))
    return np.hstack([rows, (~crc).astype(">u4")[:, None].view(np.uint8)]).tobytes()


def e57_xml(scans: int, points: int, fields: str, place: int = 48) -> str:
    one = (
        f'<vectorChild type="Structure"><points type="CompressedVector" fileOffset="{place}" recordCount="{points}">'
        f'<prototype type="Structure">{fields}</prototype></points></vectorChild>'
    )
    return f'<e57Root type="Structure"><data3D type="Vector">{one * scans}</data3D></e57Root>'


NO_BITS: Final = "".join(f'<cartesian{axis} type="Integer" minimum="5" maximum="5"/>' for axis in "XYZ")
ONE_BIT: Final = "".join(f'<cartesian{axis} type="Integer" minimum="0" maximum="1"/>' for axis in "XYZ")


def section(packets: bytes) -> bytes:
    return struct.pack("<B7xQQQ", 1, 32 + len(packets), 80, 0) + packets


def data_packet(*streams: bytes) -> bytes:
    body = struct.pack(f"<H{len(streams)}H", len(streams), *map(len, streams)) + b"".join(streams)
    body += bytes(-(4 + len(body)) % 4)
    return struct.pack("<BBH", 1, 0, 4 + len(body) - 1) + body


def e57(name: str, content: bytes, xml: str, page: int = 1024) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        path = folder / f"{name}.e57"
        path.write_bytes(e57_of(content, xml, page))
        return path

    return make


EMPTY: Final = struct.pack("<BBHH2x", 2, 0, 7, 0)
"""A packet of eight bytes without points."""
MANY_FIELDS: Final = "".join(f'<f{k} type="Integer" minimum="5" maximum="5"/>' for k in range(30_000))


def csv_line(folder: Path) -> Path:
    """A line without an end."""
    return packed(folder / "a.csv.gz", b"time_unix_s,angle_deg,range_m\n", b"1.5,2.5,3.5,", 150 * MB)


def csv_columns(folder: Path) -> Path:
    path = folder / "a.csv"
    names = ",".join(["time_unix_s", "lat_deg", "lon_deg", "height_m", *(f"c{k}" for k in range(100_000))])
    path.write_text(f"{names}\n" + "1,2,3,4\n" * 150_000, encoding="utf-8")
    return path


def csv_rows(folder: Path) -> Path:
    return packed(folder / "a.csv.gz", b"time_unix_s,lat_deg,lon_deg,height_m\n", b"1,2,3,4\n", 175 * MB)


def mcap_record(kind: int, content: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(content)) + content


def text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


def mcap_head() -> bytes:
    schema = struct.pack("<H", 1) + text("sensor_msgs/msg/PointCloud2") + text("ros2msg") + text("")
    channel = struct.pack("<HH", 1, 1) + text("/points") + text("cdr") + text("")
    return b"\x89MCAP0\r\n" + mcap_record(1, text("ros2") + text("")) + mcap_record(3, schema) + mcap_record(4, channel)


def mcap_chunks(method: str, pack: Callable[[bytes], bytes]) -> Callable[[Path], Path]:
    """Chunks of messages of zeros, each of 50 megabytes from a few kilobytes."""

    def make(folder: Path) -> Path:
        message = mcap_record(5, struct.pack("<HIQQ", 1, 0, 10**18, 10**18) + bytes(50 * MB))
        small = pack(message)
        chunk = struct.pack("<QQQI", 0, 0, len(message), 0) + text(method) + struct.pack("<Q", len(small)) + small
        path = folder / "a.mcap"
        path.write_bytes(mcap_head() + mcap_record(6, chunk) * 200)
        return path

    return make


def mcap_messages(folder: Path) -> Path:
    """Messages that are compressed each."""
    small = zstd.compress(b"\0\1\0\0" + bytes(50 * MB))
    record = mcap_record(5, struct.pack("<HIQQ", 1, 0, 10**18, 10**18) + small)
    path = folder / "a.mcap"
    path.write_bytes(mcap_head() + record * 200)
    return path


def mcap_damage(folder: Path) -> Path:
    """50,000 chunks that cannot be read."""
    path = folder / "a.mcap"
    cloud = mcap_record(5, struct.pack("<HIQQ", 1, 0, 10**18, 10**18) + bytes(100))
    path.write_bytes(mcap_head() + cloud + mcap_record(6, b"\xff" * 12) * 50_000)
    return path


def bag_unknown(folder: Path) -> Path:
    """50,000 records of unknown kinds in a bag of ROS 1."""
    header = struct.pack("<I", 4) + b"op=\x63"
    path = folder / "a.bag"
    path.write_bytes(b"#ROSBAG V2.0\n" + (struct.pack("<I", len(header)) + header + struct.pack("<I", 0)) * 50_000)
    return path


def database(folder: Path, script: str) -> Path:
    path = folder / "a.db3"
    with closing(sqlite3.connect(path)) as connection:
        connection.executescript(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT);"
            "INSERT INTO topics VALUES (1, '/points', 'sensor_msgs/msg/PointCloud2', 'cdr');" + script
        )
        connection.commit()
    return path


def db3_view(folder: Path) -> Path:
    """The messages are a view without end."""
    return database(
        folder,
        "CREATE VIEW messages AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM n)"
        " SELECT id, 1 AS topic_id, id AS timestamp, zeroblob(1000) AS data FROM n;",
    )


def db3_pages(folder: Path) -> Path:
    """The pages of the tree of messages refer to one leaf."""
    path = database(
        folder,
        "PRAGMA page_size = 4096; VACUUM;"
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);"
        "WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM n WHERE id < 100000)"
        " INSERT INTO messages SELECT id, 1, id, zeroblob(2) FROM n;",
    )
    data = bytearray(path.read_bytes())
    for page in range(1, len(data) // 4096):  # interior pages of a table: all cells refer to the first child
        at = 4096 * page
        if data[at] == 5:
            count = int.from_bytes(data[at + 3 : at + 5], "big")
            cells = [int.from_bytes(data[at + 12 + 2 * k : at + 14 + 2 * k], "big") for k in range(count)]
            first = data[at + cells[0] : at + cells[0] + 4]
            for cell in cells:
                data[at + cell : at + cell + 4] = first
            data[at + 8 : at + 12] = first
    path.write_bytes(data)
    return path


def task_data(folder: Path, inside: str, **files: bytes) -> Path:
    (folder / "TASKDATA.XML").write_text(
        f'<ISO11783_TaskData VersionMajor="4" VersionMinor="2">{inside}</ISO11783_TaskData>', encoding="utf-8"
    )
    for name, data in files.items():
        (folder / name.replace("_", ".")).write_bytes(data)
    return folder / "TASKDATA.XML"


TIME_LOG: Final = b'<TIM A="" D="4"><PTN A="" B="" D=""/><DLV A="0074" B="" C="DET-1"/></TIM>'


def time_log_twice(folder: Path) -> Path:
    """A task names one time log of a megabyte 50,000 times, and 1,000 tasks name it."""
    record = b"".join(
        struct.pack("<IHiiBB", 36_000_000 + 1000 * k, 16_000, 520_000_000 + k, 100_000_000, 4, 0) for k in range(30_000)
    )
    log = '<TLG A="TLG00001"/>'
    tasks = f'<TSK A="TSK1" B="a" G="4">{log * 50_000}</TSK>'
    tasks += "".join(f'<TSK A="TSK{k}" B="a" G="4">{log}</TSK>' for k in range(2, 1000))
    return task_data(folder, tasks, TLG00001_XML=TIME_LOG, TLG00001_BIN=record)


def external_twice(folder: Path) -> Path:
    """An external file of a megabyte is named 50,000 times."""
    fields = "".join(f'<CTR A="CTR{k}" B="x"/>' for k in range(40_000))
    return task_data(folder, '<XFR A="PFD00001" B="1"/>' * 50_000, PFD00001_XML=f"<XFC>{fields}</XFC>".encode())


def xml_texts(folder: Path) -> Path:
    """Text in half a million pieces between elements."""
    return task_data(folder, "x<b/>" * 400_000)


def overlapping(folder: Path) -> Path:
    """Entries of an archive that are the same bytes, which unpack to 100 MB."""
    small = zlib.compressobj(9, zlib.DEFLATED, -15)
    content = bytes(100 * MB)
    checksum = zlib.crc32(content)
    data = small.compress(content) + small.flush()
    local = struct.pack("<4sHHHHHIIIHH", b"PK\3\4", 20, 0, 8, 0, 0, checksum, len(data), len(content), 12, 0)
    local += b"TASKDATA.XML" + data
    entries = b""
    for k in range(2000):
        name = b"TASKDATA.XML" if not k else b"TLG%05d.XML" % k
        entries += struct.pack(
            "<4sHHHHHHIIIHHHHHII", b"PK\1\2", 20, 20, 0, 8, 0, 0, checksum, len(data), len(content),
            len(name), 0, 0, 0, 0, 0, 0,
        ) + name  # fmt: skip
    end = struct.pack("<4sHHHHIIH", b"PK\5\6", 0, 0, 2000, 2000, len(entries), len(local), 0)
    path = folder / "a.zip"
    path.write_bytes(local + entries + end)
    return path


def many_entries(folder: Path) -> Path:
    """30,000 entries of an archive without content."""
    path = folder / "a.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for k in range(30_000):
            archive.writestr(f"{k}", b"")
    return path


def workbook(folder: Path, cells: str, shared: str = "") -> Path:
    """An xlsx of a sheet."""
    main = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
    office = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    package = "http://schemas.openxmlformats.org/package/2006"
    path = folder / "a.xlsx"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("[Content_Types].xml", f'<Types xmlns="{package}/content-types"/>')
        relation = f'<Relationship Id="r1" Type="{office}/officeDocument" Target="xl/workbook.xml"/>'
        archive.writestr("_rels/.rels", f'<Relationships xmlns="{package}/relationships">{relation}</Relationships>')
        sheet = '<sheet name="a" sheetId="1" r:id="r1"/>'
        archive.writestr(
            "xl/workbook.xml", f'<workbook xmlns="{main}" xmlns:r="{office}"><sheets>{sheet}</sheets></workbook>'
        )
        relations = f'<Relationship Id="r1" Type="{office}/worksheet" Target="worksheets/sheet1.xml"/>'
        relations += f'<Relationship Id="r2" Type="{office}/sharedStrings" Target="sharedStrings.xml"/>'
        archive.writestr(
            "xl/_rels/workbook.xml.rels",
            f'<Relationships xmlns="{package}/relationships">{relations}</Relationships>',
        )
        archive.writestr("xl/sharedStrings.xml", f'<sst xmlns="{main}"><si><t>{shared}</t></si></sst>')
        archive.writestr(
            "xl/worksheets/sheet1.xml", f'<worksheet xmlns="{main}"><sheetData>{cells}</sheetData></worksheet>'
        )
    return path


def sheet_corner(folder: Path) -> Path:
    """Two cells at opposite corners of the largest sheet."""
    return workbook(
        folder, '<row r="1"><c r="A1"><v>1</v></c></row><row r="1048576"><c r="XFD1048576"><v>2</v></c></row>'
    )


def sheet_shared(folder: Path) -> Path:
    """50,000 cells of one text of a megabyte."""
    rows = "".join(f'<row r="{k}"><c r="A{k}" t="s"><v>0</v></c></row>' for k in range(1, 50_001))
    return workbook(folder, rows, "x" * MB)


def wide_table(folder: Path) -> Path:
    path = folder / "a.csv"
    path.write_text(",".join(f"c{k}" for k in range(100_000)) + "\n" + "1\n" * 500_000, encoding="utf-8")
    return path


def session(body: str) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        path = folder / "session.toml"
        path.write_text(body, encoding="utf-8")
        return path

    return make


def picture(name: str, size: int) -> Callable[[Path], Path]:
    """A picture of one colour of so many pixels a side, whose pixels are there or not."""

    def make(folder: Path) -> Path:
        path = folder / name
        pixels = zlib.compressobj(9)
        data = b""
        if size <= 20_000:
            data = b"".join(pixels.compress(bytes(1 + 3 * size)) for _ in range(size)) + pixels.flush()
        parts = ((b"IHDR", struct.pack(">IIBBBBB", size, size, 8, 2, 0, 0, 0)), (b"IDAT", data), (b"IEND", b""))
        out = b"\x89PNG\r\n\x1a\n"
        for kind, content in parts:
            out += struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
        path.write_bytes(out)
        return path

    return make


def jpeg(folder: Path) -> Path:
    """A JPEG that states 65,500 pixels a side."""
    from PIL import Image

    out = io.BytesIO()
    Image.new("RGB", (16, 16)).save(out, "JPEG")
    data = bytearray(out.getvalue())
    at = data.index(b"\xff\xc0") + 5
    data[at : at + 4] = struct.pack(">HH", 65_500, 65_500)
    path = folder / "a.jpg"
    path.write_bytes(data)
    return path


def ouster_metadata(change: Callable[[dict[str, object]], str]) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        path = recorded(folder, 1.0)
        (folder / "drive.json").write_text(change(json.loads((folder / "drive.json").read_text())), encoding="utf-8")
        return path

    return make


def sbet(folder: Path) -> Path:
    """Poses of a vehicle that stands, which compress to nothing; their times increase at the beginning."""
    records = np.zeros((300, 17))
    records[:, :4] = (1.0, 0.9, 0.2, 100.0)
    records[:, 0] += 0.005 * np.arange(300)
    return packed(folder / "a.sbet.gz", records.tobytes(), records[-1:].tobytes(), 175 * MB)


def stuttering(entry: str, start: bytes) -> Callable[[Path], Path]:
    """A sound file, and the beginning of a frame that claims the largest length again and again."""

    def make(folder: Path) -> Path:
        seeds = folder / "seeds"
        seeds.mkdir()
        made = next(each for each in (*POSITIONS, *INERTIAL) if each.name == entry).seeds(seeds)
        name, data = next(iter(made[0].items()))
        path = folder / name
        path.write_bytes(data + start * (3 * MB // 2 // len(start)))
        return path

    return make


NOVATEL: Final = b"\xaa\x44\x12\x1c\x2a\x00\x00\x20\xff\xff" + bytes(4)
VECTORNAV: Final = b"\xfa\x7f" + b"\xff\x7f" * 7
LIES: Final[dict[str, tuple[str, Callable[[Path], Path]]]] = {
    "osf, entries": ("recording", osf_entries),
    "osf, messages": ("recording", osf_messages),
    "osf, turns": ("recording", osf_turns),
    "e57, no bits": ("cloud", e57("a", section(data_packet(b"", b"", b"")), e57_xml(1, 10**12, NO_BITS))),
    "e57, one bit": (
        "cloud",
        e57("a", section(data_packet(*[bytes(16_000)] * 3) * 30), e57_xml(1, 30 * 128_000, ONE_BIT)),
    ),
    "e57, pages": ("cloud", e57("a", section(EMPTY * 60_000), e57_xml(1, 1000, ONE_BIT), 1 << 19)),
    "e57, scans": (
        "cloud",
        e57("a", section(EMPTY * 100_000 + data_packet(b"1", b"1", b"1")), e57_xml(5000, 8, ONE_BIT)),
    ),
    "e57, same points": (
        "cloud",
        e57("a", section(data_packet(*[bytes(16_000)] * 3) * 20), e57_xml(5000, 20 * 128_000, ONE_BIT)),
    ),
    "e57, fields": (
        "cloud",
        e57("a", section(data_packet(b"", b"", b"")), e57_xml(1, 1000, NO_BITS + MANY_FIELDS)),
    ),
    "nmea, dollars": ("recording", lambda folder: packed(folder / "a.nmea.gz", FIXES, b"$", 150 * MB)),
    "nmea, short": ("recording", lambda folder: packed(folder / "a.nmea.gz", FIXES, sentence("GPGGA,"), 150 * MB)),
    "nmea, fixes": ("recording", lambda folder: packed(folder / "a.nmea.gz", FIXES, FIXES, 150 * MB)),
    "csv, line": ("recording", csv_line),
    "csv, columns": ("recording", csv_columns),
    "csv, rows": ("recording", csv_rows),
    "mcap, zstd": ("recording", mcap_chunks("zstd", zstd.compress)),
    "mcap, bz2": ("recording", mcap_chunks("bz2", bz2.compress)),
    "mcap, messages": ("recording", mcap_messages),
    "mcap, damage": ("recording", mcap_damage),
    "bag, unknown": ("recording", bag_unknown),
    "db3, view": ("recording", db3_view),
    "db3, pages": ("recording", db3_pages),
    "isoxml, time log": ("recording", time_log_twice),
    "isoxml, external": ("recording", external_twice),
    "isoxml, texts": ("recording", xml_texts),
    "zip, overlapping": ("recording", overlapping),
    "zip, entries": ("recording", many_entries),
    "xlsx, corner": ("sheet", sheet_corner),
    "xlsx, shared": ("sheet", sheet_shared),
    "table, wide": ("table", wide_table),
    "session, long": ("session", session("furrowmap = 1\n" + "a = 1\n" * 4_000_000)),
    "session, parts": ("session", session("a." * 100_000 + "b = 1")),
    "session, quoted parts": ("session", session("x = {" + '"a".' * 100_000 + "b = 1}")),
    "session, nested": ("session", session("a = " + "[" * 100_000)),
    "session, quotes": ("session", session("'" * 3_000_000)),
    "session, words": ("session", session("a" * 3_000_000)),
    "picture, stated": ("image", picture("a.png", 100_000)),
    "picture, there": ("image", picture("a.png", 13_000)),
    "jpeg, stated": ("image", jpeg),
    "ouster, nested": ("recording", ouster_metadata(lambda _: "[" * 100_000)),
    "ouster, columns": (
        "recording",
        ouster_metadata(lambda said: json.dumps(said).replace('"columns_per_frame": 1024', '"columns_per_frame": 1e9')),
    ),
    "sbet": ("recording", sbet),
    "novatel": ("recording", stuttering("novatel", NOVATEL)),
    "ubx": ("recording", stuttering("ubx", b"\xb5\x62\x01\x07\xff\x1f")),
    "sbf": ("recording", stuttering("sbf", b"$@\0\0\xa7\x0f\xf8\xff")),
    "gsof": ("recording", stuttering("gsof", b"\x02")),
    "vectornav": ("recording", stuttering("vectornav", VECTORNAV)),
}
"""Kind of reading → a file in a folder."""
