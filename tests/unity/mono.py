"""Compile the Unity package with mono's mcs against a stub of UnityEngine, and run its NUnit tests."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
PACKAGE = HERE.parents[1] / "twin/ui/headset/unity"

_FRAMEWORK = "/usr/lib/cli/nunit.framework-2.6.3/nunit.framework.dll"
_LANGUAGE = ("-langversion:7.2", "-nologo", "-optimize+")


CONVENTIONS = {
    "GltFast": (np.diag([-1.0, 1.0, 1.0]), np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])),
    "UrdfImporter": (np.array([[0.0, -1, 0], [0, 0, 1], [1, 0, 0]]), np.eye(3)),
}
"""By convention: the mirror (3, 3) of coordinates below the root, and the rotation (3, 3) of the root."""


def turned_back(convention: str, points: np.ndarray) -> np.ndarray:
    """Return points (..., 3) in Unity's world in the right-handed world of the robot or the scene."""
    mirror, root = CONVENTIONS[convention]
    return points @ root @ mirror  # both are orthogonal: rows times them turn back


@dataclass(frozen=True)
class Outcome:
    """What NUnit said: tests by full name that passed and that did not, or why nothing ran."""

    passed: tuple[str, ...]
    failed: tuple[str, ...]
    fault: str = ""


class Build:
    """The package compiled in a folder.

    `engine` is the stub, `player` and `editor` the package's assemblies, `tests` its NUnit tests, and every .cs file of
    tests/unity a program.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.engine = self._library("UnityEngine", sorted((HERE / "stub").glob("*.cs")))
        self.player = self._library("Twin.Player", sources(), self.engine)
        self.editor = self._library("Twin.Player.Editor", in_package("Editor"), self.engine, self.player)
        self.samples = self._library("Samples", in_package("Samples~"), self.engine, self.player)
        tests = in_package("Tests")
        self.tests = self._library("Twin.Player.Tests", tests, self.engine, self.player, self.editor, Path(_FRAMEWORK))
        for program in sorted(HERE.glob("*.cs")):
            compiled([program], folder / f"{program.stem}.exe", self.engine, self.player)

    def mutant(self, folder: Path, file: str, old: str, new: str) -> str:
        """Make a copy of this build in `folder`, with one change of a source file; return what mcs says, or "".

        Raises:
            ValueError: the text to be changed is not in the file, or more than once.
        """
        shutil.copytree(self.folder, folder, dirs_exist_ok=True)
        changed = []
        for source in sources():
            text = source.read_text(encoding="utf-8")
            if source.name == file:
                if text.count(old) != 1:
                    raise ValueError(f"{file}: '{old}' is there {text.count(old)} times")
                text = text.replace(old, new)
            changed.append(folder / source.name)
            changed[-1].write_text(text, encoding="utf-8")
        try:
            compiled(changed, folder / self.player.name, self.engine, library=True, strict=False)
        except ChildProcessError as error:
            return str(error)
        return ""

    def _library(self, name: str, files: list[Path], *references: Path) -> Path:
        out = self.folder / f"{name}.dll"
        compiled(files, out, *references, library=True)
        return out


def sources() -> list[Path]:
    """Return the sources of the runtime."""
    return in_package("Runtime")


def in_package(folder: str) -> list[Path]:
    """Return the C# files below a folder of the package."""
    return sorted((PACKAGE / folder).rglob("*.cs"))


def compiled(
    files: list[Path], out: Path, *references: Path, library: bool = False, strict: bool = True, define: str = ""
) -> None:
    """Compile; if `strict`, with every warning an error; `define` is a symbol of the preprocessor.

    Raises:
        ChildProcessError: mcs found an error; the message is what it said.
    """
    command = [
        "mcs",
        *_LANGUAGE,
        *(["-warnaserror+"] if strict else []),
        f"-target:{'library' if library else 'exe'}",
        f"-out:{out}",
        *([f"-define:{define}"] if define else []),
    ]
    done = run([*command, *(f"-r:{r}" for r in references), *map(str, files)])
    if done.returncode:
        raise ChildProcessError(done.stdout + done.stderr)


def nunit(folder: Path) -> Outcome:
    """Run the NUnit tests of a build."""
    result = folder / "TestResult.xml"
    result.unlink(missing_ok=True)
    done = run(["nunit-console", "-nologo", "-noshadow", f"-xml:{result}", "Twin.Player.Tests.dll"], cwd=folder)
    if not result.is_file():
        return Outcome((), (), (done.stdout + done.stderr)[-2000:] or f"no result, exit code {done.returncode}")
    cases = ET.parse(result).getroot().iter("test-case")
    verdicts = {c.get("name", ""): c.get("result") == "Success" for c in cases}
    return Outcome(
        tuple(n for n, good in verdicts.items() if good), tuple(n for n, good in verdicts.items() if not good)
    )


def run(command: list[str], cwd: Path | None = None, timeout: float = 120.0) -> subprocess.CompletedProcess[str]:
    """Run a program, with the package's resources where the stub looks for them.

    Mono hangs in about one of some hundred runs of the same program; a program that does not end is run once more.

    Raises:
        subprocess.TimeoutExpired: the program has not ended twice.
    """
    done = partial(
        subprocess.run, command, cwd=cwd, env=surroundings(), capture_output=True, text=True, timeout=timeout
    )
    try:
        return done()
    except subprocess.TimeoutExpired:
        return done()


def surroundings() -> dict[str, str]:
    """Return the environment of a program on the stub."""
    return os.environ | {"TWIN_RESOURCES": str(PACKAGE / "Runtime/Resources"), "LC_ALL": "C.UTF-8"}


def version() -> str:
    """Return the version of mono."""
    found = re.search(r"version (\S+)", run(["mono", "--version"]).stdout)
    return f"mono {found[1]}" if found else "mono"
