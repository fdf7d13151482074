"""A worker whose every end is told in advance: it speaks the protocol of `furrowmap worker`, and computes nothing.

Its only argument is `worker`. The file `ways.json` beside it says for each command how it ends: "wait" (until it is
cancelled), "deaf" (it waits and does not hear that it is cancelled), "killed", "mute" (it exits without an answer),
"failed", "read-only", or "done", with the answer under "answers".
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent


def say(kind: str, **content: Any) -> None:
    sys.stdout.write(json.dumps({"type": kind, **content}) + "\n")
    sys.stdout.flush()


def ended(status: int, code: str = "", **content: Any) -> None:
    if code:
        say("error", code=code, what=f"It ended: {code}.", meaning="So it was told.", remedy="Try again.", **content)
    say("done", status=status)
    sys.exit(status)


def main() -> None:
    say("hello", protocol=1, version="0", pid=os.getpid())
    words = json.loads(sys.stdin.readline())["arguments"]
    ways = json.loads((HERE / "ways.json").read_text(encoding="utf-8"))
    way = ways.get(words[0], "failed")
    with (HERE / "asked.jsonl").open("a", encoding="utf-8") as asked:
        asked.write(json.dumps(words) + "\n")
    say("progress", stage="reading scans", share=0.0)
    (HERE / "begun").touch()
    if way == "deaf":
        time.sleep(60.0)
    if way == "wait":
        sys.stdin.readline()
        ended(130, "cancelled")
    if way == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if way == "mute":
        sys.exit(0)
    if way == "read-only":
        ended(3, "output-unwritable")
    if way == "failed":
        ended(3, "session-value")
    answer = ways.get("answers", {}).get(words[0], {})
    for made, source in ways.get("makes", {}).get(words[0], {}).items():
        if Path(source).is_dir():
            shutil.copytree(source, made, dirs_exist_ok=True)
        else:
            shutil.copyfile(source, made)
    say("result", value=answer)
    ended(0)


main()
