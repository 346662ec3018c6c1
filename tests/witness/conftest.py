"""Fixtures of the witness tests, and the table of what they found.

    foreign      runs programs that are not ours; a test that needs one which is not built (say so: the mark
                 witness("bpy")) skips loudly, or fails where TWIN_WITNESS_REQUIRED is set
    case         one robot after the other: its exports, and what they must show; see bundles.py
    judge        compares what a reader printed with that, and keeps it for the table
    figures      keeps the worst error of a witness for the table

The table is printed when the tests are done and written to twin-out/witness.md.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from twin.core import assets
from unity import mono
from witness import bundles as exports
from witness import environments

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
TABLE = ROOT / "twin-out/witness.md"
PROPERTY = "witness_figure"


class Foreign:
    """Programs that are not ours, by the names of tests/witness/environments.py."""

    def __init__(self) -> None:
        self._kept: dict[tuple[str, str], Any] = {}

    def need(self, name: str):
        """Return the environment of a witness; without it the test skips loudly, or fails where it is required."""
        try:
            return environments.environment(name)
        except environments.NotThereError as error:
            if os.environ.get("TWIN_WITNESS_REQUIRED"):
                pytest.fail(str(error), pytrace=False)
            pytest.skip(str(error))

    def read(self, name: str, script: str, *arguments: object, timeout: float = 300.0) -> Any:
        """Return what a reader of this folder printed as JSON; see `environments.read`."""
        self.need(name)
        return environments.read(name, script, *arguments, timeout=timeout)

    def ask(self, name: str, script: str, argument: object, timeout: float = 300.0) -> Any:
        """Return what a reader that is kept running answers; see `environments.Kept`. One that failed begins anew."""
        self.need(name)
        kept = self._kept.get((name, script))
        if kept is None:
            kept = self._kept[name, script] = environments.Kept(name, script)
        try:
            return kept.ask(argument, timeout)
        except BaseException:
            self._kept.pop((name, script)).close()
            raise

    def close(self) -> None:
        """End the readers that are kept running."""
        while self._kept:
            self._kept.popitem()[1].close()


_foreign = Foreign()


@pytest.fixture(scope="session")
def foreign() -> Iterator[Foreign]:
    """Programs that are not ours."""
    yield _foreign
    _foreign.close()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Let a test marked witness("bpy") skip or fail before anything is exported for it."""
    for mark in item.iter_markers("witness"):
        for name in mark.args:
            _foreign.need(name)


ALIKE = {"davinci_psm_si": "davinci_psm", "raven_right": "raven_left"}
"""Robots that differ from another one in numbers, not in kind; what is read of every robot is read of these nightly."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests of robots that are `ALIKE` another one; a pair of a program and a robot is chosen on purpose."""
    for item in items:
        if HERE not in item.path.parents:
            continue
        chosen = item.callspec.params if isinstance(item, pytest.Function) and hasattr(item, "callspec") else {}
        robots = [chosen[key] for key in ("case", "name") if key in chosen]
        if len(robots) == 1 and robots[0] in ALIKE:
            item.add_marker(pytest.mark.nightly)


class Figures:
    """Collects rows of the table for one test."""

    def __init__(self, record) -> None:
        self._record = record

    def add(self, witness: str, robot: str, file: str, worst_m: float, worst_rad: float, count: str = "") -> None:
        """Keep the worst error of a witness in m and rad; NaN where it says only yes or no.

        Args:
            witness: program, version and reader.
            robot: name.
            file: what it read: a protocol, or a file.
            worst_m, worst_rad: worst error of any link at any frame.
            count: what was compared, or what it said.
        """
        row = [witness, robot, file, float(worst_m), float(worst_rad), count]
        self._record(PROPERTY, json.dumps(row))


@pytest.fixture
def figures(record_property) -> Figures:
    """Keeps the worst error of a witness for the table."""
    return Figures(record_property)


_rows: list[tuple[str, str, str, float, float, str]] = []
_seconds: dict[str, float] = {}


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Collect rows; with pytest-xdist they come from the workers with the reports."""
    if not report.nodeid.startswith("tests/witness/"):
        return
    file = Path(report.nodeid.split("::")[0]).stem
    _seconds[file] = _seconds.get(file, 0.0) + report.duration
    if report.when == "call":
        _rows.extend(tuple(json.loads(v)) for k, v in report.user_properties if k == PROPERTY)


def pytest_terminal_summary(terminalreporter) -> None:
    """Print the table and write it."""
    if not _rows:
        return
    lines = list(_table())
    terminalreporter.section("witnesses")
    for line in lines:
        terminalreporter.write_line(line)
    TABLE.parent.mkdir(parents=True, exist_ok=True)
    aside = TABLE.with_suffix(f".{os.getpid()}.tmp")
    aside.write_text("\n".join(["# What foreign programs read", "", *lines, ""]), encoding="utf-8")
    aside.replace(TABLE)


def _table() -> Iterator[str]:
    yield "| witness | robot | file | worst, um | worst, deg | what |"
    yield "|---|---|---|---|---|---|"
    for witness, robot, file, metres, radians, what in sorted(_rows):
        um = "-" if metres != metres else f"{metres * 1e6:.3f}"
        degrees = "-" if radians != radians else f"{radians * 57.29577951308232:.6f}"
        yield f"| {witness} | {robot} | {file} | {um} | {degrees} | {what} |"
    yield ""
    yield "| tests | seconds |"
    yield "|---|---|"
    for file, seconds in sorted(_seconds.items()):
        yield f"| {file} | {seconds:.1f} |"


@pytest.fixture(scope="module")
def build(foreign, tmp_path_factory):
    """The Unity package, compiled by mono."""
    foreign.need("mono")
    return mono.Build(tmp_path_factory.mktemp("unity"))


@pytest.fixture(scope="session")
def witness_environments():
    """The module tests/witness/environments.py."""
    return environments


@pytest.fixture(scope="session")
def bundles():
    """The module tests/witness/bundles.py."""
    return exports


@pytest.fixture(scope="session", params=assets.names())
def case(request, bundles):
    """The exports of a robot, with the truth about them."""
    return bundles.case(request.param)


@pytest.fixture
def judge(bundles, figures):
    """Return a function (what a reader printed, case) that fails where it is not the truth."""

    def check(printed: dict[str, Any], case) -> None:
        version = printed.pop("version")
        assert printed, f"{version} was asked nothing"
        wrong = []
        for name, found in printed.items():
            motion = case.motions[name.split()[-1]]
            assert len(motion.times) >= 20
            worst = bundles.compare(found, motion)
            counted = f"{len(motion.links)} links, {len(motion.times)} frames"
            figures.add(version, case.robot, name, worst.position, worst.rotation, counted)
            if not worst.good:
                wrong.append(f"{case.robot}, {name}: {worst}")
        assert not wrong, f"{version}: " + "\n".join(wrong)

    return check
