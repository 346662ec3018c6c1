"""Missing terms and factors: the quick look-up of many required values loses none that the search of one finds."""

from __future__ import annotations

import numpy as np
import pytest

from twin.validation.explain import term_texts
from twin.validation.explain.term_texts import NUMBERS, Atom, Products, factors, terms

K = 12
"""Number of poses."""


def atoms(count, seed=1):
    values = np.random.default_rng(seed).normal(size=(count, K))
    named = [Atom(f"q{i}", row) for i, row in enumerate(values)]
    constants = [Atom("a", np.full(K, 0.3)), Atom("c", np.full(K, 0.8)), Atom("b", np.full(K, np.nan))]
    return [*named, Atom("sin(q0)", np.sin(values[0])), *constants]


def required(given):
    """Return {text: values (K,)} of terms and factors, with numbers and signs."""
    by_text = {atom.text: atom.values for atom in given if np.isfinite(atom.values).all()}
    values = {text: np.full(K, number) for number, text in NUMBERS.items()}
    for one, of_one in by_text.items():
        values[one] = of_one
        values[f"{one}**2"] = of_one**2
        for other, of_other in by_text.items():
            values[f"{one} * {other}"] = of_one * of_other
            values[f"({one} - {other})"] = of_one - of_other
    for text, row in list(values.items()):
        values[f"2 * {text}"] = 2 * row
        values[f"-{text}"] = -row
    return values


@pytest.mark.parametrize("most", [60, 3])
def test_what_the_search_finds_is_likely(most, monkeypatch):
    monkeypatch.setattr(term_texts, "_MOST_FACTORS", most)
    given = atoms(5)
    values = required(given[:3] + given[-3:])
    rows = np.array(list(values.values()))
    likely = set(Products(given).likely(rows).tolist())
    texts_found = set()
    for n, row in enumerate(rows):
        texts = {*factors(row, given), *(text for _, text in terms(row, given))}
        texts_found |= texts
        if texts:
            assert n in likely, texts
    assert {"(q0 - q1)", "(q1 - a)", "q0 * q1", "q2**2", "2 * q1", "3 / 2"} <= texts_found
    noise = np.random.default_rng(2).normal(size=(50, K))
    assert not len(Products(given).likely(noise))


@pytest.mark.parametrize("given", [[], [Atom("b", np.full(K, np.nan))]])
def test_numbers_are_likely_without_any_value(given):
    rows = np.array([np.full(K, 2.0), np.linspace(1, 2, K), np.full(K, -np.pi)])
    assert Products(given).likely(rows).tolist() == [0, 2]
    assert list(factors(rows[0], given)) == ["2"]
