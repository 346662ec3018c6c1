"""The notice of the works of others, compared with the metadata of all packages that the lock installs with twin."""

from __future__ import annotations

import re
import tomllib
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path

from packaging.markers import Marker

ROOT = Path(__file__).parents[2]

PERMISSIVE = re.compile(
    r"(The )?MIT(-0|-CMU| MIT)?|(0|New )?BSD([- ][23]([- ]Clause)?)?|Apache([- ]2(\.0)?)?( WITH LLVM-exception)?"
    r"|ISC|Zlib|BSL-1\.0|CC0-1\.0|PSF(-2\.0)?|Python Foundation|HPND|Unlicense"
)
"""The licences of the notice's row "all others", as metadata spell them."""


def locked() -> set[str]:
    """Return the names of all packages that twin with all extras needs on this machine, from the lock."""
    packages = {p["name"]: p for p in tomllib.loads((ROOT / "uv.lock").read_text())["package"]}
    twin = packages["twin-robotics"]
    waiting = [*twin["dependencies"], *(d for extra in twin["optional-dependencies"].values() for d in extra)]
    names: set[str] = set()
    while waiting:
        dependency = waiting.pop()
        name = dependency["name"]
        if name in names or not Marker(dependency.get("marker", "python_version > '0'")).evaluate():
            continue
        names.add(name)
        waiting += packages[name].get("dependencies", [])
        for extra in dependency.get("extra", []):
            waiting += packages[name]["optional-dependencies"][extra]
    return names - {"twin-robotics"}


def licence(name: str) -> str:
    """Return the licence of an installed package: its SPDX expression, else its classifiers, else its text's head."""
    about = metadata(name)
    classes = [c.split("::")[-1].strip() for c in about.get_all("Classifier") or [] if c.startswith("License")]
    named = [c.removesuffix(" License") for c in classes if c != "OSI Approved"]
    head = (about.get("License") or "").strip().split("\n")[0]
    return about.get("License-Expression") or " AND ".join(named) or head


def permissive(expression: str) -> bool:
    """Return whether all licences of an expression, also those to choose from, are of the kinds of "all others"."""
    plain = re.sub(r" Software| License|[()]|, Version (?=2)", "", expression)
    return all(PERMISSIVE.fullmatch(p) for p in re.split(" AND | OR ", plain))


def noticed() -> set[str]:
    """Return the packages that the notice names in rows of their own."""
    text = (ROOT / "docs" / "licenses" / "THIRD_PARTY.md").read_text()
    cells = [line.split("|")[1] for line in text.splitlines() if line.startswith("| ")]
    names = {n.strip() for cell in cells for n in re.sub(r"\(.*?\)", "", cell).split(",")}
    return names - {"package", "all others"}


def test_the_notice_names_what_is_not_permissive_and_nothing_else():
    unlike = set()
    for name in locked():
        try:
            expression = licence(name)
        except PackageNotFoundError as error:
            raise AssertionError(f"{name} is in the lock but not installed: make .venv/.synced-dev") from error
        if not permissive(expression):
            unlike.add(name)
    # cascadio itself is permissive, but its wheel holds Open CASCADE
    assert noticed() - {"cascadio"} == unlike


def test_the_kinds_of_licences_are_told_apart():
    assert permissive("MIT AND BSD-3-Clause")
    assert permissive("BSD-3-Clause AND 0BSD AND MIT AND Zlib AND CC0-1.0")
    for other in ("", "GPL-3.0-only", "LGPL-3.0-or-later", "EPL-2.0 OR BSD-3-Clause", "MPL-2.0 AND MIT", "MIT-like"):
        assert not permissive(other)
