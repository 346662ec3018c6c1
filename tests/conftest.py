"""Fixtures that several test files share."""

from __future__ import annotations

import gc
import hashlib
import os
import pickle
import re
import signal
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from xdist.scheduler import LoadFileScheduling

# As the command line does: a second thread only waits for the first one, and the processors have work.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Each worker has one processor. Files that test parallel work give it more: `several_processors`.
os.environ.setdefault("TWIN_PROCESSORS", "1")
import numpy as np

from twin.core.jobs import usable_processors
from twin.validation.explain import deadline

# A shell without a terminal lets its jobs in the background ignore Ctrl-C, and their programs inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # `nohup` lets its programs ignore it

# The time that a draw or an example takes depends on what else the machine does: no test may fail by it. Nor by chance:
# the examples of a test are the same in each run, but for the nightly lane, which draws others.
settings.register_profile(
    "any machine",
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
    derandomize="TWIN_NEW_EXAMPLES" not in os.environ,
)
settings.load_profile("any machine")
# A search has its limit of processor time, whatever else the machine does.
deadline._ELAPSED_PER_PROCESSOR_SECOND = 1000.0

SILS = Path(__file__).parents[1] / "cad/sils/sils.toml"


FIRST = (
    "test_docs_pages", "test_hazards", "test_pegboard", "test_dome_task", "test_procedure", "test_camera_task",
    "test_explain_faults", "test_explain_dependence", "test_operator", "test_tissue", "test_cad_sher", "test_cad_sils",
    "test_wheel", "test_kill", "test_selftest", "test_session", "test_by_hand", "test_machine_operated",
    # in a browser
    "test_viewer_page", "test_headset_page", "test_headset_xr", "test_headset_xr_console", "test_headset_page_touch",
    "test_headset_page_procedure", "test_viewer_console", "test_headset_page_plan", "test_headset_page_scene",
)  # fmt: skip
"""Files whose tests take longest: a worker that began one of them last would work on alone."""


def pytest_collection_modifyitems(items):
    """Begin with the files that take longest; `--no-loadscope-reorder` keeps this order among several workers."""
    order = {name: k for k, name in enumerate(FIRST)}
    items.sort(key=lambda item: order.get(item.path.stem, len(FIRST)))


class Shares(LoadFileScheduling):
    """A worker takes a whole file, whose fixtures it makes once; of the documentation, a whole page."""

    def _split_scope(self, nodeid):
        file = super()._split_scope(nodeid)
        page = re.search(r"test_docs_pages\.py::test_step\[([\w.-]+):", nodeid)
        return f"{file} {page[1]}" if page else file


def pytest_xdist_make_scheduler(config, log):
    """Share tests by file, as `--dist loadfile` asks for, and by the page in tests/project/test_docs_pages.py."""
    if config.getvalue("dist") == "loadfile":
        return Shares(config, log)
    return None


