"""The notebooks of the handbook: text in ``docs/notebooks/*.py``, run into ``*.ipynb`` beside it.

    python docs/notebooks.py [NAME ...]       # all of them: some minutes

The text is what is edited (jupytext's percent format); the handbook shows the .ipynb as it is
committed, so that it is built without running any. Needs dart-hal[dev].
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

import jupytext
import nbformat
from nbclient import NotebookClient

FOLDER = Path(__file__).parent / "notebooks"
PATIENCE = 1800
"""s for one cell, on a machine that does much else."""
KERNEL = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
          "language_info": {"name": "python", "file_extension": ".py", "mimetype": "text/x-python",
                            "pygments_lexer": "ipython3"}}  # which knows cells of the shell


def read(source: Path) -> nbformat.NotebookNode:
    """The notebook of a text, not run; its cells are numbered, so that the same text is the same
    file."""
    notebook = jupytext.read(source)
    notebook.metadata = nbformat.from_dict(KERNEL)
    for n, cell in enumerate(notebook.cells):
        cell.id = f"cell-{n}"
    return notebook


def executed(source: Path, folder: Path) -> nbformat.NotebookNode:
    """The notebook, run from its first cell to its last in ``folder`` with this interpreter.

    Raises nbclient.exceptions.CellExecutionError where a cell fails.
    """
    bins = Path(sys.executable).parent
    env = {k: v for k, v in os.environ.items() if not k.startswith("DART_")}
    env |= {"PATH": f"{bins}{os.pathsep}{env['PATH']}", "XDG_DATA_HOME": str(folder)}
    notebook = read(source)
    client = NotebookClient(notebook, timeout=PATIENCE, kernel_name="python3",
                            record_timing=False, coalesce_streams=True,
                            resources={"metadata": {"path": str(folder)}})
    client.execute(env=env)
    notebook.metadata = nbformat.from_dict(KERNEL)
    return notebook


def quiet(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """Without what went to standard error: how busy this machine was."""
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs = [out for out in cell.outputs if out.get("name") != "stderr"]
    return notebook


def main(*names: str) -> None:
    """Run the named ones, or all."""
    for source in sorted(FOLDER.glob("*.py")):
        if not names or source.stem in names:
            with tempfile.TemporaryDirectory() as folder:
                work = Path(folder) / source.stem  # messages have its name
                work.mkdir()
                nbformat.write(quiet(executed(source, work)), source.with_suffix(".ipynb"))


if __name__ == "__main__":
    main(*sys.argv[1:])
