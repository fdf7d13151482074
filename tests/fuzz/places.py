"""Results, sessions, archives and orders to the worker that name places outside the folders they belong to.

Each input is laid in a folder beside files that nobody named. A command works on it, and afterwards these files must be
as they were: a listing sees what native libraries do, an audit hook what Python does anywhere else.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import shutil
import sqlite3
import stat
import sys
import tempfile
import zipfile
from collections.abc import Callable, Sequence
from contextlib import closing, nullcontext, redirect_stdout, suppress
from pathlib import Path
from random import Random
from typing import Any

from furrowmap.cli.main import attempt
from furrowmap.cli.worker_process import WorkerConsole, _arguments
from furrowmap.core.runtime.errors import FurrowmapError
from furrowmap.exporters.files import lease
from furrowmap.exporters.files.owner import machine
from tests.exporters.farm.result_folders import rename_layer, write_result
from tests.fuzz.mutations import Files
from tests.fuzz.trials import Entry

VICTIM = "victim.txt"
NAMES = (
    *(
        f"../{VICTIM}",
        f"..\\{VICTIM}",
        f"x/../../{VICTIM}",
        "..",
        ".",
        "/",
        "",
        "../",
        "~/x",
        "/etc/furrowmap-x",
        "C:\\x",
    ),
    *("/proc/self/mem", "/dev/zero", "/vsicurl/http://localhost/x", "/vsimem/x", "file:///etc/passwd", "\\\\host\\x"),
    *("a\0b", "a\nb", "\x1b[2J", "con", "nul.tif", "x" * 300, "圃" * 100, "\u202egpj.x", "$(touch x)", "`x`", "-rf"),
    *("%s%n", "'; DROP TABLE x; --", '"', "dsm.tif", "report.json", ".furrowmap-run", "../result/report.json"),
)
WRITES = frozenset(
    {"os.rename", "os.remove", "os.rmdir", "os.mkdir", "os.symlink", "os.link", "os.truncate", "os.chmod"}
)
FORMATS = ("csv", "shapefile", "geojson", "kml", "gpkg", "flatgeobuf", "stac", "isoxml")


OWN = (os.devnull, os.path.realpath(os.environ["NUMBA_CACHE_DIR"]))
"""Places of furrowmap's own: nothing, and the compiled kernels."""


class Watch:
    """Sees what Python changes outside of a folder."""

    def __init__(self) -> None:
        self.folder: str | None = None
        self.seen: list[str] = []

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:
        if self.folder is None:
            return
        paths = arguments[:2] if event in ("os.rename", "os.link") else arguments[:1]
        follows = event == "open"
        if event == "open":
            flags = arguments[2] if isinstance(arguments[2], int) else 0
            if not flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC):
                return
            follows = not flags & os.O_NOFOLLOW
        elif event not in WRITES:
            return
        elif event == "os.symlink":
            paths = arguments[1:2]
        descriptor = arguments[-1] if event in ("os.remove", "os.rmdir", "os.mkdir") else -1
        base = Path(f"/proc/self/fd/{descriptor}") if isinstance(descriptor, int) and descriptor >= 0 else Path()
        for path in paths:
            if isinstance(path, str | bytes | os.PathLike):
                whole = base / os.fsdecode(path)
                place = str(whole.resolve() if follows else whole.parent.resolve() / whole.name)
                if not place.startswith((self.folder, str(tempfile.tempdir), *OWN)) and "__pycache__" not in place:
                    self.seen.append(f"{event} {place}")


WATCH = Watch()
_hooked: list[int] = []


def watched(root: Path, named: Sequence[str], work: Callable[[], object]) -> None:
    """Do the work, and see that nothing but the named files and folders of `root` changed.

    Raises:
        FurrowmapError: of the work.
        AssertionError: if anything else changed.
    """
    if os.getpid() not in _hooked:
        _hooked.append(os.getpid())
        sys.addaudithook(WATCH)
        os.environ["OGR_SQLITE_SYNCHRONOUS"] = "OFF"
        os.fsync = lambda _: None
        lease.MAX_SILENCE_S = 0.0
    tempfile.tempdir = str(root.parent / "temporary")
    Path(tempfile.tempdir).mkdir(exist_ok=True)
    before = listing(root, named)
    WATCH.folder, WATCH.seen = os.path.realpath(root), []
    try:
        work()
    finally:
        WATCH.folder = None
        after = listing(root, named)
        changed = sorted(path for path in before.keys() | after.keys() if before.get(path) != after.get(path))
        if WATCH.seen or changed:
            raise AssertionError(f"{WATCH.seen} {changed}")


