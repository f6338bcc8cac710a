"""Executes a notebook in the folder where it lies, and compares what its cells print with what they printed when it was saved.

    run_notebook.py NOTEBOOK [--save]

With `--save` the notebook is written with its new outputs instead. Pictures are not compared.
"""
import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient


def is_picture(output):
    return any(kind.startswith("image/") for kind in output.get("data", {}))


def texts(notebook):
    """What each cell of code printed."""
    return [
        [output.get("text") or output["data"].get("text/plain") for output in cell.outputs if not is_picture(output)]
        for cell in notebook.cells
        if cell.cell_type == "code"
    ]


path = Path(sys.argv[1])
saved = nbformat.read(path, as_version=4)
executed = NotebookClient(nbformat.from_dict(saved), timeout=300, kernel_name="python3", resources={"metadata": {"path": path.parent}}).execute()
if "--save" in sys.argv:
    for cell in executed.cells:
        # When it was run says nothing; tables are shown as text.
        cell.metadata = {}
        for output in cell.get("outputs", []):
            output.get("data", {}).pop("text/html", None)
    executed.metadata = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    nbformat.write(executed, path)
    sys.exit()
for number, (before, now) in enumerate(zip(texts(saved), texts(executed), strict=True)):
    if before != now:
        sys.exit(f"cell {number} of code printed\n{''.join(map(str, now))}\nand when it was saved\n{''.join(map(str, before))}\nrun_notebook.py --save writes it anew")
