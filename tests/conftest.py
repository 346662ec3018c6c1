"""Fixtures that several test files share."""

from __future__ import annotations

import gc
import hashlib
import pickle
import re
from pathlib import Path

import numpy as np
import pytest

SILS = Path(__file__).parents[1] / "cad/sils/sils.toml"


def pytest_collection_finish():
    """Leave what all tests import out of the searches for garbage: they took a tenth of the suite."""
    gc.collect()
    gc.freeze()


_READ: dict[tuple, bytes] = {}


@pytest.fixture(scope="module")
def cad_once():
    """Read each drawing once in a worker: what is in its folder says whether it is the same, and nobody shares a copy.

    For files whose tests are of something else and load the same robot over and over.
    """
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
