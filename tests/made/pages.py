"""A page of the documentation as the steps of its reader, and a new user who takes them."""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.error import URLError

from twin.cli import main
from twin.core import assets

ROOT = Path(__file__).parents[2]
TUTORIALS = sorted((ROOT / "docs/tutorials").glob("*.md"))
FIRST = [ROOT / "README.md", *TUTORIALS, ROOT / "docs/your-own-robot.md"]
"""What a newcomer reads first."""
PAGES = [*FIRST, *sorted({ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")} - set(FIRST))]
ACTIVATE = ". .venv/bin/activate"
PATIENCE = 180.0
"""Seconds until a server has loaded its robots, on a busy machine."""

_MENTIONED = re.compile(r"`(twin [a-z]+ [^`]*)`")
_NAMED = re.compile(r"file `([^`]+)`:$")
_ADDRESS = re.compile(r"http://127[.]0[.]0[.]1:[0-9]+")
_LENGTHS = {"pm": 1e-12, "nm": 1e-9, "µm": 1e-6, "mm": 1e-3, "m": 1.0}
_NUMBER = re.compile(r"(?<![\w.])(?P<value>\d+(?: \d{3})*(?:\.\d+)?(?:e[+-]?\d+)?)(?: (?P<unit>[pnµm]?m)\b)?")
_AGREES = re.compile(r"\bAGREE\b|\bAgree\b|\*\*agree\*\*")
_DISAGREES = re.compile(r"\bDISAGREE\b|\bDisagree\.|\*\*disagree\*\*|\bNOT met\b|\bchecks failed\b")
_PRINTS = re.compile(r"^print\(.*\)  # (.*)$", re.MULTILINE)
_BOUND = re.compile(r"(?:less than|within|at most) $")


@dataclass
class Step:
    """What a page tells its reader to do.

    Attributes:
        page: name of the page's file.
        line: line of the page.
        kind: "command", "file" (to be written) or "program" (Python, to be run).
        text: the command, the content of the file, or the program.
        file: name of the file to be written.
        shown: lines that the page prints below the command.
        claims: what tables of all pages say of the command.
        disagrees: whether the pages say that the command ends with a disagreement, and so with exit code 1.
        typed: whether the command stands in a block of its own; otherwise, the text mentions it.
    """

    page: str
    line: int
    kind: str
    text: str
    file: str = ""
    shown: list[str] = field(default_factory=list)
    claims: list[str] = field(default_factory=list)
    disagrees: bool = False
    typed: bool = True

    def __str__(self) -> str:
        what = {"command": self.text, "file": f"write {self.file}", "program": "Python"}[self.kind]
        return f"{self.page}:{self.line} {what}"


def steps_of(page: Path) -> list[Step]:
    """Return the steps of a page from top to bottom, with every command that its text mentions."""
    found: list[Step] = []
    lines = page.read_text(encoding="utf-8").splitlines()
    paragraph: list[str] = []
    begin = 0
    last = ""  # the last line of text
    k = 0
    while k < len(lines):
        line = lines[k]
        if line.startswith("```"):
            end = lines.index("```", k + 1)
            found += _mentioned(page.name, begin, paragraph)
            paragraph = []
            found += _block(page.name, k + 1, line[3:], lines[k + 1 : end], last)
            last = ""
            k = end + 1
            continue
        if line.startswith("|") or not line.strip():  # a row of a table stands alone
            found += _mentioned(page.name, begin, paragraph)
            paragraph = []
        if line.strip():
            if not paragraph:
                begin = k + 1
            paragraph.append(line)
            last = line
        k += 1
    return found + _mentioned(page.name, begin, paragraph)


def _mentioned(page: str, begin: int, paragraph: list[str]) -> list[Step]:
    """Return the commands that a paragraph, or a row of a table, mentions."""
    found = []
    text = "\n".join(paragraph)
    for match in _MENTIONED.finditer(text):
        line = begin + text.count("\n", 0, match.start())
        step = Step(page, line, "command", squeezed(match[1]), typed=False)
        if text.startswith("|"):
            cells = [cell.strip() for cell in text.strip("|").split("|")]
            if match[0] in cells:
                step.claims = [cell for cell in cells if cell and cell != match[0]]
        found.append(step)
    return found


def _block(page: str, line: int, language: str, lines: list[str], before: str) -> list[Step]:
    """Return the steps of a block; `line` is that of its fence, `before` the last line of text above it."""
    content = "\n".join(lines) + "\n"
    named = _NAMED.search(before)
    if named:
        return [Step(page, line, "file", content, named[1])]
    if language == "python" and "twin.load(" in content:
        return [Step(page, line, "program", content)]
    found: list[Step] = []
    if language == "console":
        for k, text in enumerate(lines, line + 1):
            if text.startswith(("$ ", "twin ", ACTIVATE)):  # without a prompt, a block can be copied as it is
                command = text.removeprefix("$ ").partition(" # ")[0].strip()
                found.append(Step(page, k, "command", command))
            elif found and text.strip():
                found[-1].shown.append(text)
    return found


def all_steps(pages: Sequence[Path] = PAGES) -> list[Step]:
    """Return the steps of pages, by default of all.

    A command that the text of a page only mentions is a step if no page above it has it; what the tables of other pages
    say of it are claims of this step. Where a command is shown without its verdict, that of another place holds.
    """
    found: list[Step] = []
    known: dict[str, Step] = {}
    for page in pages:
        for step in steps_of(page):
            first = known.get(step.text)
            if step.kind != "command" or first is None or step.typed:
                found.append(step)
            if step.kind != "command":
                continue
            if first is None:
                known[step.text] = step
            else:
                first.claims += step.claims
    stated = {step.text: verdict(step) for step in found if verdict(step) is not None}
    for step in found:
        said = verdict(step)
        step.disagrees = stated.get(step.text, False) if said is None else said
    return found


def verdict(step: Step) -> bool | None:
    """Return whether the pages say that a command disagrees (True) or agrees (False); None if they say nothing."""
    said = " ".join(step.shown + step.claims)
    agrees, disagrees = _AGREES.search(said), _DISAGREES.search(said)
    assert not (agrees and disagrees), f"{step}: the pages contradict each other: {said}"
    if agrees or disagrees:
        return bool(disagrees)
    return None


def figures(claim: str) -> list[str]:
    """Return the numbers with a decimal point of a claim, with their units of length, without those that are bounds."""
    found = []
    for match in _NUMBER.finditer(claim):
        bound = _BOUND.search(claim[: match.start()])
        if "." in match["value"] and "e" not in match["value"] and not bound:
            found.append(match[0])
    return found


def says(figure: str, output: str) -> bool:
    """Return whether a text has a number that is this figure or rounds to it, perhaps in another unit of length."""
    number, _, unit_name = figure.partition(" ")
    value = float(number)
    step = 10.0 ** -len(number.partition(".")[2])
    unit = _LENGTHS.get(unit_name)
    for match in _NUMBER.finditer(output):
        said = float(match["value"].replace(" ", ""))
        other = _LENGTHS.get(match["unit"] or "")
        if unit is not None and other is not None:
            said *= other / unit
        if abs(said - value) <= 0.500001 * step:
            return True
    return False


def squeezed(text: str) -> str:
    """Return a text with single spaces."""
    return " ".join(text.split())


class NewUser:
    """Who reads a page in a folder that holds nothing of twin's but `.venv`, by `make demo`, and `docs/examples`."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.active = False
        (folder / ".venv").symlink_to(sys.prefix)
        ignored = shutil.ignore_patterns("usd", "__pycache__")
        shutil.copytree(ROOT / "docs/examples", folder / "docs/examples", ignore=ignored)

    def take(self, step: Step) -> None:
        """Do what a step says, and compare what is said with what the pages say."""
        if step.kind == "file":
            path = self.folder / step.file
            assert not path.exists(), f"{step}: the file is there already"
            path.write_text(step.text, encoding="utf-8")
            return
        if step.text == ACTIVATE:
            assert (self.folder / step.text.split()[1]).is_file()
            self.active = True
            return
        if step.kind == "program":
            _, said = self._here(lambda: exec(compile(step.text, str(step), "exec"), {"__name__": "__main__"}))
            for printed in _PRINTS.findall(step.text):
                assert printed in said, f"{step} does not print: {printed}\n{said}"
            return
        if not step.text.startswith("twin "):
            code, said = self._shell(["bash", "-c", step.text])
            assert code == 0, f"{step}\n{said[-3000:]}"
            return
        assert self.active or not step.typed, f"{step}: twin is not found; write `{ACTIVATE}` above it"
        arguments = shlex.split(step.text)[1:]
        if arguments[0] in ("view", "serve") and "--html" not in arguments:
            self._serve(arguments)
            return
        code, said = self._twin(arguments)
        assert code == (1 if step.disagrees else 0), f"{step}: exit code {code}\n{said[-3000:]}"
        missing = [line for line in step.shown if squeezed(line) not in squeezed(said)]
        missing += [f for claim in step.claims for f in figures(claim) if not says(f, said)]
        assert not missing, f"{step} does not say: {missing}\n{said}"

    def _shell(self, line: list[str]) -> tuple[int, str]:
        done = subprocess.run(line, cwd=self.folder, capture_output=True, text=True, check=False)
        return done.returncode, done.stdout + done.stderr

    def _twin(self, arguments: list[str]) -> tuple[int, str]:
        """Run a command in this process: imports and drawings are read once. tests/cli/test_cli.py starts `twin`."""
        try:
            return self._here(lambda: main(arguments))
        except SystemExit as end:  # --help
            return int(end.code or 0), ""

    def _here(self, work: Callable[[], Any]) -> tuple[Any, str]:
        """Return the result of a function that works in the folder, and what it prints."""
        said = io.StringIO()
        before = Path.cwd()
        os.chdir(self.folder)
        try:
            with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
                result = work()
        finally:
            os.chdir(before)
        return result, said.getvalue()

    def _serve(self, arguments: list[str]) -> None:
        """Begin to serve on a free port, wait for the robots, and end it by Ctrl-C."""
        line = [sys.executable, "-m", "twin", *arguments, "--port", "0", "--no-browser"]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
        with subprocess.Popen(line, cwd=self.folder, **pipes) as process:
            try:
                said = ""
                while (address := _ADDRESS.search(said)) is None:
                    more = process.stdout.readline()
                    assert more, said
                    said += more
                with urllib.request.urlopen(address[0], timeout=PATIENCE) as page:
                    assert b"<html" in page.read()
                # a scene is in the page of `twin serve` for both commands
                scene = assets.scene_file(str(self.folder / arguments[1])) or assets.scene_file(arguments[1])
                if arguments[0] == "view" and scene is None:
                    until_drawn(address[0])
                else:
                    until_described(address[0])
                process.send_signal(signal.SIGINT)
                said += process.communicate(timeout=PATIENCE)[0]
            finally:
                process.kill()
        assert process.returncode == 0, said


def until_drawn(address: str) -> None:
    """Connect to `twin view` as a page does, and wait for the first mesh of a robot."""
    import msgspec  # here: the default suite reads the pages, and does not wait for viser
    import viser
    import zstandard
    from websockets.sync.client import connect

    protocol = f"viser-v{viser.__version__}"
    url = address.replace("http", "ws", 1)
    with connect(
        url, subprotocols=[protocol], compression=None, max_size=None, proxy=None, open_timeout=PATIENCE
    ) as socket:
        kinds: set[str] = set()
        while not any("Mesh" in kind or "Glb" in kind for kind in kinds):
            data = socket.recv(timeout=PATIENCE)
            packed = data[16 : 16 + int.from_bytes(data[8:16], "little")]
            messages = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(packed))["messages"]
            kinds = {message["type"] for message in messages}


def until_described(address: str) -> None:
    """Wait until `twin serve` describes its robots."""
    end = time.monotonic() + PATIENCE
    while True:
        try:
            with urllib.request.urlopen(f"{address}/scene.json", timeout=PATIENCE) as answer:
                assert json.load(answer)["robots"]
                return
        except URLError:
            if time.monotonic() > end:
                raise
            time.sleep(0.2)
