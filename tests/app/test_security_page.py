"""SECURITY.md's table against what whole commands do: connections, ports, programs, what is unpickled.

Each command runs as a user calls it, in a folder whose files have the names of all modules of Python and of those that
furrowmap imports: none of them may be imported.
"""

from __future__ import annotations

import os
import re
import shutil
import socket
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import fsspec
import geopandas
import pytest
import shapely
from moto.server import ThreadedMotoServer

import furrowmap
from furrowmap.cli.main import COMMANDS
from furrowmap.exporters.reports import printed_pages as pages
from furrowmap.workflows.live.hosts import OUTSIDE
from tests.app.crops.test_growth import CRS, EAST, NORTH, PLOTS, write_flight
from tests.app.crops.test_response import doses, table
from tests.app.killing import KILLS
from tests.app.watched import Seen, strace, watched
from tests.conftest import CHECKOUT
from tests.fuzz.texts import worked

PAGE = CHECKOUT / "SECURITY.md"
FURROWMAP = Path(sys.executable).with_name("furrowmap")
COLUMNS = ("connects to", "listens on", "starts", "unpickles")
NOTHING = "nothing"
ITSELF = "itself"
WORKERS = "its own workers"
OWN = "itself, on the loopback"
KERNELS = "compiled kernels"
ONLY_BY_STRACE = {"the database that it is given", ITSELF, "`uname`"}
"""What native libraries do, and processes that Python forks."""
METADATA_SERVICE = "169.254.169.254"
ROUTE_PROBE = ("2001:4860:4860::8888", 443)
"""Chromium asks the kernel for a route there, over UDP, so that nothing is sent."""
UNPICKLED_BY = {
    "/numba/core/": KERNELS,
    "/multiprocessing/": WORKERS,
    "/concurrent/futures/": WORKERS,
    "/distributed/": WORKERS,
    "/dask/": WORKERS,
    "/cloudpickle/": WORKERS,
}
LOOPBACK = ("127.0.0.1", "::1", "localhost")
MARK = "raise SystemExit(open({mark!r}, 'a').write(__name__ + '\\n'))\n"
RINEX = "     3.04           {kind:<20}M                   RINEX VERSION / TYPE\n{end:<60}END OF HEADER\n"
BROWSER = """#!/bin/sh
for word; do
    case $word in --print-to-pdf=*) echo %PDF-1.4 > "${word#*=}" ;; esac
done
"""


@dataclass(frozen=True)
class Sample:
    """A call of a command, in a folder with the products of the samples before.

    Attributes:
        words: its arguments; {PORT} and others stand for the servers of the test.
        phrases: what the page calls the ports of those servers, and programs, by their name.
        statuses: with which it may end.
        given: standard input.
        variables: of its environment.
        waits: it waits most of its time: the next ones run meanwhile.
    """

    words: str
    phrases: Mapping[str, str] = field(default_factory=dict)
    statuses: tuple[int, ...] = (0,)
    given: str = ""
    variables: Mapping[str, str] = field(default_factory=dict)
    waits: bool = False

    @property
    def command(self) -> str:
        return self.words.partition(" ")[0]


