"""Inverses of batches of Jacobians: singular ones are NaN, whatever the others of the batch are."""

from __future__ import annotations

import numpy as np
import pytest

from twin.kinematics.conditioning import condition_many, invert_many


def regular(shape, seed=1):
    return np.random.default_rng(seed).normal(size=shape)


@pytest.mark.parametrize("shape", [(5, 6, 6), (5, 3, 6), (5, 6, 4)])
def test_regular_matrices_have_their_inverse(shape):
    Js = regular(shape)
    product = invert_many(Js) @ Js if shape[1] >= shape[2] else Js @ invert_many(Js)
    assert product == pytest.approx(np.tile(np.eye(min(shape[1:])), (5, 1, 1)), abs=1e-9)


@pytest.mark.parametrize("change", [lambda J: 0 * J, lambda J: J[:, [0, 0, 2, 3, 4, 5]]], ids=["zero", "equal"])
@pytest.mark.parametrize("rows", [6, 3, 8])
def test_a_singular_matrix_is_nan_and_its_neighbours_are_not(change, rows):
    Js = regular((4, rows, 6), 2)
    if rows == 3:
        Js = np.swapaxes(regular((4, 6, 3), 2), 1, 2)
    alone = invert_many(Js)
    Js[1] = change(Js[1])
    if rows == 3:
        Js[1, 2] = Js[1, 1]
    found = invert_many(Js)
    assert np.isnan(found[1]).all()
    assert np.array_equal(np.delete(found, 1, axis=0), np.delete(alone, 1, axis=0))
    assert not condition_many(Js)[1] < 1e15


def test_a_matrix_that_is_singular_but_for_rounding_is_nan():
    J = regular((6, 6), 3)
    U, values, Vt = np.linalg.svd(J)
    values[-1] = 1e-17 * values[0]
    Js = np.stack([J, U @ np.diag(values) @ Vt])
    assert np.isnan(invert_many(Js)[1]).all()
    assert np.isfinite(invert_many(Js)[0]).all()


def test_a_matrix_with_nan_is_nan():
    Js = regular((3, 6, 6), 4)
    Js[2, 0, 0] = np.nan
    assert np.isnan(invert_many(Js)).all(axis=(1, 2)).tolist() == [False, False, True]
