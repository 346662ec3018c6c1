"""Fixtures that several test files share."""

from __future__ import annotations

import gc
from pathlib import Path

import numpy as np
import pytest

SILS = Path(__file__).parents[1] / "cad/sils/sils.toml"


def pytest_collection_finish():
    """Leave what all tests import out of the searches for garbage: they took a tenth of the suite."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)


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

    from twin.kinematics import symbolic
    from twin.kinematics.tasks import Term, residual

    def evaluate(term: Term, T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        xi = ca.SX.sym("xi", 6)
        r = residual(term.kind, term.rows, symbolic.retract(ca.SX(T), xi), ca.SX(0, 1), ca.SX(ca.DM(term.numbers)))
        out = ca.Function("at", [xi], [r, ca.jacobian(r, xi)])(np.zeros(6))
        return np.array(out[0]).ravel(), np.array(out[1])

    return evaluate