STORE = {"s3": "the stores that it is given"}
ADDRESS_PROBE = "192.0.2.1, without sending anything, for its own address"
LIVE = {"page": "`--port` and `--nmea-port`", "nmea": "`--port` and `--nmea-port`"}
RECORD = {
    "sender": "scanners that it records",
    "scanner": "the UDP ports that it records",
    "receiver": "the receivers of `--gnss`",
}
AWS = {
    "AWS_ENDPOINT_URL": "http://127.0.0.1:{s3}",
    "AWS_DEFAULT_REGION": "us-east-1",
    "AWS_SHARED_CREDENTIALS_FILE": "none",
    "AWS_CONFIG_FILE": "none",
    "AWS_METADATA_SERVICE_TIMEOUT": "1",
    "AWS_METADATA_SERVICE_NUM_ATTEMPTS": "1",
}
KEYS = {"AWS_ACCESS_KEY_ID": "key", "AWS_SECRET_ACCESS_KEY": "secret"}
SAMPLES = (
    Sample("simulate scenario.toml -o drive"),
    Sample("init drive/recording.pcap drive/gnss.nmea -o drive/proposed.toml"),
    Sample("inspect drive/recording.pcap drive/gnss.nmea"),
    Sample("run drive/session.toml -o result"),
    Sample(
        "live --json --from drive/session.toml --speed 0 --port {page} --nmea-port {nmea} --mqtt mqtt://127.0.0.1:{broker}",
        LIVE | {"broker": "the broker of `--mqtt`"},
        waits=True,
    ),
    Sample("record -o recorded --ports {scanner} --gnss tcp://127.0.0.1:{receiver} --duration 3", RECORD, waits=True),
    Sample("batch drive -o results --workers 2", {"uname": "`uname`"}),
    Sample("batch s3://season/in -o s3://season/out --workers 1", STORE, variables=AWS | KEYS),
    Sample(
        "batch s3://season/in -o s3://season/out --workers 1",
        STORE | {"metadata": "169.254.169.254, where S3 has no credentials"},
        (1, 3, 4),
        variables=AWS,
    ),
    Sample(
        "batch drive -o elsewhere --scheduler tcp://127.0.0.1:{scheduler}",
        {"scheduler": "the scheduler that it is given", "uname": "`uname`"},
        (1,),
        waits=True,
    ),
    Sample("season results -o season --workers 2", {"uname": "`uname`"}),
    Sample("surface result/cloud.copc.laz -o surfaces --cell 0.5"),
    Sample("cloud result/cloud.copc.laz -o cleaned.copc.laz"),
    Sample("colour result/cloud.copc.laz drive/session.toml -o coloured.copc.laz", statuses=(3,)),
    Sample("features result/cloud.copc.laz -o features"),
    Sample("parcels first.las plots.gpkg -o crops"),
    Sample("growth first.las second.las plots.gpkg -o growth"),
    Sample("canopy result/cloud.copc.laz -o canopy --cell 1"),
    Sample("tie result results/drive -o tied", statuses=(0, 3, 4)),
    Sample("fields TASKDATA -o fields.gpkg"),
    Sample("plots -o made.gpkg --crs EPSG:6677 --corner 0,0 --azimuth 86 --rows 2 --columns 2 --length 2 --width 1"),
    Sample("response heights.csv --treatments doses.csv -o response"),
    *(
        Sample(f"export result --to {to} -o exported_{to}{'.gpkg' * (to == 'gpkg')}")
        for to in ("gpkg", "geoparquet", "csv", "isoxml", "stac")
    ),
    Sample("report result --pdf", {"browser": "a browser, with `--pdf`"}, variables={"FURROWMAP_BROWSER": "{browser}"}),
    Sample("share result -o shared"),
    Sample("share result --qfield -o qfield", statuses=(0, 1, 4)),
    Sample("farm add result farm.gpkg"),
    Sample("farm fields farm.gpkg"),
    Sample("farm list farm.gpkg"),
    Sample("farm mosaic farm.gpkg -o farm.vrt"),
    Sample("farm traffic farm.gpkg -o traffic.tif"),
    Sample(
        "farm list postgresql://me@127.0.0.1:{database}/farm", {"database": "the database that it is given"}, (1, 3, 4)
    ),
    Sample("calibrate drive/session.toml"),
    Sample("machine save drive/session.toml machine.toml"),
    Sample("crs drive/session.toml"),
    Sample("frames drive/session.toml --svg frames.svg"),
    Sample("gnss evaluate drive/gnss.nmea --reference drive/reference.nmea -o accuracy"),
    Sample("gnss solve rover.obs base.obs base.nav", {"rnx2rtkp": "RTKLIB's `rnx2rtkp`"}, (3,)),
    Sample("check result/cloud.copc.laz points.csv", statuses=(0, 3)),
    Sample("explain clock-offset"),
    Sample("warm-up check surface --threads 2", variables={"XDG_CACHE_HOME": "{cache}", "NUMBA_CACHE_DIR": "{cache}"}),
    Sample("notebooks notebooks"),
    Sample("qgis zip -o plugin.zip"),
    Sample("worker", given='{"type": "start", "arguments": ["crs", "drive/session.toml"]}\n', statuses=(0, 130)),
)


