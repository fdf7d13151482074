"""Values are frozen: only what collects while something is read or computed may be changed, and is listed here.

A value that callers can change, as the result of a workflow, would no longer be what was computed or validated.
"""

from __future__ import annotations

import ast
from typing import Final

from tests.syntax import CHECKOUT, PARTS, files, nodes

COLLECTING: Final = {
    "core/adjustment/relaxation.py Relaxation",
    "core/features/cloud_features.py FoundFeatures",
    "core/pointclouds/surfaces.py _Lows",
    "core/readers/isoxml/xml.py Element",
    "core/readers/las/cloud.py Survey",
    "core/readers/packet_counts.py ScannerCounts",
    "core/readers/line_csv.py _LineCounts",
    "core/readers/framed_messages.py MessageCounts",
    "core/readers/nmea/sentences.py SentenceCounts",
    "core/readers/rosbag/bags.py _Topic",
    "core/readers/rtklib/pos.py PosHeader",
    "core/readers/rtklib/pos.py PosRows",
    "core/readers/vectornav/log.py BinaryMessages",
    "core/readers/vectornav/log.py AsciiSentences",
    "core/readers/spinning/hour_clock.py SensorClock",
    "core/readers/spinning/packet_decoder.py PacketCounts",
    "core/readers/spinning/spinning_captures.py SensorTraffic",
    "core/runtime/record_spool.py _Block",
    "app/workflows/clouds/clean.py _LostAttributes",
    "app/workflows/live/feeds.py Followed",
    "app/workflows/live/reader_places.py ReaderPlace",
    "app/workflows/live/reader_places.py Places",
    "app/workflows/record/udp_packets.py Port",
    "app/workflows/record/receivers.py Stream",
    "app/workflows/record/senders.py PacketBlock",
    "app/workflows/record/senders.py Sender",
    "app/workflows/record/series.py Series",
    "app/workflows/record/watch.py Watch",
    "core/readers/arrived_packets.py ArrivedPackets",
    "core/readers/rosbag/topic_content.py TopicContent",
    "core/readers/arrived_positions.py ArrivedPositions",
    "exporters/exchange/partitions.py Partition",
}
READ_ONCE: Final = {
    "cli/worker_process.py _Order",
    "core/readers/geojson.py _Object",
    "exporters/files/result_folder.py _Input",
}
"""Tables of msgspec that a function decodes and drops."""


def frozen(call: ast.expr | ast.ClassDef) -> bool:
    """Whether `frozen=True` is stated."""
    keywords = call.keywords if isinstance(call, ast.Call | ast.ClassDef) else []
    return any(one.arg == "frozen" and ast.unparse(one.value) == "True" for one in keywords)


def test_values__are_frozen() -> None:
    changeable, tables = set(), {}
    for path in files(*PARTS):
        for node in nodes(path):
            if not isinstance(node, ast.ClassDef):
                continue
            name = f"{path.relative_to(CHECKOUT).as_posix()} {node.name}"
            decorators = [one for one in node.decorator_list if ast.unparse(one).startswith("dataclass")]
            if decorators and not all(map(frozen, decorators)):
                changeable.add(name)
            if any(ast.unparse(base) == "msgspec.Struct" for base in node.bases):
                tables[name] = frozen(node)
    assert changeable == COLLECTING
    assert {name for name, is_frozen in tables.items() if not is_frozen} == READ_ONCE
