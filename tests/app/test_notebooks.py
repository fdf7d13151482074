"""The notebooks run from a clean kernel, and are committed without outputs."""

from __future__ import annotations

import re
from pathlib import Path

import nbclient
import nbformat
import pytest

NOTEBOOKS = sorted((Path(__file__).resolve().parents[2] / "app" / "notebooks").glob("*.ipynb"))
FIGURES = {"any-cloud": 1, "christiansen-et-al": 1, "nakagawa-et-al": 4}


def test_notebooks__are_those_that_are_tested() -> None:
    assert [path.stem for path in NOTEBOOKS] == sorted(FIGURES)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=[path.stem for path in NOTEBOOKS])
def test_notebook__runs_from_a_clean_kernel(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    notebook = nbformat.read(path, as_version=4)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(not cell.outputs and cell.execution_count is None for cell in code)
    nbclient.NotebookClient(
        notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    ).execute()
    outputs = [output for cell in code for output in cell.outputs]
    assert [output["text"] for output in outputs if output["output_type"] == "stream"] == []
    assert sum("image/png" in output.get("data", {}) for output in outputs) == FIGURES[path.stem]
    if path.stem == "nakagawa-et-al":
        shown = [output["data"]["text/plain"] for output in outputs if "text/plain" in output.get("data", {})]
        table = next(text for text in shown if "Nakagawa et al." in text)
        ours, theirs = (list(map(float, re.findall(r"0\.\d+", line))) for line in table.splitlines()[1:3])
        assert theirs == [0.0072, 0.0135]
        assert all(0.009 < residual_m < 0.014 for residual_m in ours)
