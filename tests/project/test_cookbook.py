"""The notebooks of docs/cookbook: each runs in an empty folder and shows what its text promises."""

from __future__ import annotations

import ast
import json
from pathlib import Path

import pytest

from made.pages import ROOT
from made.scripts import script

NOTEBOOKS = sorted((ROOT / "docs/cookbook").glob("*.py"))
SHOWN = {
    "batch_inverse_to_headset": ["one sign along the circle: True", "PASS"],
    "check_dh_table": ["largest difference", "row &#x27;elbow&#x27; a: -392.25 → -392.52", "'disagree'"],
    "compare_two_descriptions": ["wrist: 2.000 mm", "limits"],
    "fit_measured_poses": ["q3: ", "0.4 → 0.401", "noise of the measurement 0.05"],
    "sweep_a_tolerance": ["10 µm at each joint", "of the position"],
    "workspace_of_my_urdf": ["dm³"],
}
"""Parts of the output of each notebook."""
PLOTS = {"batch_inverse_to_headset": 1, "sweep_a_tolerance": 1, "workspace_of_my_urdf": 1}


@pytest.fixture(scope="module")
def notebooks():
    return script("docs/notebooks.py")


@pytest.mark.slow
@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_a_notebook_runs_and_shows(file, notebooks, tmp_path):
    cells = notebooks.run(file, tmp_path)
    page, pictures = notebooks.markdown_of(cells, file.stem)
    for part in SHOWN[file.stem]:
        assert part in page, page
    assert len(pictures) == PLOTS.get(file.stem, 0)
    for name, png in pictures.items():
        assert png.startswith(b"\x89PNG")
        assert f'src="{name}"' in page
    json.dumps(notebooks.ipynb_of(cells))


def test_each_notebook_has_its_outputs_here_and_its_links():
    assert set(SHOWN) == {file.stem for file in NOTEBOOKS}
    index = (ROOT / "docs/index.md").read_text(encoding="utf-8")
    settings = (ROOT / "docs/site/zensical.toml").read_text(encoding="utf-8")
    for file in NOTEBOOKS:
        assert f"](cookbook/{file.name})" in index
        assert f'"cookbook/{file.stem}.md"' in settings


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_notebooks_begin_with_a_title_and_write_no_paths_of_this_machine(file, notebooks):
    cells = notebooks.cells_of(file)
    assert cells[0].text.startswith("# ")
    assert not cells[0].is_code
    for cell in cells:
        if cell.is_code:
            ast.parse(cell.text)
        assert "/home" not in cell.text


EXAMPLE = """\
# %% [markdown]
# # Two
#
# A text.

# %%
a = 1
print(a)
a + 1
# %%
raise ValueError("third")
"""


def test_cells_have_outputs_and_an_error_names_its_line(notebooks, tmp_path):
    file = tmp_path / "two.py"
    file.write_text(EXAMPLE[: EXAMPLE.rindex("# %%")], encoding="utf-8")
    text, code = notebooks.run(file, tmp_path)
    assert text.text == "# Two\n\nA text."
    assert (code.printed, code.plain, code.html, code.pictures) == ("1\n", "2", "", [])
    page, _ = notebooks.markdown_of([text, code], "two")
    assert page.count("```text\n1\n```\n\n```text\n2\n```") == 1
    made = notebooks.ipynb_of([text, code])
    assert [cell["cell_type"] for cell in made["cells"]] == ["markdown", "code"]
    assert [output["output_type"] for output in made["cells"][1]["outputs"]] == ["stream", "execute_result"]
    file.write_text(EXAMPLE, encoding="utf-8")
    before = Path.cwd()
    with pytest.raises(ValueError, match="third") as raised:
        notebooks.run(file, tmp_path)
    assert raised.traceback[-1].lineno + 1 == 11
    assert Path.cwd() == before


@pytest.mark.parametrize(
    ("text", "complaint"), [("a = 1\n", "1: a notebook begins"), ("# %% [markdown]\nwords\n", "2: a line of a text")]
)
def test_what_is_no_notebook_is_refused(notebooks, tmp_path, text, complaint):
    (tmp_path / "no.py").write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=complaint):
        notebooks.cells_of(tmp_path / "no.py")
