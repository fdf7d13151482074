"""`python -m tests.fuzz`: damaged inputs to all readers, or some, as long as one likes; what is found is printed.

An input has a number, so that a finding can be made again: `python -m tests.fuzz --only laz --first 12345 --count 1`.
The files of each finding are kept in build/fuzz.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
import time
from collections import Counter
from dataclasses import asdict
from pathlib import Path

from furrowmap.process import prepare_process

prepare_process()

from tests.fuzz.registry import ENTRIES  # noqa: E402
from tests.fuzz.trials import Entry, Result, files_of, lay, run, seeds_of  # noqa: E402

KEPT = Path("build/fuzz")
IN_MEMORY = Path("/dev/shm")
"""Files of inputs are made here where it is: on a disk, removing folders takes more time than reading."""


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--only", help="names of readers, separated by commas; a part of a name is enough")
    parser.add_argument("--minutes", type=float, help="go on for so long, in rounds over all readers")
    parser.add_argument("--first", type=int, default=0, help="number of the first input")
    parser.add_argument("--count", type=int, help="inputs for each reader and round [default: its own number]")
    parser.add_argument("--part", type=float, default=1.0, help="of the own numbers of inputs")
    parser.add_argument(
        "--share-s", type=float, help="from the second round on, as many as each reader takes in so long"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON line for each reader and round")
    given = parser.parse_args()
    words = given.only.split(",") if given.only else [""]
    entries = [entry for name, entry in ENTRIES.items() if name in words] or [
        entry for name, entry in ENTRIES.items() if any(word in name for word in words)
    ]
    end_s = time.monotonic() + 60.0 * (given.minutes or 0.0)
    total: Counter[str] = Counter()
    with tempfile.TemporaryDirectory(prefix="furrowmap-fuzz-", dir=IN_MEMORY if IN_MEMORY.is_dir() else None) as folder:
        seeds = {}
        first = dict.fromkeys((entry.name for entry in entries), given.first)
        count = {entry.name: given.count or round(given.part * entry.trials) for entry in entries}
        while True:
            for entry in entries:
                place = Path(folder, entry.name)
                if entry.name not in seeds:
                    place.mkdir()
                    seeds[entry.name] = seeds_of(entry, place)
                begun_s = time.monotonic()
                result = run(entry, seeds[entry.name], first[entry.name], count[entry.name], place)
                first[entry.name] += count[entry.name]
                if given.share_s:
                    per_s = count[entry.name] / (time.monotonic() - begun_s)
                    count[entry.name] = max(1, round(given.share_s * per_s))
                total.update(trials=result.trials, refused=result.refused, findings=len(result.findings))
                put(entry, result, as_json=given.json)
                for finding in result.findings:
                    keep(entry, finding.number, files_of(entry, seeds[entry.name], finding.number))
                if given.minutes and time.monotonic() > end_s:
                    break
            if time.monotonic() > end_s:
                break
    if not given.json:
        print(f"{total['trials']:,} inputs, {total['refused']:,} refused, {total['findings']:,} findings")
    sys.exit(1 if total["findings"] and not given.json else 0)


def put(entry: Entry, result: Result, *, as_json: bool) -> None:
    if as_json:
        print(json.dumps({"entry": entry.name, **asdict(result)}), flush=True)
        return
    print(f"{entry.name}: {result.trials:,} inputs, {result.refused:,} refused", flush=True)
    seen: Counter[tuple[str, str]] = Counter()
    for finding in result.findings:
        seen[finding.kind, finding.what] += 1
        if seen[finding.kind, finding.what] == 1:
            print(f"  {finding.kind} of input {finding.number}: {finding.what}", flush=True)
    for (kind, what), times in seen.items():
        if times > 1:
            print(f"  {times} times {kind}: {what}", flush=True)


def keep(entry: Entry, number: int, files: dict[str, bytes]) -> None:
    place = KEPT / f"{entry.name}-{number}"
    shutil.rmtree(place, ignore_errors=True)
    lay(place, files)


if __name__ == "__main__":
    main()
