"""Notebooks of docs/cookbook: run them, and write them as pages and as .ipynb with their outputs.

    python docs/notebooks.py docs/cookbook/check_dh_table.py      runs it in an empty folder and prints its page

A notebook is a Python file whose cells begin with `# %%`, or with `# %% [markdown]` where they are text. Editors open
it as a notebook, a difference of two versions can be read, and it runs without packages of Jupyter.
"""

from __future__ import annotations

import ast
import base64
import contextlib
import io
import os
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

TEXT = "# %% [markdown]"
CODE = "# %%"


@dataclass
class Cell:
    """A cell, and what it gave when it ran.

    Attributes:
        text: Markdown of a text, or Python.
        is_code: whether it runs.
        line: line of the file on which `text` begins.
        printed: what it printed.
        html, plain: its last expression as HTML and as text; empty without one, or where it is None.
        pictures: its plots, as PNG.
    """

    text: str
    is_code: bool
    line: int
    printed: str = ""
    html: str = ""
    plain: str = ""
    pictures: list[bytes] = field(default_factory=list)


def cells_of(file: Path) -> list[Cell]:
    """Return the cells of a notebook.

    Raises:
        ValueError: a line above the first cell, or a line of a text that is no comment.
    """
    cells: list[Cell] = []
    lines: list[str] = []
    for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1):
        if line in (TEXT, CODE):
            _close(cells, lines)
            cells.append(Cell("", line == CODE, number + 1))
            lines = []
            continue
        if not cells:
            raise ValueError(f"{file}:{number}: a notebook begins with '{TEXT}'")
        if not cells[-1].is_code and line.strip() and not line.startswith("#"):
            raise ValueError(f"{file}:{number}: a line of a text begins with '#'")
        lines.append(line)
    _close(cells, lines)
    return cells


def _close(cells: list[Cell], lines: list[str]) -> None:
    """Give the last cell its lines."""
    if not cells:
        return
    if not cells[-1].is_code:
        lines = [line.removeprefix("#").removeprefix(" ") for line in lines]
    cells[-1].text = "\n".join(lines).strip("\n")


def run(file: Path, folder: Path) -> list[Cell]:
    """Run the cells of a notebook in a folder, and return them with their outputs.

    Raises:
        Exception: what a cell raises.
    """
    import matplotlib

    matplotlib.use("Agg")
    names: dict[str, Any] = {"__name__": "__main__"}
    cells = cells_of(file)
    before = Path.cwd()
    os.chdir(folder)
    try:
        for cell in cells:
            if cell.is_code:
                _run_cell(cell, file, names)
    finally:
        os.chdir(before)
    return cells


def _run_cell(cell: Cell, file: Path, names: dict[str, Any]) -> None:
    from matplotlib import pyplot

    tree = ast.parse(cell.text, str(file))
    ast.increment_lineno(tree, cell.line - 1)
    last = None
    if tree.body and isinstance(tree.body[-1], ast.Expr):
        last = ast.Expression(tree.body.pop().value)
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        exec(compile(tree, str(file), "exec"), names)
        value = eval(compile(last, str(file), "eval"), names) if last is not None else None
    cell.printed = said.getvalue()
    for number in pyplot.get_fignums():
        png = io.BytesIO()
        pyplot.figure(number).savefig(png, format="png", dpi=110, metadata={"Software": None})
        cell.pictures.append(png.getvalue())
    pyplot.close("all")
    if value is None or cell.pictures:  # the last expression of a plot is a part of it
        return
    cell.plain = repr(value)
    if hasattr(value, "_repr_html_"):
        cell.html = value._repr_html_()


def markdown_of(cells: list[Cell], name: str) -> tuple[str, dict[str, bytes]]:
    """Return the page of a notebook, and {file name: PNG} of its pictures."""
    parts = []
    pictures: dict[str, bytes] = {}
    for cell in cells:
        if not cell.is_code:
            parts.append(cell.text)
            continue
        parts.append(f"```python\n{cell.text}\n```")
        if cell.printed:
            parts.append(f"```text\n{cell.printed.rstrip()}\n```")
        for png in cell.pictures:
            file = f"{name}_{len(pictures) + 1}.png"
            pictures[file] = png
            parts.append(f'<img src="{file}" alt="Plot of this cell">')
        if cell.html:
            parts.append(cell.html)
        elif cell.plain:
            parts.append(f"```text\n{cell.plain}\n```")
    return "\n\n".join(parts) + "\n", pictures


def ipynb_of(cells: list[Cell]) -> dict[str, Any]:
    """Return a notebook with its outputs in the format of Jupyter (nbformat 4.5)."""
    found = []
    count = 0
    for k, cell in enumerate(cells):
        known: dict[str, Any] = {"id": f"cell{k}", "metadata": {}, "source": cell.text}
        if not cell.is_code:
            found.append({"cell_type": "markdown", **known})
            continue
        count += 1
        outputs: list[dict[str, Any]] = []
        if cell.printed:
            outputs.append({"output_type": "stream", "name": "stdout", "text": cell.printed})
        for png in cell.pictures:
            data = {"image/png": base64.b64encode(png).decode()}
            outputs.append({"output_type": "display_data", "data": data, "metadata": {}})
        if cell.plain:
            data = {"text/plain": cell.plain} | ({"text/html": cell.html} if cell.html else {})
            outputs.append({"output_type": "execute_result", "execution_count": count, "data": data, "metadata": {}})
        found.append({"cell_type": "code", **known, "execution_count": count, "outputs": outputs})
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    return {"nbformat": 4, "nbformat_minor": 5, "metadata": {"kernelspec": kernel}, "cells": found}


if __name__ == "__main__":
    notebook = Path(sys.argv[1])
    with tempfile.TemporaryDirectory() as empty:
        print(markdown_of(run(notebook, Path(empty)), notebook.stem)[0])
