"""Executes a notebook in the folder where it lies, and compares what its cells print with what they printed when it was saved.

    run_notebook.py NOTEBOOK [--save]

With `--save` the notebook is written with its new outputs instead. Pictures and standard error are not compared: on a slow machine Matplotlib reports there that it
builds its font cache.
"""
import sys
from pathlib import Path

#: A cell may wait for a run on a loaded machine.
CELL_TIMEOUT_S = 900
KERNEL_TIMEOUT_S = 300


def is_picture(output):
    return any(kind.startswith("image/") for kind in output.get("data", {}))


def is_standard_error(output):
    return output["output_type"] == "stream" and output["name"] == "stderr"


def cell_texts(cell):
    """The texts that a cell printed, one per result, and one for all consecutive chunks of its standard output: where a stream is cut depends on time alone."""
    texts, is_stream = [], False
    for output in cell["outputs"]:
        if is_picture(output) or is_standard_error(output):
            continue
        if output["output_type"] == "stream":
            if is_stream:
                texts[-1] += output["text"]
            else:
                texts.append(output["text"])
            is_stream = True
        else:
            texts.append(output.get("data", {}).get("text/plain"))
            is_stream = False
    return texts


def texts(notebook):
    """What each cell of code printed."""
    return [cell_texts(cell) for cell in notebook["cells"] if cell["cell_type"] == "code"]


def main(path, save):
    import nbformat
    from nbclient import NotebookClient

    saved = nbformat.read(path, as_version=4)
    client = NotebookClient(
        nbformat.from_dict(saved), timeout=CELL_TIMEOUT_S, startup_timeout=KERNEL_TIMEOUT_S, kernel_name="python3", resources={"metadata": {"path": path.parent}}
    )
    executed = client.execute()
    if save:
        for cell in executed.cells:
            # When it was run says nothing; tables are shown as text.
            cell.metadata = {}
            for output in cell.get("outputs", []):
                output.get("data", {}).pop("text/html", None)
        executed.metadata = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
        nbformat.write(executed, path)
        return
    for number, (before, now) in enumerate(zip(texts(saved), texts(executed), strict=True)):
        if before != now:
            sys.exit(f"cell {number} of code printed\n{''.join(map(str, now))}\nand when it was saved\n{''.join(map(str, before))}\nrun_notebook.py --save updates the notebook")


if __name__ == "__main__":
    main(Path(sys.argv[1]), "--save" in sys.argv)