def pytest_collection_finish():
    """Leave what all tests import out of the searches for garbage, and search less often: they took a tenth."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 20)


_READ: dict[tuple, bytes] = {}


@pytest.fixture(autouse=True, scope="module")
def cad_once(request):
    """Read each drawing once in a worker: what is in its folder says whether it is the same, and nobody shares a copy.

    Not for the files whose tests judge the reading.
    """
    if re.fullmatch(r"(.*\.)?test_(cad_.*|one_reading|bombs)", request.module.__name__):
        yield
        return
    from twin.cad import build

    true, true_step = build.read_mechanism, build.read_step

    def read(path, *, with_mass=True, tolerance=build.VISUAL_TOLERANCE, read=None):
        try:
            files = sorted(p for p in path.parent.rglob("*") if p.is_file() and "__pycache__" not in p.parts)
            found = [(p.relative_to(path.parent), hashlib.sha256(p.read_bytes()).digest()) for p in files]
            beyond = re.search(rb"\.\./|[\"']/", path.read_bytes())
        except OSError:
            beyond, found = True, []
        if beyond or build.read_step is not true_step:  # another folder has a say, or the test itself
            return true(path, with_mass=with_mass, tolerance=tolerance, read=read)
        key = (path.name, with_mass, tolerance, *found)
        if key not in _READ:
            _READ[key] = pickle.dumps(true(path, with_mass=with_mass, tolerance=tolerance, read=read))
        return pickle.loads(_READ[key])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build, "read_mechanism", read)
        yield


_PASSED: dict[tuple, tuple[int, bool, bytes]] = {}


@pytest.fixture(autouse=True, scope="module")
def parsed_once(request):
    """Try the native parser of USD and MJCF once in a worker on each content of a folder: each try starts a process.

    Not for the files whose tests judge the tries, and only what passes is remembered.
    """
    if re.fullmatch(r"(.*\.)?test_(bombs|importing_bad|processes|.*fuzz.*|jobs)", request.module.__name__):
        yield
        return
    from twin.core.foreign import guard

    true = guard._limited

    def limited(kind, seconds, memory, *arguments):
        beside = guard._REFERRED_SUFFIXES.get(kind)
        if beside is None:
            return true(kind, seconds, memory, *arguments)
        files = {
            a: sorted(f for f in a.parent.rglob("*") if f.suffix.lower() in beside and f.is_file()) for a in arguments
        }
        data = {f: f.read_bytes() for found in files.values() for f in found}
        if any(b"../" in d for d in data.values()):  # another folder has a say
            return true(kind, seconds, memory, *arguments)
        content = [(a.name, f.relative_to(a.parent), hashlib.sha256(data[f]).digest()) for a in files for f in files[a]]
        key = (guard._PARSERS[kind], seconds, memory, *content)
        if key in _PASSED:
            return _PASSED[key]
        outcome = true(kind, seconds, memory, *arguments)
        if outcome[:2] == (0, False):
            _PASSED[key] = outcome
        return outcome

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(guard, "_limited", limited)
        yield


@pytest.fixture
def several_processors(monkeypatch):
    """Let parallel work, here and in programs that a test starts, use all processors, as for a user."""
    monkeypatch.delenv("TWIN_PROCESSORS")
    usable_processors.cache_clear()
    yield
    usable_processors.cache_clear()


@pytest.fixture
def no_plots(monkeypatch):
    """Write pages as without matplotlib: plots take most of the time of a short judgement."""

    from twin.ui.report import report_folder

    monkeypatch.setattr(report_folder, "drawable", lambda: False)


@pytest.fixture(scope="module")
def sampled_once():
    """Sample each mechanism once in a file whose tests explain many formulas by it."""
    from twin.validation.explain import explain, judged_states, possible_fixes
    from twin.validation.explain.judged_states import SAMPLES, sample_states

    found = {}

    def once(model, samples=SAMPLES, seed=7, progress=lambda f: None, regular=False):
        key = (id(model), samples, seed, regular)
        if key not in found:
            found[key] = (
                model,
                sample_states(model, samples, seed, progress, regular),
            )  # the model lives as long as its id
        return found[key][1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(explain, "sample_states", once)
        patch.setattr(judged_states, "sample_states", once)
        patch.setattr(possible_fixes, "sample_states", once)
        yield


@pytest.fixture(scope="session")
def sils_cad():
    """The SILS robot measured on its CAD, with masses."""
    from twin.cad.build import read_mechanism

    return read_mechanism(SILS)


@pytest.fixture(scope="session")
def sils_model(sils_cad):
    """The independent model of SILS."""
    from twin.reference import ReferenceModel

    return ReferenceModel(sils_cad.mechanism)


@pytest.fixture(scope="session")
def theatre():
    """The da Vinci scene with its robots and props."""
    from twin.api import load_scene
    from twin.cli.scenes import load

    return load(load_scene("davinci"))


@pytest.fixture(scope="session")
def bare_theatre(theatre):
    """The da Vinci scene with its robots, which nothing touches."""
    return replace(theatre, props=None)


@pytest.fixture(scope="module")
def browser():
    """Chromium without a window, closed after each file: while it is open, no event loop can run."""
    from made import headset_page

    yield from headset_page.chromium()


@pytest.fixture(scope="session")
def emulator(tmp_path_factory):
    """The script of an emulated headset."""
    from made import headset_page

    return headset_page.bundled_emulator(tmp_path_factory.mktemp("emulator"))


@pytest.fixture
def rng():
    """A generator with a fixed seed."""
    return np.random.default_rng(20240607)


@pytest.fixture
def at_pose():
    """Residual (m,) of a term that asks for no joints, and its Jacobian (m, 6) by the twist, unweighted."""
    import casadi as ca

    from twin.formula import symbolic
    from twin.kinematics.tasks import Term, residual

    def evaluate(term: Term, T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        xi = ca.SX.sym("xi", 6)
        r = residual(term.kind, term.rows, symbolic.retract(ca.SX(T), xi), ca.SX(0, 1), ca.SX(ca.DM(term.numbers)))
        out = ca.Function("at", [xi], [r, ca.jacobian(r, xi)])(np.zeros(6))
        return np.array(out[0]).ravel(), np.array(out[1])

    return evaluate
