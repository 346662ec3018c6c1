"""Make an environment with twin smaller: remove what Python programs do not need of the packages that twin uses.

    python docs/packaging/trim.py ENVIRONMENT        for an image; a later `pip install` can bring the files back

Removed are headers of C++ (those of Boost are 185 MB), static libraries, solvers of CasADi that twin does not call,
tests of packages, compiled Python, and symbols of libraries (if the program `strip` is there). Libraries that are there
under several names become links to one. docs/install.md has the sizes.
"""

from __future__ import annotations

import argparse
import hashlib
import shutil
import subprocess
import sys
from pathlib import Path

HEADERS = ("cmeel.prefix/include", "cmeel.prefix/bin", "casadi/include")
TESTS = ("numpy/*/tests", "scipy/*/tests", "matplotlib/tests", "mpl_toolkits/*/tests", "casadi/tests")
NEEDED_OF_CASADI = (
    "_casadi",
    "libcasadi.so",
    "libcasadi-tp-openblas",
    "libcasadi_conic_daqp",
    "libcasadi_linsol",
    "libcasadi_rootfinder",
    "libdaqp",
    "libgfortran",
    "libquadmath",
    "libgcc",
    "libstdc",
)
"""Beginnings of the names of libraries of CasADi that twin uses, with the solvers of formulas and controllers."""
PATCHED = ("numpy.libs", "scipy.libs")
"""Folders of libraries that `strip` would damage: their section tables are not in order after auditwheel."""


def size(folder: Path) -> float:
    """Return the size of the files of a folder in MB, without links."""
    total = 0
    for path in folder.rglob("*"):
        if path.is_file() and not path.is_symlink():
            total += path.stat().st_size
    return total / 1e6


def remove(path: Path) -> None:
    """Remove a file or folder."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def linked(folder: Path) -> None:
    """Replace libraries with equal content by links to the one with the longest name."""
    first: dict[str, Path] = {}
    libraries = [path for path in folder.glob("*.so*") if path.is_file() and not path.is_symlink()]
    for path in sorted(libraries, key=lambda path: -len(path.name)):
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        kept = first.setdefault(digest, path)
        if kept is not path:
            path.unlink()
            path.symlink_to(kept.name)


def stripped(folder: Path) -> None:
    """Remove the symbols of all libraries that no program needs to link them."""
    strip = shutil.which("strip")
    if strip is None:
        print("strip is not installed (package binutils): symbols stay", file=sys.stderr)
        return
    for path in folder.rglob("*.so*"):
        if path.is_symlink() or not path.is_file() or path.parent.name in PATCHED:
            continue
        subprocess.run([strip, "--strip-unneeded", path], check=False, stderr=subprocess.DEVNULL)


def trim(packages: Path) -> None:
    """Remove what is not needed from a folder site-packages."""
    for name in HEADERS:
        if (packages / name).exists():
            remove(packages / name)
    for pattern in TESTS:
        for path in packages.glob(pattern):
            remove(path)
    for name in ("casadi", "cmeel.prefix"):
        for path in list((packages / name).rglob("*.a")):
            remove(path)
    for path in list((packages / "casadi").glob("*.so*")):
        if not path.name.startswith(NEEDED_OF_CASADI):
            remove(path)
    for path in list(packages.rglob("__pycache__")):
        remove(path)
    linked(packages / "casadi")
    linked(packages / "cmeel.prefix/lib")
    stripped(packages)


def main() -> None:
    """Trim the environment that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("environment", type=Path, help="folder of a virtual environment")
    environment = parser.parse_args().environment
    found = [path for path in environment.glob("lib/python3*/site-packages") if (path / "twin").is_dir()]
    if len(found) != 1:
        parser.error(f"{environment} is not a virtual environment on Linux with twin (pip install .)")
    before = size(environment)
    trim(found[0])
    print(f"{environment}: {before:.0f} MB before, {size(environment):.0f} MB now")


if __name__ == "__main__":
    main()
