"""The built wheel in a clean environment, used from another directory."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

import twin
from twin.core.extras import EXTRAS

pytestmark = [pytest.mark.wheel, pytest.mark.usefixtures("several_processors")]

ROOT = Path(__file__).parents[2]
OWN_UV = ROOT / ".venv-uv/bin/uv"
UV = shutil.which(os.environ.get("UV", "uv")) or (str(OWN_UV) if OWN_UV.is_file() else None)
MEGABYTE = 1e6


def _run(*argv: object, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    kept = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV", "PYTHONHOME")}
    return subprocess.run([str(a) for a in argv], cwd=cwd, env=kept | environment, capture_output=True, text=True)


def _ok(result: subprocess.CompletedProcess[str]) -> str:
    assert result.returncode == 0, f"{result.args}\n{result.stdout}\n{result.stderr}"
    return result.stdout


@pytest.fixture(scope="module", autouse=True)
def compiled_once(tmp_path_factory):
    """What Python compiles goes into one folder of its own: twin alone could write into the environment."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPYCACHEPREFIX", str(tmp_path_factory.mktemp("compiled")))
        yield


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """The wheel, built from a copy: no build leaves anything in the checkout."""
    copy = tmp_path_factory.mktemp("checkout") / "twin"
    out = tmp_path_factory.mktemp("dist")
    skipped = shutil.ignore_patterns(".git", ".venv*", ".*_cache", "twin-out", "__pycache__", "node_modules")
    shutil.copytree(ROOT, copy, ignore=lambda d, ns: skipped(d, ns) | ({"dist"} if Path(d) == ROOT else set()))
    if UV:
        _ok(_run(UV, "build", "--wheel", "--out-dir", out, cwd=copy))
    else:
        _ok(_run(sys.executable, "-m", "pip", "wheel", "--no-deps", "--wheel-dir", out, ".", cwd=copy))
    return next(out.glob("*.whl"))


@pytest.fixture(scope="module")
def names(wheel) -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


@pytest.fixture(scope="module")
def venv(wheel, tmp_path_factory) -> Path:
    """A new environment with the wheel and what it needs, at the versions of the lock file."""
    folder = tmp_path_factory.mktemp("clean") / "venv"
    if UV:
        pins = folder.parent / "pins.txt"
        exported = ("--frozen", "--no-dev", "--no-emit-project", "--no-hashes", "-o", pins)
        _ok(_run(UV, "export", *exported, cwd=ROOT))
        _ok(_run(UV, "venv", "--python", sys.executable, folder, cwd=folder.parent))
        _ok(_run(UV, "pip", "install", "--python", folder, "--constraint", pins, wheel, cwd=folder.parent))
    else:
        _ok(_run(sys.executable, "-m", "venv", folder, cwd=folder.parent))
        _ok(_run(folder / "bin/python", "-m", "pip", "install", "--quiet", wheel, cwd=folder.parent))
    return folder


def test_wheel_holds_the_data_of_every_robot(names):
    committed = {
        f"twin/_data/{p.relative_to(ROOT)}"
        for kind in ("cad", "usd", "trajectories")
        for p in (ROOT / kind).rglob("*")
        if p.is_file() and p.suffix not in (".py", ".pyc")
    }
    for file in (ROOT / "docs/examples").glob("*/**/*"):
        drawn_or_built = (file.parent.name == "cad" and file.suffix == ".py") or "usd" in file.parts
        if file.is_file() and file.suffix != ".pyc" and not drawn_or_built:
            committed.add(f"twin/_data/examples/{file.relative_to(ROOT / 'docs/examples')}")
    packed = {n for n in names if n.startswith("twin/_data/")}
    assert packed == committed
    assert {"twin/_data/cad/sils/sils.step", "twin/_data/cad/sils/sils.toml"} <= packed
    assert {"twin/_data/usd/sils/sils.usda", "twin/_data/trajectories/sils/table2.toml"} <= packed


def test_wheel_holds_the_package_and_nothing_else(names):
    files = [p.relative_to(ROOT) for p in (ROOT / "twin").rglob("*") if p.is_file() and p.suffix != ".pyc"]
    web = Path("twin/ui/headset/web")
    modules = {str(p) for p in files if web not in p.parents or web / "dist" in p.parents}
    assert modules <= names
    assert {n for n in names if n.startswith(f"{web}/")} == {str(p) for p in files if web / "dist" in p.parents}
    assert f"{web}/dist/twin.js" in names
    others = {n for n in names if not n.startswith("twin/") and ".dist-info/" not in n}
    assert others == set()
    programs = {n for n in names if n.startswith("twin/_data/") and n.endswith(".py")}
    assert programs == {"twin/_data/examples/hexapod/formula.py"}, "CAD sources are not shipped"
    assert not [n for n in names if Path(n).name.startswith(("test_", "conftest"))]


def test_wheel_is_small(wheel):
    """For STEP, stages and baked motions two megabytes a robot are enough."""
    assert wheel.stat().st_size < 2 * MEGABYTE * len(twin.names())