def listing(root: Path, named: Sequence[str]) -> dict[str, Any]:
    """What is in a folder, but for what was named: kind, size, content of small files, times."""
    found = {}
    for folder, folders, files in os.walk(root):
        if folder == str(root):
            folders[:] = [name for name in folders if name not in named]
            files = [name for name in files if name not in named]
        for name in (*folders, *files):
            path = Path(folder, name)
            status = path.lstat()
            held = (
                path.read_bytes() if stat.S_ISREG(status.st_mode) else str(path.readlink()) if path.is_symlink() else ""
            )
            found[str(path)] = (stat.S_IFMT(status.st_mode), held, 0 if path.is_dir() else status.st_mtime_ns)
    return found


def command(*arguments: object) -> None:
    """Run a command line.

    Raises:
        FurrowmapError: that ended it.
    """
    _, error = attempt([str(argument) for argument in arguments])
    if error is not None:
        raise error


def chance_of(path: Path) -> Random:
    """Chance that the content of an input decides, so that its number makes it again."""
    return Random(
        hashlib.sha256(b"".join(p.read_bytes() for p in sorted(path.parent.iterdir()) if p.is_file())).digest()
    )


def outside(root: Path) -> None:
    """Files that nobody names."""
    (root / VICTIM).write_text("of somebody else")
    (root / "elsewhere").mkdir()
    (root / "elsewhere" / "dsm.tif").write_text("of somebody else")
    with closing(sqlite3.connect(":memory:")) as database:
        database.execute("CREATE TABLE x (y)")
        data = bytearray(database.serialize())
    data[18:20] = b"\2\2"  # a database with a write-ahead log, which reading creates
    (root / "elsewhere" / "other.gpkg").write_bytes(data)


def sound(use: Callable[[Path], None]) -> Callable[[Path], None]:
    """The seeds themselves are made hostile as well, so they may be refused."""

    def read(path: Path) -> None:
        seed = path.parents[1].name.startswith("sound")
        with suppress(FurrowmapError) if seed else nullcontext(), redirect_stdout(io.StringIO()):
            use(path)

    return read


# Results


def result_seeds(folder: Path) -> list[Files]:
    seeds = []
    for number in range(2):
        made = write_result(folder / str(number), name=f"Field {number}", day=number)
        seeds.append({f"result/{name}": (made / name).read_bytes() for name in ("report.json", "field.gpkg")})
    return seeds


def use_result(path: Path) -> None:
    """Names in a result lead out of it; then a command reads it, or writes into it."""
    root, chance = path.parents[1], chance_of(path)
    outside(root)
    for _ in range(chance.randint(0, 3)):
        with suppress(OSError, sqlite3.Error, ValueError, RecursionError, LookupError, TypeError, AttributeError):
            chance.choice((_name_in_report, _name_layer, _leave_lease, _leave_lease, _link_product))(
                path.parent, chance
            )
    out = root / "out"
    arguments = chance.choice(
        (
            ("export", path.parent, "--to", chance.choice(FORMATS), "-o", out),
            ("farm", "add", path.parent, root / "out.gpkg"),
            ("farm", "mosaic", path.parent, "-o", root / "out.vrt"),
            ("export", path.parent, "--to", "csv", "--layer", chance.choice(NAMES), "-o", out),
        )
    )
    watched(root, ("result", "out", "out.gpkg", "out.vrt"), lambda: command(*arguments))


def _name_in_report(result: Path, chance: Random) -> None:
    if (result / "report.json").is_symlink():
        return
    report = json.loads((result / "report.json").read_bytes())
    name = chance.choice(NAMES)
    places: list[Callable[[], object]] = [
        lambda: report.update(products=[name, *report["products"]]),
        lambda: report.update(session_file=name),
        lambda: report["session"].update(name=name),
        lambda: report["session"].update(field={"boundary": name}),
        lambda: report["session"]["crs"].update(map=name),
        lambda: report["inputs"].append({"name": name, "bytes": 0, "sha256": name}),
        lambda: report.update(name=name, folder=name),
    ]
    chance.choice(places)()
    (result / "report.json").write_text(json.dumps(report))