NEEDED = {"simulate", "run", "batch"}
"""Commands that make what the samples of others take."""
LIKE_OTHERS = {"season"}
"""Commands that start what `batch` starts, by the same code."""
TAKEN = [
    sample
    for sample in SAMPLES
    if KILLS or sample.command in NEEDED or (sample.phrases and sample.command not in LIKE_OTHERS)
]
"""By default those that connect, listen or start programs; all of them take minutes, as `make kills` does."""


def rows() -> list[list[str]]:
    """The cells of the page's table."""
    lines = re.findall(r"^\| (`.*) \|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    return [line.split(" | ") for line in lines]


def stated(cells: Sequence[str]) -> dict[str, set[str]]:
    """The phrases of a row by their column."""
    return {name: set(cell.split("; ")) - {NOTHING} for name, cell in zip(COLUMNS, cells[1:], strict=True)}


def hostile_modules(folder: Path, mark: Path) -> None:
    """A file for each module that somebody may import, which leaves its name in `mark`."""
    installed = {path.stem for path in Path(shapely.__file__).parents[1].iterdir() if path.stem.isidentifier()}
    for name in {*sys.stdlib_module_names, *installed, "furrowmap"}:
        (folder / f"{name}.py").write_text(MARK.format(mark=str(mark)))


def material(folder: Path) -> None:
    """What the samples read."""
    shutil.copy(Path(__file__).with_name("one_pass.toml"), folder / "scenario.toml")
    for number, name in enumerate(("first.las", "second.las")):
        write_flight(folder / name, number)
    shapes = [shapely.affinity.translate(shape, EAST, NORTH) for shape in PLOTS.values()]
    plots = geopandas.GeoDataFrame({"id": list(PLOTS)}, geometry=shapes, crs=CRS)
    plots.to_file(folder / "plots.gpkg", engine="pyogrio")
    worked(folder)
    table(folder / "heights.csv", 1)
    doses(folder / "doses.csv")
    (folder / "points.csv").write_text("name,e_m,n_m,h_m\na,16654.0,96556.0,30.0\n")
    for name, kind in (("rover.obs", "O"), ("base.obs", "O"), ("base.nav", "N")):
        (folder / name).write_text(RINEX.format(kind=kind, end=""))


@dataclass
class Servers:
    """Those that the samples connect to, in this process."""

    ports: dict[str, int] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)

    def listen(self, name: str, stack: ExitStack, kind: socket.SocketKind = socket.SOCK_STREAM) -> socket.socket:
        """A socket at a free port of the loopback."""
        opened = stack.enter_context(socket.socket(socket.AF_INET, kind))
        opened.bind(("127.0.0.1", 0))
        self.ports[name] = opened.getsockname()[1]
        return opened

    def free(self, name: str, kind: socket.SocketKind = socket.SOCK_STREAM) -> None:
        """A port at which nobody listens."""
        with ExitStack() as stack:
            self.listen(name, stack, kind)


def close_at_once(listener: socket.socket) -> None:
    """Accept connections, and close them after a moment."""
    listener.listen()
    with suppress(OSError):
        while True:
            connection, _ = listener.accept()
            threading.Timer(0.5, connection.close).start()


def send_packets(sender: socket.socket, port: int) -> None:
    """Packets of a Velodyne, until the socket is closed."""
    packet = b"\xff\xee" + bytes(1198) + b"\0\0\0\0\x37\x22"
    while sender.fileno() >= 0:
        with suppress(OSError):
            sender.sendto(packet, ("127.0.0.1", port))
        time.sleep(0.2)


