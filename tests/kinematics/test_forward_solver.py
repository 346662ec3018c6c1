"""The forward solver of a parallel robot without forward equations (SILS)."""

import numpy as np
import pytest

from twin.core import spatial
from twin.core.errors import KinematicsError
from twin.kinematics import compile_formula
from twin.robots import load_formula


@pytest.fixture(scope="module")
def sils():
    return compile_formula(load_formula("sils"))


def test_forward_without_an_assembly_says_so(sils):
    too_wide = np.array([0, 0.2, 0, 0, 0, 0])  # carriages of limb 1 farther apart than 2 l_1
    q = sils.inverse(spatial.pose(p=sils.formula.seeds[0][:3]))
    with pytest.raises(KinematicsError, match=r"no assembly was found on the branch X_E\+ z_up\+ D-"):
        sils.forward(q + too_wide)
    with pytest.raises(KinematicsError, match="not finite"):
        sils.forward(q * np.nan)
    assert np.isnan(sils.forward_many(np.array([q, q + too_wide, q]))[1]).all()
    assert sils.branches(q[[1, 0, 3, 2, 5, 4]]) == []


def test_forward_stays_on_the_branch_of_its_seed(sils):
    q = sils.inverse(spatial.pose(p=sils.formula.seeds[0][:3]))
    for T in sils.branches(q):
        np.testing.assert_allclose(sils.forward(q + 1e-4, seed=T), T, atol=5e-3)
    with pytest.raises(KinematicsError, match="not a rigid pose"):
        sils.forward(q, seed=2 * np.eye(4))
    with pytest.raises(KinematicsError, match="2 seed poses for 1 rows"):
        sils.forward_many(q[None], seed=np.tile(np.eye(4), (2, 1, 1)))


def test_seeds_of_many_rows_give_the_poses_of_single_calls(sils):
    T = spatial.pose(p=sils.formula.seeds[0][:3])
    q = sils.inverse(T)
    near = np.array([q, q + 1e-4, q - 1e-4])
    too_wide = np.array([0, 0.2, 0, 0, 0, 0])  # carriages of limb 1 farther apart than 2 l_1
    far = np.array([q + too_wide, q * np.nan])
    qs = np.concatenate([near, far])
    Ts = sils.forward_many(qs, seed=np.tile(T, (len(qs), 1, 1)))
    for q_row, T_row in zip(near, Ts[:3], strict=True):
        np.testing.assert_allclose(T_row, sils.forward(q_row, seed=T), atol=1e-9)
        np.testing.assert_allclose(sils.inverse(T_row), q_row, atol=1e-9)
    assert np.isnan(Ts[3:]).all()
