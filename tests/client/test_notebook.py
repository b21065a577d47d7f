"""The notebook runs as it stands against a service, and is kept without outputs."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import nbformat
import pytest
from jupyter_client.manager import AsyncKernelManager
from nbclient import NotebookClient

from tests.client.services import running

NOTEBOOK = Path(__file__).parents[2] / "docs" / "notebooks" / "find-the-missing-effect.ipynb"
CELL_S = 300


def read() -> nbformat.NotebookNode:
    found: nbformat.NotebookNode = nbformat.read(NOTEBOOK, as_version=4)  # type: ignore[no-untyped-call]
    return found


def test_it_is_kept_without_outputs() -> None:
    cells = [cell for cell in read().cells if cell.cell_type == "code"]
    assert cells
    assert [(cell.outputs, cell.execution_count) for cell in cells] == [([], None)] * len(cells)


def test_it_finds_the_missing_effect(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("JUPYTER_DATA_DIR", "JUPYTER_CONFIG_DIR", "JUPYTER_RUNTIME_DIR", "IPYTHONDIR"):
        monkeypatch.setenv(name, str(tmp_path / name))
    manager = AsyncKernelManager(kernel_name="python3")
    assert manager.kernel_spec is not None
    # Whatever kernel a machine calls python3, this one has what is tested.
    manager.kernel_spec.argv[0] = sys.executable
    with running(tmp_path / "service", workers=1) as url:
        monkeypatch.setenv("FINGERTWIN_URL", url)
        notebook = read()
        client = NotebookClient(
            notebook, km=manager, timeout=CELL_S, resources={"metadata": {"path": os.fspath(tmp_path)}}
        )
        client.execute(cleanup_kc=True)
    outputs = [out for cell in notebook.cells if cell.cell_type == "code" for out in cell.outputs]
    text = "".join(out.text for out in outputs if out.output_type == "stream" and out.name == "stdout")
    assert re.search(r"^Found: .*hanger_mass", text, re.MULTILINE)
    falls = re.findall(r"^(\w+/\w+) +([\d.]+) → ([\d.]+) N$", text, re.MULTILINE)
    assert len(falls) == 4
    assert all(float(after) < 0.2 * float(before) for _, before, after in falls)
    figures = [out.data["application/vnd.plotly.v1+json"] for out in outputs if out.output_type == "display_data"]
    assert len(figures) == 3
    assert all(figure["data"] for figure in figures)
    assert [out.text for out in outputs if out.output_type == "stream" and out.name == "stderr"] == []