@pytest.fixture(scope="module")
def servers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Servers]:
    made = Servers()
    folder = tmp_path_factory.mktemp("programs")
    for name in ("page", "nmea", "scheduler"):
        made.free(name)
    made.free("scanner", socket.SOCK_DGRAM)
    for name, text in (("rnx2rtkp", "#!/bin/sh\nexit 1\n"), ("browser", BROWSER)):
        (folder / name).write_text(text)
        (folder / name).chmod(0o755)
    made.texts |= {"browser": str(folder / "browser"), "programs": str(folder), "cache": str(folder / "cache")}
    with ExitStack() as stack:
        for name in ("broker", "receiver", "database"):
            listener = made.listen(name, stack)
            threading.Thread(target=close_at_once, args=(listener,), daemon=True).start()
        sender = made.listen("sender", stack, socket.SOCK_DGRAM)
        threading.Thread(target=send_packets, args=(sender, made.ports["scanner"]), daemon=True).start()
        store = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
        store.start()
        stack.callback(store.stop)
        made.ports["s3"] = store.get_host_and_port()[1]
        made.ports["metadata"] = 80
        yield made


@pytest.fixture(scope="module")
def seen(servers: Servers, tmp_path_factory: pytest.TempPathFactory) -> list[tuple[Sample, Seen]]:
    """What was seen of each sample; what is imported is noted of all that run at that time."""
    folder = tmp_path_factory.mktemp("work")
    scratch = tmp_path_factory.mktemp("watched")
    material(folder)
    mark = scratch / "imported"
    hostile_modules(folder, mark)
    texts = {name: str(port) for name, port in servers.ports.items()} | servers.texts
    search = os.pathsep.join((servers.texts["programs"], os.environ["PATH"]))
    mark.write_text("")

    def see(sample: Sample, number: int) -> Seen:
        variables = {name: value.format(**texts) for name, value in sample.variables.items()}
        words = [str(FURROWMAP), *(word.format(**texts) for word in sample.words.split())]
        if "s3://" in sample.words and "AWS_ACCESS_KEY_ID" in variables:
            fill_bucket(folder / "drive", variables)
        before = len(mark.read_text())
        own = scratch / str(number)
        one = watched(words, folder, own, sample.given, {"PATH": search, **variables})
        return replace(one, imported=mark.read_text()[before:])

    with ThreadPoolExecutor() as pool:
        found: list[tuple[Sample, Seen | Future[Seen]]] = []
        for number, sample in enumerate(TAKEN):
            found.append((sample, pool.submit(see, sample, number) if sample.waits else see(sample, number)))
        return [(sample, one if isinstance(one, Seen) else one.result()) for sample, one in found]


def fill_bucket(drive: Path, variables: Mapping[str, str]) -> None:
    """Put a session into the store."""
    system = fsspec.filesystem(
        "s3",
        key=variables["AWS_ACCESS_KEY_ID"],
        secret=variables["AWS_SECRET_ACCESS_KEY"],
        endpoint_url=variables["AWS_ENDPOINT_URL"],
        skip_instance_cache=True,
    )
    if system.exists("season"):  # of another test in the same process
        system.rm("season", recursive=True)
    system.mkdir("season")
    for name in ("session.toml", "recording.pcap", "gnss.nmea", "boundary.geojson"):
        system.put_file(str(drive / name), f"season/in/north/{name}")


def connections(sample: Sample, seen: Seen, ports: Mapping[str, int]) -> set[str]:
    """What the page calls the places that a sample connected to; others as they are."""
    named = {ports[name]: phrase for name, phrase in sample.phrases.items() if name in ports}
    found = set()
    for host, port in seen.connected:
        if host == OUTSIDE:
            found.add(ADDRESS_PROBE)
        elif port in named and (host in LOOPBACK or host == METADATA_SERVICE):
            found.add(named[port])
        elif host in LOOPBACK:
            found |= {OWN} if port else set()
        elif (host, port) not in ((METADATA_SERVICE, 0), ("", 0), (socket.gethostname(), 0)):
            found.add(f"{host}:{port}")
    return found


def listeners(sample: Sample, seen: Seen, ports: Mapping[str, int]) -> set[str]:
    """What the page calls the ports that a sample opened."""
    named = {ports[name]: phrase for name, phrase in sample.phrases.items() if name in ports}
    probe = ("::1", 0)  # urllib3 looks whether there is IPv6; it listens at nothing
    return {
        named.get(port, OWN if (host, port) == ("127.0.0.1", 0) else f"{host}:{port}")
        for host, port in seen.bound - {probe}
    }