def test_wheel_names_its_licence_and_command(wheel, names):
    info = next(n for n in names if n.endswith(".dist-info/entry_points.txt")).rsplit("/", 1)[0]
    with zipfile.ZipFile(wheel) as archive:
        assert "twin = twin.cli:main" in archive.read(f"{info}/entry_points.txt").decode()
        metadata = archive.read(f"{info}/METADATA").decode()
    assert f"{info}/licenses/LICENSE" in names
    texts = {
        f"{info}/licenses/docs/licenses/{n}" for n in ("THIRD_PARTY.md", "LGPL-2.1.txt", "OCCT_LGPL_EXCEPTION.txt")
    }
    assert texts <= names
    wanted = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    needed = [line for line in metadata.splitlines() if line.startswith("Requires-Dist: ") and "extra ==" not in line]
    assert len(needed) == len(wanted["dependencies"])
    assert {f"Provides-Extra: {extra}" for extra in (*EXTRAS.values(), "all")} <= set(metadata.splitlines())
    assert f"\nVersion: {wanted['version']}\n" in metadata


def test_installed_version_is_that_of_the_package(venv, tmp_path):
    code = "import twin, importlib.metadata as m; print(twin.__version__ == m.version('twin-robotics'))"
    assert _ok(_run(venv / "bin/python", "-c", code, cwd=tmp_path)).strip() == "True"


def test_environment_lacks_the_development_packages(venv, tmp_path):
    listed = json.loads(_ok(_run(venv / "bin/twin", "doctor", "--json", cwd=tmp_path)))
    assert listed["missing"] == []
    absent = ("build123d", "distributed", "mcap", "pyarrow", "segno", "pyyaml")
    assert {listed["found"][name] for name in absent} == {"-"}


@pytest.mark.parametrize(
    ("module", "argv"),
    [
        ("distributed", ("workspace", "sils", "--scheduler", "tcp://127.0.0.1:1")),
        ("yaml", ("new", "arm", "--from", "{data}/fourbar.urdf", "--out", "{here}/arm")),
    ],
)
def test_what_is_missing_is_named_with_its_extra(venv, tmp_path, module, argv):
    argv = [a.format(data=ROOT / "tests/data/importing/models", here=tmp_path) for a in argv]
    refused = _run(venv / "bin/twin", *argv, cwd=tmp_path)
    assert refused.returncode == 2
    assert f"needs {module}: pip install 'twin-robotics[{EXTRAS[module]}]'" in refused.stderr
    assert "Traceback" not in refused.stderr


def test_installed_twin_runs_the_main_job_from_another_directory(venv, tmp_path):
    cache = {"XDG_CACHE_HOME": str(tmp_path / "cache")}  # an empty one: the drawing is read here
    before = _files(venv)
    there = tmp_path / "elsewhere"
    there.mkdir()
    robots = json.loads(_ok(_run(venv / "bin/twin", "list", "--json", cwd=there)))
    assert [r["name"] for r in robots["robots"]] == sorted(
        p.stem for p in (ROOT / "cad").glob("*/*.toml") if p.stem == p.parent.name
    )
    _ok(_run(venv / "bin/twin", "doctor", cwd=there))

    out = _ok(_run(venv / "bin/twin", "run", "hibou", "--json", "--out", tmp_path / "out", cwd=there, **cache))
    report = json.loads(out)
    assert report["verdict"] == "agree"
    assert (tmp_path / "out/usd/hibou.usda").is_file()
    assert (tmp_path / "out/cavity/report.html").is_file()

    refused = _run(venv / "bin/twin", "build", "sils", "--json", cwd=there)
    assert refused.returncode == 2
    assert "--out" in json.loads(refused.stdout)["message"]
    assert list(there.iterdir()) == []
    assert _files(venv) == before, "something was written into the environment"


def test_installed_twin_explains_a_disagreement(venv, tmp_path):
    told = _run(venv / "bin/twin", "explain", "sils", "--variant", "eq1=printed", "--json", cwd=tmp_path)
    assert told.returncode == 1, told.stderr
    assert "FutureWarning" not in told.stderr
    assert "c_phi" in told.stdout


def test_stage_in_the_wheel_is_current(venv, tmp_path):
    """The installed stage is used as it is; a stale one would be rebuilt on every call."""
    code = (
        "from twin import api\nfrom twin.core import assets\nfrom twin.cad.build import fingerprint\n"
        "from twin.usd.read import made_from\n"
        "f = assets.files('sils'); print(fingerprint(f.description) in made_from(f.stage))"
    )
    assert _ok(_run(venv / "bin/python", "-c", code, cwd=tmp_path)).strip() == "True"


def test_pip_install_takes_the_same_back_end():
    build = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["build-system"]
    assert build["build-backend"] == "hatchling.build"
    assert [r for r in build["requires"] if r.startswith("hatchling")] == build["requires"]


def _files(folder: Path) -> set[tuple[str, int]]:
    return {(str(p), p.stat().st_mtime_ns) for p in folder.rglob("*") if p.is_file() and p.suffix != ".pyc"}