def _name_layer(result: Path, chance: Random) -> None:
    rename_layer(
        result / "field.gpkg", chance.choice(("zones", "passes", "events", "trajectory")), chance.choice(NAMES)
    )


def _leave_lease(result: Path, chance: Random) -> None:
    """What a killed run seems to have left."""
    name = f"{lease.PREFIX}{machine()}-{chance.choice((0, 2**22 + 1))}-1-{chance.randrange(16**8):08x}"
    left = result / chance.choice((name, name, name, ".furrowmap-run", f"{lease.PREFIX}00000000-1-1-00000000"))
    if chance.random() < 0.15:
        left.symlink_to("../elsewhere")
        return
    left.mkdir()
    names = [chance.choice(NAMES) for _ in range(3)]
    (left / "complete.json").write_text(json.dumps({"products": names, "gone": [*names, VICTIM, f"../{VICTIM}"]}))
    if chance.random() < 0.3:
        (left / "products").symlink_to("../../elsewhere")
    else:
        (left / "products").mkdir()
        (left / "products" / "dsm.tif").symlink_to(f"../../../{VICTIM}")
        (left / "products" / "states.csv").write_text("theirs")
        os.mkfifo(left / "products" / "report.json")
    for marker in ("heartbeat", "ended", "kept", "holds", "gone"):
        if chance.random() < 0.3:
            (left / marker).symlink_to(chance.choice((f"../../{VICTIM}", "../../elsewhere", "/dev/zero")))


def _link_product(result: Path, chance: Random) -> None:
    name = chance.choice(("field.gpkg", "report.json", "dsm.tif", "session.toml", ".out.gpkg.lock"))
    place = result.parent if name.startswith(".") else result
    (place / name).unlink(missing_ok=True)
    (place / name).symlink_to(chance.choice((f"../{VICTIM}", "../elsewhere/other.gpkg", "../new", "/dev/zero", name)))


# Sessions


def session_seeds(folder: Path) -> list[Files]:
    text = (
        "furrowmap = 1\nname = 'x'\n[recording]\nlidar = ['a.pcap']\ngnss = ['a.nmea']\n"
        "[crs]\nmap = 'EPSG:6677'\nparameters = 'a.par'\ngeoid_grid = 'a.tif'\n[field]\nboundary = 'a.geojson'\n"
        "[implement]\nwidth_m = 2.0\nxy_m = [0.0, 0.0]\nlearned = 'a.npz'\nstates = ['a.csv']\n"
    )
    return [{"session/session.toml": text.encode(), **{f"session/a.{s}": b"x" for s in ("pcap", "nmea", "npz", "csv")}}]


def use_session(path: Path) -> None:
    """Paths of a session lead out of its folder."""
    root, chance = path.parents[1], chance_of(path)
    outside(root)
    text = path.read_text(errors="replace")
    for _ in range(chance.randint(0, 2)):
        old = chance.choice(("a.pcap", "a.nmea", "a.par", "a.tif", "a.geojson", "a.npz", "a.csv", "EPSG:6677", "x"))
        text = text.replace(f"'{old}'", json.dumps(chance.choice(NAMES)))
    path.write_text(text, errors="replace")
    if chance.random() < 0.3:
        link = path.parent / chance.choice(("a.pcap", "a.nmea", "a.npz"))
        link.unlink(missing_ok=True)
        link.symlink_to(chance.choice((f"../{VICTIM}", "/dev/zero", "../elsewhere")))
    name = chance.choice(("run", "run", "crs", "calibrate", "init"))
    target = ("-o", root / "out") if name == "run" else ("-o", root / "out.toml") if name == "init" else ()
    given = path.parent / "a.nmea" if name == "init" else path
    watched(root, ("out", "out.toml"), lambda: command(name, given, *target))


# Archives and bags


