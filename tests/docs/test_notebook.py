"""The notebook of the three jobs runs from top to bottom, and its results draw themselves."""

from __future__ import annotations

import nbformat
import pytest
from nbclient import NotebookClient
from pages import DOCS, ROOT


@pytest.mark.filterwarnings("ignore")  # of the kernel's own libraries
@pytest.mark.slow
def test_the_notebook_runs(tmp_path_factory: pytest.TempPathFactory) -> None:
    notebook = nbformat.read(DOCS / "notebook.ipynb", as_version=4)
    NotebookClient(notebook, timeout=240, resources={"metadata": {"path": str(ROOT)}}).execute()
    shown = [
        output["data"]["text/html"]
        for cell in notebook.cells
        for output in cell.get("outputs", ())
        if "text/html" in output.get("data", {})
    ]
    assert "<svg" in shown[0]
    assert "ResimulationResult cut_in_brake" in shown[0]
    assert any("Verification small" in html for html in shown)
    assert not any("<script" in html for html in shown)
