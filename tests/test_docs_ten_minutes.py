"""docs/ten-minutes.md from top to bottom: its files are written, its commands run, what it shows is what is said."""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs/ten-minutes.md").read_text(encoding="utf-8")
EXAMPLE = ROOT / "docs/examples/hexapod"
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def steps():
    """Yield what the page does, in order: ("file", path, text) and ("command", line, shown lines)."""
    for block in BLOCK.finditer(PAGE):
        kind, text = block.groups()
        before = PAGE[: block.start()].rstrip().splitlines()[-1]
        named = re.search(r"file `([^`]+)`:$", before)
        if named:
            yield "file", named[1], text
        elif kind == "console":
            for part in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]:
                command, *shown = part.splitlines()
                yield "command", command, [line for line in shown if line.strip()]


def squeezed(text):
    return " ".join(text.split())


def serve(arguments, folder):
    """Begin to serve, fetch the page, end it."""
    arguments = [*arguments, "--port", "0", "--no-browser"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    with subprocess.Popen(arguments, cwd=folder, **pipes) as process:
        said = ""
        while (url := re.search(r"http://127[.]0[.]0[.]1:[0-9]+", said)) is None:
            line = process.stdout.readline()
            assert line, said
            said += line
        with urllib.request.urlopen(url[0], timeout=60) as page:
            assert b"<html" in page.read()
        time.sleep(4)  # it must have loaded the robot by then
        process.send_signal(signal.SIGINT)
        said += process.communicate(timeout=60)[0]
    assert process.returncode == 0, said


@pytest.mark.slow
def test_the_page_from_top_to_bottom(tmp_path):
    shutil.copytree(EXAMPLE, tmp_path / "docs/examples/hexapod", ignore=shutil.ignore_patterns("usd", "__pycache__"))
    done = []
    for kind, what, content in steps():
        if kind == "file":
            assert not (tmp_path / what).exists(), "the page has removed the file of the example, which has no mistake"
            (tmp_path / what).write_text(content, encoding="utf-8")
            continue
        done.append(what)
        if what.startswith(("twin view", "twin serve")):
            serve([sys.executable, "-m", *what.split()], tmp_path)
            continue
        line = f"{sys.executable} -m {what}" if what.startswith("twin ") else what
        ran = subprocess.run(line, shell=True, cwd=tmp_path, capture_output=True, text=True, check=False)
        expected = 1 if any("DISAGREE" in x for x in content) else 0
        assert ran.returncode == expected, f"{what}\n{ran.stdout[-2000:]}{ran.stderr[-2000:]}"
        for shown in content:
            assert squeezed(shown) in squeezed(ran.stdout), f"{what} does not say: {shown}\n{ran.stdout}"
    assert len(done) > 8
    assert (tmp_path / "my_hexapod/formula.py").read_text() == (EXAMPLE / "formula.py").read_text()
    assert (tmp_path / "twin-out/hexapod/export/proof.json").is_file()


def test_the_page_differs_from_the_example_by_its_mistake_alone():
    written = {what: text for kind, what, text in steps() if kind == "file"}
    text = written["my_hexapod/formula.py"]
    assert text.replace("R.T @ b", "R @ b") == (EXAMPLE / "formula.py").read_text()
    body = text[text.index("def on_circle") :].splitlines()
    assert len([line for line in body if line]) <= 15


def test_excerpts_are_those_of_the_files():
    files = (EXAMPLE / "cad/hexapod.toml").read_text() + (EXAMPLE / "trajectories/tour.toml").read_text()
    known = {squeezed(line) for line in files.splitlines()}
    blocks = [text for kind, text in (m.groups() for m in BLOCK.finditer(PAGE)) if kind == "toml"]
    assert len(blocks) == 3
    for line in "\n".join(blocks).splitlines():
        assert squeezed(line) in known
