"""A worker that crashes or hangs leaves QGIS alive, with an error that names the step and the file."""

from __future__ import annotations

import json

from tests.conftest import CHECKOUT, QgisRoot


def test_promise_16__a_worker_that_crashes_or_hangs_is_an_error_with_step_and_file(qgis: QgisRoot) -> None:
    script = CHECKOUT / "tests" / "plugin" / "crashing_workers.py"
    answers = json.loads(qgis.run("python3", script, CHECKOUT).splitlines()[-1])
    assert answers["crash"][0].endswith("at: Reading field.laz).")
    assert answers["crash"][1] == "Fatal Python error: Segmentation fault"
    assert answers["hang"][0] == "The worker sent nothing for 0 minutes (at: Reading field.laz)."
    assert all(all(lines) and len(lines) == 3 for lines in answers.values())