def archive_seeds(folder: Path) -> list[Files]:
    names = ("TASKDATA/TASKDATA.XML", "TASKDATA/TLG00001.XML", "TASKDATA/TLG00001.BIN")
    inside = b'<XFR A="CTR00000" B="1"/><TSK A="TSK1"><TLG A="TLG00001"/></TSK>'
    xml = b'<ISO11783_TaskData VersionMajor="4">%s</ISO11783_TaskData>' % inside
    yaml = b"rosbag2_bagfile_information:\n  relative_file_paths:\n    - a_0.db3\n  message_count: 1\n"
    return [
        {"given/x": b"zip", **{f"given/{name}": xml for name in names}},
        {"given/x": b"bag", "given/bag/metadata.yaml": yaml, "given/bag/a_0.db3": b"SQLite format 3\0"},
    ]


def use_archive(path: Path) -> None:
    """Entries of an archive, or the files that a bag names, lead out of it."""
    root, chance = path.parents[1], chance_of(path)
    outside(root)
    folder = path.parent
    metadata = folder / "bag" / "metadata.yaml"
    if metadata.is_file():
        given = metadata.parent
        metadata.write_bytes(metadata.read_bytes().replace(b"a_0.db3", chance.choice(NAMES).encode()))
        if chance.random() < 0.3:
            (given / "b_0.db3").symlink_to("../../elsewhere/other.gpkg")
    else:
        given = folder / "task.zip"
        with zipfile.ZipFile(given, "w") as archive:
            for file in sorted(folder.rglob("*.*")):
                if file != given:
                    whole = file.relative_to(folder).as_posix()
                    entry = zipfile.ZipInfo(chance.choice((whole, whole, whole, chance.choice(NAMES) or "x")))
                    entry.external_attr = (0o120777 if chance.random() < 0.1 else 0o644) << 16
                    data = file.read_bytes().replace(b"CTR00000", chance.choice(NAMES[:20]).encode())
                    with suppress(ValueError):
                        archive.writestr(entry, data)
        shutil.rmtree(folder / "TASKDATA", ignore_errors=True)
    arguments = chance.choice(
        (
            ("inspect", given),
            ("fields", given, "-o", root / "out.gpkg"),
            ("gnss", "evaluate", given, given, "-o", root / "out"),
        )
    )
    watched(root, ("out.gpkg", "out"), lambda: command(*arguments))


# Orders to the worker


def order_seeds(folder: Path) -> list[Files]:
    return [{"job/line": json.dumps({"type": "start", "arguments": ["inspect", "a.nmea"]}).encode()}]


def use_order(path: Path) -> None:
    """A line that is not an order, or an order with hostile names; the folder `out` alone is named as output."""
    root, chance = path.parents[1], chance_of(path)
    outside(root)
    line = path.read_bytes()
    if chance.random() < 0.7:
        verb = chance.choice(
            ("run", "surface", "cloud", "export", "farm add", "check", "init", "inspect", "fields")
        ).split()
        inputs = [f"job/{name}" for name in chance.choices(NAMES, k=chance.randint(0, 3))]
        order: Any = {"type": "start", "arguments": [*verb, *inputs, "-o", str(root / "out")]}
        if chance.random() < 0.3:
            order["arguments"].append(chance.choice(("--json", "--overwrite", "--to=csv", "--help", "-", "--")))
        if chance.random() < 0.2:
            order[chance.choice(("type", "arguments", "more"))] = chance.choice((None, 5, [], {}, [[]], [None], "run"))
        line = json.dumps(order).encode()
    said = io.BytesIO()

    def work() -> None:
        os.chdir(root)
        arguments = _arguments(line)
        if any(VICTIM in argument or argument.startswith("..") for argument in arguments[-1:]):
            return  # an output that the order itself names
        _, error = attempt(arguments, WorkerConsole(send=lambda kind, **_: said.write(kind.encode())))
        if error is not None:
            raise error

    watched(root, ("out",), work)


PLACES = [
    Entry("places-result", result_seeds, sound(use_result), trials=50),
    Entry("places-session", session_seeds, sound(use_session), trials=50),
    Entry("places-archive", archive_seeds, sound(use_archive), trials=50),
    Entry("places-order", order_seeds, sound(use_order), trials=50),
]
