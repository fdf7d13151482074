"""Random sessions: python -m tests.fuzz_sessions --sessions 10000 --seed 1.

Each finding is printed with its seed and number, which make it again (`--number`), and its folder is kept.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
import time
from itertools import chain
from pathlib import Path

from furrowmap.process import prepare_process

prepare_process()

from tests.fuzz_sessions.material import toml_of  # noqa: E402
from tests.fuzz_sessions.trials import Tally, load, run, shrunk, stock_of  # noqa: E402


def main() -> int:
    """Try sessions; 1 if there are findings."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz_sessions", description=__doc__)
    parser.add_argument("--sessions", type=int, default=1000)
    parser.add_argument("--seed", default=time.strftime("%Y-%m-%dT%H:%M:%S"))
    parser.add_argument("--first", type=int, default=0, help="number of the first session")
    parser.add_argument("--number", type=int, nargs="+", default=[], help="these sessions alone")
    parser.add_argument("--shrink", action="store_true", help="drop what a finding does not need")
    parser.add_argument("--folder", type=Path, help="for the sessions; a file system in memory is faster")
    parser.add_argument("--every", type=int, default=1000, help="sessions between two lines about the progress")
    asked = parser.parse_args()
    whole = range(asked.first, asked.first + asked.sessions)
    numbers = [range(number, number + 1) for number in asked.number] or [whole]
    folder = Path(tempfile.mkdtemp(prefix="furrowmap-sessions-", dir=asked.folder))
    stock = stock_of(folder)
    load()
    total = Tally()
    begun_s = time.monotonic()
    print(f"seed {asked.seed}, {folder}", flush=True)
    for tally in chain.from_iterable(run(stock, asked.seed, some, folder) for some in numbers):
        before = total.sessions
        total.add(tally)
        for finding in tally.findings:
            print(f"{finding.kind}: --seed {finding.seed} --number {finding.number}\n  {' '.join(finding.line)!r}")
            print("  " + finding.what.strip().replace("\n", "\n  "), flush=True)
            if asked.shrink:
                for text in shrunk(stock, finding, folder):
                    print(f"  needs: {toml_of(text.data)!r} {text.edits}")
        if total.sessions // asked.every > before // asked.every:
            rate = total.sessions / (time.monotonic() - begun_s)
            most = f"{total.longest_s[0]:.1f} s, {total.most_bytes[0] >> 20} MB at most"
            print(f"{total.sessions} sessions, {rate:.1f} a second, {len(total.findings)} findings, {most}", flush=True)
    for end, count in sorted(total.ends.items(), key=lambda each: -each[1]):
        print(f"{count:8} {end}")
    print(f"{total.sessions} sessions, {total.commands} commands, {len(total.findings)} findings")
    print(f"longest: {total.longest_s[0]:.1f} s (number {total.longest_s[1]}), ", end="")
    print(f"most memory: {total.most_bytes[0] >> 20} MB (number {total.most_bytes[1]})")
    if not total.findings:
        shutil.rmtree(folder)
    return 1 if total.findings else 0


if __name__ == "__main__":
    sys.exit(main())
