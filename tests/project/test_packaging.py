"""Packaging: README of PyPI, citation, recipe of conda, and the program that makes an environment smaller."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
import types
from pathlib import Path

import yaml

from made.scripts import script

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
NAMES_IN_CONDA = {
    "pin": "pinocchio",
    "usd-core": "openusd",
    "matplotlib": "matplotlib-base",
    "msgspec": "msgspec-python",
    "mujoco": "mujoco-python",
}


def test_links_and_pictures_of_the_readme_are_absolute_on_pypi(monkeypatch):
    interface = types.ModuleType(
        "hatchling.metadata.plugin.interface"
    )  # hatchling is there only while a package is built
    interface.MetadataHookInterface = object
    for name in ("hatchling", "hatchling.metadata", "hatchling.metadata.plugin"):
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    monkeypatch.setitem(sys.modules, interface.__name__, interface)
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    page = script("docs/packaging/readme_links.py").absolute(text, "https://github.com/a/b", "1.2")
    targets = re.findall(r"\]\(([^)]+)\)", page) + re.findall(r'src="([^"]+)"', page)
    assert len(targets) > 25
    for target in targets:
        assert target.startswith("https://"), target
    assert "https://raw.githubusercontent.com/a/b/v1.2/docs/pictures/sils_lowered.png" in targets
    assert "https://github.com/a/b/blob/v1.2/docs/api.md" in targets
    for target in targets:
        path = re.sub(r"^https://[a-z.]+/a/b/(blob/)?v1\.2/", "", target)
        file = path.partition("#")[0]
        assert path.startswith("https://") or (ROOT / file).exists(), target


def test_readme_is_a_screen_and_a_half_with_five_verdicts():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 60
    assert text.startswith("![")
    rows = [line for line in text.splitlines() if line.startswith("| <img")]
    assert len(rows) == 5
    for row in rows:
        picture = re.search(r'src="([^"]+)"', row)[1]
        assert (ROOT / picture).is_file()


def test_versions_and_names_agree():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert cited["version"] == PROJECT["version"]
    assert cited["license"] == PROJECT["license"]
    assert {"Repository", "Issues", "Changelog", "Documentation"} <= set(PROJECT["urls"])


def test_the_recipe_of_conda_needs_what_the_package_needs():
    recipe = (ROOT / "docs/packaging/conda/meta.yaml").read_text(encoding="utf-8")
    assert f'set version = "{PROJECT["version"]}"' in recipe
    run = recipe[recipe.index("  run:") : recipe.index("test:")]
    for line in PROJECT["dependencies"]:
        name, bounds = re.match(r"([a-z0-9-]+)(.*?)(?: *#.*)?$", line).groups()
        wanted = f"{NAMES_IN_CONDA.get(name, name)} {bounds}"
        assert wanted in run or f"{name}{bounds}" in run, wanted


def test_any_python_that_the_package_allows_will_do():
    """A pinned version would refuse all others: `make demo` on a system that has Python 3.12 alone."""
    assert not (ROOT / ".python-version").exists()
    assert PROJECT["requires-python"] == ">=3.11"


def test_the_images_have_the_library_that_slim_systems_lack():
    """Of all libraries that `run sils` loads, libgomp alone is neither in a wheel nor in python:slim."""
    stages = (ROOT / "docs/packaging/Dockerfile").read_text(encoding="utf-8").split("\nFROM ")[1:]
    assert len(stages) == 3
    for stage in stages:
        runs_twin = "CMD" in stage or "ENTRYPOINT" in stage
        assert ("libgomp1" in stage) == runs_twin, stage


def test_an_environment_is_trimmed_and_nothing_else(tmp_path):
    packages = tmp_path / "env/lib/python3.11/site-packages"
    for name in (
        "twin/a.py",
        "casadi/include/x.h",
        "casadi/libipopt.so",
        "casadi/libcasadi.so.3",
        "cmeel.prefix/lib/b.a",
    ):
        file = packages / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(name)
    for name in ("libcasadi.so.3", "libcasadi.so"):
        (packages / "casadi" / name).write_text("one library")
    program = [sys.executable, ROOT / "docs/packaging/trim.py", tmp_path / "env"]
    done = subprocess.run(program, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    left = sorted(str(p.relative_to(packages)) for p in packages.rglob("*") if p.is_file())
    assert left == ["casadi/libcasadi.so", "casadi/libcasadi.so.3", "twin/a.py"]
    assert (packages / "casadi/libcasadi.so").is_symlink()
    assert (packages / "casadi/libcasadi.so").read_text() == "one library"
    refused = subprocess.run([*program[:2], tmp_path], capture_output=True, text=True, check=False)
    assert refused.returncode == 2
    assert "not a virtual environment" in refused.stderr