def started(sample: Sample, seen: Seen) -> set[str]:
    """What the page calls the programs that a sample started."""
    own = {Path(sys.executable).resolve()}
    others = {path for path in seen.programs if Path(path) != FURROWMAP}
    return {
        ITSELF if Path(path).resolve() in own else sample.phrases.get(Path(path).name, Path(path).name)
        for path in others
    }


def unpickled(seen: Seen) -> set[str]:
    """What the page calls that which a sample unpickled."""
    return {
        next((phrase for folder, phrase in UNPICKLED_BY.items() if folder in Path(file).as_posix()), file)
        for file in seen.unpickled
    }


def done(samples: Sequence[tuple[Sample, Seen]], ports: Mapping[str, int], *commands: str) -> dict[str, set[str]]:
    """What was seen of commands, in the words of the page, by its columns."""
    found: dict[str, set[str]] = {column: set() for column in COLUMNS}
    for sample, seen in samples:
        if sample.command in commands:
            found["connects to"] |= connections(sample, seen, ports)
            found["listens on"] |= listeners(sample, seen, ports)
            found["starts"] |= started(sample, seen)
            found["unpickles"] |= unpickled(seen)
    return found


def test_page__lists_each_command_once_and_each_has_a_sample() -> None:
    listed = re.findall(r"`([\w-]+)`", " ".join(row[0] for row in rows()))
    assert sorted(listed) == sorted(COMMANDS)
    assert {sample.command for sample in SAMPLES} == set(COMMANDS)


def test_promise_23__nothing_is_imported_from_the_current_folder(seen: list[tuple[Sample, Seen]]) -> None:
    assert {sample.words: one.imported for sample, one in seen if one.imported} == {}


def test_samples__end_as_they_should(seen: list[tuple[Sample, Seen]]) -> None:
    """Otherwise they show less than commands do."""
    assert {sample.words: one.said for sample, one in seen if one.status not in sample.statuses} == {}


def test_promise_23__commands_do_no_more_than_the_page_says(seen: list[tuple[Sample, Seen]], servers: Servers) -> None:
    unstated = {}
    for cells in rows():
        for command in re.findall(r"`([\w-]+)`", cells[0]):
            for column, found in done(seen, servers.ports, command).items():
                unstated[command, column] = found - stated(cells)[column]
    assert {place: found for place, found in unstated.items() if found} == {}


def test_page__says_no_more_than_commands_do(seen: list[tuple[Sample, Seen]], servers: Servers) -> None:
    unseen = {}
    for cells in rows():
        commands = re.findall(r"`([\w-]+)`", cells[0])
        if {sample.command for sample in SAMPLES if sample not in TAKEN}.intersection(commands) - LIKE_OTHERS:
            continue
        found = done(seen, servers.ports, *commands)
        for column, phrases in stated(cells).items():
            unseen[cells[0], column] = phrases - found[column] - (set() if strace() else ONLY_BY_STRACE)
    assert {place: phrases for place, phrases in unseen.items() if phrases} == {}


def test_browser__asks_nobody_when_it_prints_a_report(
    result: furrowmap.Result, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Chromium asks its maker for updates and experiments, unless it is told otherwise."""
    if pages.browser() is None or strace() is None:
        pytest.skip("no Chromium, Chrome or Edge, or no strace")
    folder = shutil.copytree(result.path, tmp_path / "result")
    scratch = tmp_path_factory.mktemp("w")  # a short name: the path of a socket has 107 bytes at most
    seen = watched([FURROWMAP, "report", folder, "--pdf"], tmp_path, scratch)
    assert (folder / "report.pdf").exists(), seen.said
    assert (folder / "report.pdf").read_bytes().startswith(b"%PDF")
    assert seen.connected <= {ROUTE_PROBE}


def test_promise_23__nothing_is_made_where_others_can_reach_it(seen: list[tuple[Sample, Seen]]) -> None:
    """In the folder of temporary files that all users share."""
    assert {sample.words: one.shared for sample, one in seen if one.shared} == {}
    assert {sample.words: one.extensions for sample, one in seen if one.extensions} == {}
