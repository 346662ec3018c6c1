"""The values of symbols that a formula is judged by: at one sample, repeated, perturbed; and the sampled states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from made.arm import arm
from twin.reference import ReferenceModel
from twin.validation.explain.judged_states import sample_states
from twin.validation.explain.rebuilt_functions import Matrix
from twin.validation.explain.reference_values import ReferenceValues


@pytest.fixture
def reference() -> ReferenceValues:
    """Three samples; `R` is one matrix for all of them."""
    run = sample_states(ReferenceModel(arm(2)), samples=6)
    symbols = {
        "l": 0.2,
        "q": np.array([0.1, 0.2, 0.3]),
        "p": Matrix(np.arange(9.0).reshape(3, 3, 1)),
        "R": Matrix(np.eye(3)[None]),
    }
    return ReferenceValues(symbols, {"q": "angle"}, 3, np.tile(np.eye(4), (3, 1, 1)), run, (("q", "rad"),), {})


def test_the_first_sample_is_the_first_of_every_value(reference):
    first = reference.first()
    assert first.k == len(first.Ts) == 1
    assert first.symbols["l"] == 0.2
    assert first.symbols["q"].tolist() == [0.1]
    assert first.symbols["p"].a[:, :, 0].tolist() == [[0.0, 1.0, 2.0]]
    assert np.array_equal(first.symbols["R"].a, np.eye(3)[None])
    assert first.run is None


def test_samples_are_repeated_in_their_order(reference):
    repeated = reference.repeated([2, 0], 2)
    assert repeated.k == len(repeated.Ts) == 4
    assert repeated.symbols["q"].tolist() == [0.3, 0.1, 0.3, 0.1]
    assert repeated.symbols["p"].a[:, 0, 0].tolist() == [6.0, 0.0, 6.0, 0.0]
    assert repeated.symbols["R"].a.shape == (4, 3, 3)
    assert repeated.run is None


def test_every_symbol_is_perturbed_alike_for_one_seed(reference):
    perturbed = reference.perturbed()
    assert perturbed.run is None
    assert len(set(perturbed.symbols["l"])) == 3  # a parameter too, at each sample by itself
    for name in ("l", "q"):
        changes = np.abs(perturbed.symbols[name] - reference.symbols[name])
        assert np.all((changes > 0) & (changes < 0.02))
    # a zero of a matrix stays
    assert np.array_equal(perturbed.symbols["R"].a != 0, reference.symbols["R"].a != 0)
    assert np.array_equal(reference.perturbed().symbols["q"], perturbed.symbols["q"])
    assert not np.array_equal(reference.perturbed(2).symbols["q"], perturbed.symbols["q"])


def test_joints_without_an_end_are_sampled_around_their_postures():
    """A bound of more than half a turn, beside none on the other side, is kept."""
    mechanism = arm(2)
    first, second = mechanism.joints
    around = np.array([4.0, 0.3])
    unbounded = replace(mechanism, joints=(replace(first, limits=(3.9, np.inf)), second))
    unbounded = replace(unbounded, postures={"far": {"q0": 4.0, "q1": 0.3}})
    q = sample_states(ReferenceModel(unbounded)).q
    assert np.all(q[:, 0] >= 3.9)
    assert np.all(np.abs(q - around) <= 0.3 + 1e-12)
