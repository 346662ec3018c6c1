"""Fixtures that several test files share."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

SILS = Path(__file__).parents[1] / "cad/sils/sils.toml"


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
