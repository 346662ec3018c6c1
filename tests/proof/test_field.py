"""The prime field follows the rules of fractions; values follow those of the reals."""

from __future__ import annotations

import math
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin.proof import constants, draws, field, values
from twin.proof.exact_replay import Notes, replay

fractions = st.fractions(max_denominator=1000).filter(lambda x: abs(x) < 1000)


def residues(*numbers):
    return np.array([field.residue(x) for x in numbers], np.uint64)


def is_prime(number):
    """Return whether a number is a prime: a test by Miller and Rabin that is exact below 3e23."""
    odd, twos = number - 1, 0
    while odd % 2 == 0:
        odd, twos = odd // 2, twos + 1
    for base in (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37):
        powers = [pow(base, odd * 2**k, number) for k in range(twos)]
        if powers[0] != 1 and number - 1 not in powers:
            return False
    return True


@pytest.mark.parametrize("prime", field.PRIMES)
def test_the_primes_have_the_roots_of_drawings(prime):
    assert is_prime(prime)
    assert prime < 2**50
    assert prime % 8 == 7
    for number in (2, 3, 5, 7, 11, 13, 61):
        assert pow(number, (prime - 1) // 2, prime) == 1
    with field.modulo(prime):
        for radicand in constants.ROOTS:
            exact = constants.exact(1, radicand)
            assert exact.residue**2 % prime == radicand
        two, three, six = (constants.exact(1, n).residue for n in constants.ROOTS)
        assert two * three % prime == six


def test_products_of_large_residues_are_right_to_the_last_bit():
    generator = np.random.default_rng(5)
    for prime in field.PRIMES:
        a, b = generator.integers(0, prime, (2, 20000)).astype(np.uint64)
        a[:3], b[:3] = prime - 1, [prime - 1, 0, 1]
        with field.modulo(prime):
            assert field.multiply(a, b).tolist() == [x * y % prime for x, y in zip(a.tolist(), b.tolist(), strict=True)]
            inverse = field.inverse(a)
            assert (field.multiply(a, inverse) == (a != 0)).all()


@given(fractions, fractions)
def test_sums_products_and_quotients_are_those_of_fractions(a, b):
    x, y = residues(a), residues(b)
    assert field.add(x, y) == residues(a + b)
    assert field.multiply(x, y) == residues(a * b)
    assert field.negative(x) == residues(-a)
    if b:
        assert field.multiply(x, field.inverse(y)) == residues(a / b)


@given(fractions)
def test_the_root_of_a_square_is_the_number_or_its_negative(a):
    found = int(field.root(residues(a * a))[0])
    assert found in (field.residue(a), field.residue(-a))


@pytest.mark.parametrize(
    ("value", "exact"),
    [
        (0.013000000000000001, Fraction(13, 1000)),
        (0.1575, Fraction(1575, 10000)),
        (1 / 3, Fraction(1, 3)),
        (6.123233995736766e-17, Fraction(0)),
    ],
)
def test_decimals_are_meant_as_written(value, exact):
    assert constants.exact_number(value) == constants.exact(exact)


@pytest.mark.parametrize("radicand", constants.ROOTS)
def test_multiples_of_roots_are_recognised(radicand):
    found = constants.exact_number(math.sqrt(radicand) / 6)
    assert found == constants.exact(Fraction(1, 6), radicand)
    length = constants.decimal(0.0225 * math.sqrt(radicand) + 3e-12, 1e-10)
    assert length == constants.exact(Fraction(225, 10000), radicand)


@pytest.mark.parametrize("value", [math.pi, math.e, 0.1499967322977404, math.nan, math.inf])
def test_other_numbers_have_no_exact_form(value):
    assert constants.exact_number(value) is None
    assert constants.decimal(value, 1e-12) is None


@given(st.integers(-24, 24))
def test_multiples_of_30_degrees_have_exact_cosines(k):
    cosine, sine = constants.exact_angle(k * math.pi / 6)
    assert float(cosine) == pytest.approx(math.cos(k * math.pi / 6), abs=1e-14)
    assert float(sine) == pytest.approx(math.sin(k * math.pi / 6), abs=1e-14)
    assert constants.exact_angle(k * math.pi / 6 + 1e-6) is None


def test_a_drawn_angle_is_on_the_unit_circle_and_within_its_range():
    angle = draws.turn(np.random.default_rng(1), -0.4, 2.0, 500, "a")
    square = values.total(values.product(angle.cosine, angle.cosine), values.product(angle.sine, angle.sine))
    assert (square.residue == 1).all()
    np.testing.assert_allclose(np.cos(angle.real), angle.cosine.real, atol=1e-14)
    np.testing.assert_allclose(np.sin(angle.real), angle.sine.real, atol=1e-14)
    assert angle.real.min() > -0.8
    assert angle.real.max() < 2.4


def test_an_angle_is_drawn_near_given_ones_that_are_half_a_turn_or_more_from_the_middle():
    low, high = -4.5, 4.6
    centres = np.concatenate([np.linspace(low, high, 400), np.pi + np.linspace(-0.004, 0.004, 50)])
    angle = draws.turn(np.random.default_rng(1), low, high, 450, "a", centres=centres)
    np.testing.assert_allclose(angle.real, centres, rtol=0, atol=1e-9)
    assert angle.real.min() >= low
    assert angle.real.max() <= high
    square = values.total(values.product(angle.cosine, angle.cosine), values.product(angle.sine, angle.sine))
    assert (square.residue == 1).all()
    np.testing.assert_allclose(np.cos(angle.real), angle.cosine.real, atol=1e-14)
    np.testing.assert_allclose(np.sin(angle.real), angle.sine.real, atol=1e-14)


x = ca.SX.sym("x")
y = ca.SX.sym("y")
a = ca.SX.sym("a")
b = ca.SX.sym("b")
IDENTITIES = {
    "sum of angles": ca.cos(a + b) - (ca.cos(a) * ca.cos(b) - ca.sin(a) * ca.sin(b)),
    "double angle": ca.sin(2 * a) - 2 * ca.sin(a) * ca.cos(a),
    "half angle": 2 * ca.sin(a / 2) ** 2 - (1 - ca.cos(a)),
    "quarter turn": ca.sin(a + ca.pi / 2) - ca.cos(a),
    "tangent": ca.tan(a) * ca.cos(a) - ca.sin(a),
    "arc tangent": ca.sqrt(x**2 + y**2) * ca.cos(ca.atan2(y, x)) - x,
    "arc cosine": ca.cos(ca.acos(x / 9)) - x / 9,
    "arc sine": ca.sin(ca.asin(x / 9)) - x / 9,
    "square": ca.sqrt(x**2 + 1) ** 2 - x**2 - 1,
    "magnitude": ca.fabs(x) * ca.sign(x) - x,
    "choice": ca.if_else(x > y, x, y) - ca.fmax(x, y),
    "quotient": x / y - 1 / (y / x),
    "constant length": ca.sqrt((0.45 * ca.cos(a)) ** 2 + (0.45 * ca.sin(a)) ** 2) - 0.45,
}
WRONG = {
    "sum of angles": ca.cos(a + b) - (ca.cos(a) * ca.cos(b) + ca.sin(a) * ca.sin(b)),
    "double angle": ca.sin(2 * a) - ca.sin(a) * ca.cos(a),
    "tiny": x - (1 + 1e-9) * x,
    "arc tangent": ca.sqrt(x**2 + y**2) * ca.cos(ca.atan2(y, x)) - y,
    "choice": ca.if_else(x > y, x, y) - ca.fmin(x, y),
}


def at_states(expression, states=400):
    generator = np.random.default_rng(3)
    state = [draws.number(generator, -3, 4, states, "x"), draws.number(generator, -3, 4, states, "y")]
    state += [draws.turn(generator, -2, 2, states, "a"), draws.turn(generator, -3, 1, states, "b")]
    function = ca.Function("f", [ca.vertcat(x, y, a, b)], [expression])
    (found,) = replay(function, [state], Notes())[0]
    reals = function(np.array([values.real_of(s) for s in state])).full()[0]
    return values.scalar(found), reals


@pytest.mark.parametrize("name", IDENTITIES)
def test_identities_are_exactly_zero(name):
    found, reals = at_states(IDENTITIES[name])
    assert found.known.sum() > 20
    assert (found.residue[found.known] == 0).mean() > 0.2
    np.testing.assert_allclose(found.real, reals, atol=1e-12)


@pytest.mark.parametrize("name", WRONG)
def test_what_is_no_identity_is_nowhere_zero(name):
    found, reals = at_states(WRONG[name])
    assert found.known.sum() > 20
    zero = found.known & (found.residue == 0)
    assert (zero <= (np.abs(reals) < 1e-14)).all()
    np.testing.assert_allclose(found.real, reals, atol=1e-12)


def test_what_is_not_algebraic_is_unknown_and_named():
    notes = Notes()
    state = [draws.number(np.random.default_rng(3), 1, 4, 50, "x")]
    (found,) = replay(ca.Function("f", [x], [ca.log(x) - ca.log(x)]), [state], notes)[0]
    (other,) = replay(ca.Function("f", [x], [ca.sin(x)]), [state], notes)[0]
    assert not values.scalar(other).known.any()
    assert notes.inexact
    assert values.scalar(found).known.all() or not values.scalar(found).known.any()


@pytest.mark.parametrize(
    ("expression", "is_chosen"),
    [
        (ca.fabs(x), lambda x, y: x < 0),
        (ca.sign(x), lambda x, y: x < 0),
        (ca.copysign(x, y), lambda x, y: y < 0),
        (ca.fmin(x, y), lambda x, y: x <= y),
        (x * (x < y), lambda x, y: x < y),
        (x + ca.logic_not(x < y), lambda x, y: x >= y),
        (ca.if_else(x < y, x, 0), lambda x, y: x < y),
    ],
)
def test_the_answers_of_all_that_chooses_are_noted(expression, is_chosen):
    generator = np.random.default_rng(3)
    state = [draws.number(generator, -3, 4, 50, "x"), draws.number(generator, -3, 4, 50, "y")]
    notes = Notes()
    replay(ca.Function("f", [ca.vertcat(x, y)], [expression]), [state], notes)
    (answers,) = notes.conditions
    assert answers.tolist() == is_chosen(*map(values.real_of, state)).tolist()
    assert 0 < answers.sum() < 50
