"""Noise of a CAD's features: named as such with its size, and no fault of the equations is hidden by it.

`TWIN_NOISE=4` takes other random errors as well, of all robots; `TWIN_NOISY_MUTANTS=24` is the number of wrong
equations that are explained with a noisy CAD.
"""

from __future__ import annotations

import os
from itertools import cycle

import numpy as np
import pytest

import twin
from made import explain_mutants as mutants
from made import explain_seeds as seeds
from made.drawing_faults import Off, drawn, noisy, some
from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.findings import Finding
from twin.core.units import MM, UM
from twin.reference import ReferenceModel
from twin.ui.report.page import render
from twin.validation.cause import causes
from twin.validation.explain.explain import ExplainOptions, explain
from twin.validation.explain.row_deviations import Judge

SEEDS = int(os.environ.get("TWIN_NOISE", "1"))
MUTANTS = int(os.environ.get("TWIN_NOISY_MUTANTS", "1"))
ROBOTS = twin.names() if SEEDS > 1 else ["davinci_psm", "sils", "pa10"]

ABOVE = 5 * MM
"""Error of an equation that is well above the effect of noise."""


def explained(robot, cad, formula=None):
    options = ExplainOptions(budget=4.0)
    return explain(robot.name, formula or robot.formula, ReferenceModel(cad.mechanism), cad=cad, options=options)


def named(name, seed):
    """Assert that the noise of a CAD is found with its size, and that no equation is accused."""
    robot = twin.load(name)
    cad = noisy(robot, np.random.default_rng(seed))
    assert cad.noise is not None
    rms = 13.2 * UM / np.sqrt(3)  # of each coordinate, for lengths between 5 and 20 um
    assert 0.5 * rms < cad.noise.position < 1.5 * rms
    assert cad.noise.direction < 1e-5
    x = explained(robot, cad)
    assert (x.lead, x.explained, x.exit_code) == ("noise", True, 1)
    assert (x.rows, x.repairs, x.identified, x.conventions, x.parts) == ((), (), None, (), ())
    assert f"noise of {cad.noise.position / UM:.2g} µm in each coordinate" in x.findings[0].message
    sentence = "Noise of the CAD explains the differences of all rows; the equations need no edit"
    assert x.summary == sentence
    page = render(x, "explain")
    assert page.index(sentence) < page.index("cad.noise"), "the sentence stands before the findings"


def test_noise_of_the_cad_is_named_with_its_size():
    named("lapbot", 0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(SEEDS))
@pytest.mark.parametrize("name", ROBOTS)
def test_noise_of_every_cad_is_named_with_its_size(name, seed):
    named(name, seed)


@pytest.mark.parametrize("name", ["lapbot", "hibou"])
def test_few_faulty_parts_are_no_noise(name, rng):
    robot = twin.load(name)
    assert robot.cad.noise is None
    for count in (1, 2):
        assert drawn(robot, *(some(robot, rng) for _ in range(count))).noise is None
    joint = robot.cad.description.joint[0]
    T = spatial.pose(p=[0.2 * MM, 0.2 * MM, 0.2 * MM])
    large = Off(joint.name, joint.child, joint.on_child.origin, "mm", 0.2 * MM, T)
    many = noisy_offs(robot, rng)
    assert drawn(robot, *many).noise is not None
    assert drawn(robot, *many, large).noise is None, "one gap is much larger than the others"


def noisy_offs(robot, rng):
    """Return errors of 10 um of one feature of each joint."""
    offs = []
    for joint in robot.cad.description.joint:
        if isinstance(joint.on_parent.origin, str):
            u = rng.normal(size=3)
            T = spatial.pose(p=10 * UM * u / np.linalg.norm(u))
            offs.append(Off(joint.name, joint.parent, joint.on_parent.origin, "mm", 10 * UM, T))
    return offs


def test_noise_is_one_cause_and_much_larger_errors_of_equations_are_another():
    cad = noisy(twin.load("lapbot"), np.random.default_rng(1))
    small = Finding("point.differs", "disagreement", "p", "outer", "", 0.1, "mm", 1e-6, "", "eq1")
    large = Finding("driven.differs", "disagreement", "q", "q4", "", 20.0, "deg", 1e-6, "", "eq2")
    noise, equation = causes([large, small, *cad.findings])
    assert (noise.name, noise.side, noise.head.code) == ("noise of the CAD", "CAD", "cad.noise")
    assert {f.where for f in noise.follows} == set(cad.noise.joints)
    assert noise.perhaps == (small,)
    assert equation.head is large


@pytest.mark.slow
def test_a_wrong_equation_is_named_with_a_noisy_cad(tmp_path):
    """The rows that are wrong with the exact CAD are named, and nothing else is called noise."""
    rng = np.random.default_rng(5)
    done = 0
    for i, case in enumerate(cycle(map(seeds.built_in, ["lapbot", "pa10"] if MUTANTS < 8 else twin.names()))):
        if done == MUTANTS:
            break
        path = tmp_path / f"{i}" / "formula.py"
        path.parent.mkdir()
        try:
            if mutants.mutant(case, path, rng, 1) is None:
                continue
            faulty = case.load(path)
        except TwinError:
            continue
        exact = Judge(faulty, None, case.reference)
        wrong = {p.symbol: np.abs(exact.residuals[p]).max() for p in exact.failing()}
        worst = max(wrong.values(), default=0.0)
        if not worst * exact.tolerance.length > ABOVE:
            continue
        done += 1
        robot = twin.load(case.name)
        x = explained(robot, noisy(robot, rng), faulty)
        assert x.lead != "noise"
        assert {r.symbol for r in x.rows} <= set(wrong)
        assert x.rows
