"""Tables 2 and 3 of the PA-10 paper: what they imply is recomputed, and is what the facts say to the last digit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import twin
from twin.core.errors import DescriptionError, TwinError
from twin.validation.masses import published_moments

FOLDER = Path(__file__).parents[2] / "cad/pa10"
FILE = FOLDER / "exhibit.toml"


@pytest.fixture(scope="module")
def exhibit():
    return published_moments.load(FILE)


@pytest.fixture(scope="module")
def recomputed(exhibit):
    return published_moments.recompute(exhibit)


@pytest.mark.parametrize(
    ("name", "slack", "printed", "negated"),
    [
        ("1", "0.0204", "10.604", "10.036"),
        ("2", "0.0144", "93.420", "9.801"),
        ("3", "0.0109", "6.318", "5.945"),
        ("4", "0.0077", "43.870", "4.906"),
        ("5", "0.0046", "2.697", "2.472"),
        ("6", "0.0013", "1.063", "0.452"),
        ("7", "4.9e-06", "0.087", "0.087"),
    ],
)
def test_every_row_has_the_slack_and_smallest_masses_of_the_facts(recomputed, name, slack, printed, negated):
    row = next(r for r in recomputed[0] if r.name == name)
    assert row.definite
    assert (f"{row.slack:.2g}" if name == "7" else f"{row.slack:.4f}") == slack
    assert (f"{row.mass_printed:.3f}", f"{row.mass_negated:.3f}") == (printed, negated)


def test_sums_of_the_smallest_masses(recomputed):
    rows = recomputed[0]
    assert f"{sum(r.mass_printed for r in rows):.2f}" == "158.06"
    assert f"{sum(r.mass_negated for r in rows):.2f}" == "33.70"


def test_the_products_are_negated_and_only_then_the_masses_fall(recomputed):
    rows, found = recomputed
    assert published_moments.convention(rows) == "negated"
    assert published_moments.masses_fall(rows, "negated")
    assert not published_moments.masses_fall(rows, "as printed")
    codes = [f.code for f in found]
    assert codes.count("inertia.repaired") == 12
    assert codes.count("inertia.products") == codes.count("inertia.composites") == 1
    assert "inertia.impossible" not in codes
    (products,) = [f for f in found if f.code == "inertia.products"]
    assert (products.severity, products.where) == ("disagreement", "2")
    assert (round(products.size, 2), round(products.limit, 2)) == (158.06, 33.70)


def test_repairs_name_what_is_printed_and_wrong_labels(recomputed):
    said = {f.where: f.message for f in recomputed[1] if f.code == "inertia.repaired"}
    assert set(said) == {f"{j}.{c}" for j, c in (
        (1, "xy"), (3, "xy"), (4, "xy"), (4, "xz"), (5, "mx"), (5, "xy"), (5, "xz"),
        (6, "mx"), (6, "xy"), (6, "xz"), (7, "mx"), (7, "xz"),
    )}  # fmt: skip
    assert "'Type 896572e-06'" in said["1.xy"]
    assert [k for k, text in said.items() if "label 'lyy'" in text] == ["6.xz", "7.xz"]


@pytest.mark.parametrize(
    ("printed", "value"),
    [
        ("-552544e-05", -5.52544e-05),
        ("Type 896572e-06", 8.96572e-06),
        ("34305E-08", 3.4305e-08),
        ("5.6E-12", 5.6e-12),  # its mark is there
        ("-0,017128284", -0.017128284),
    ],
)
def test_a_lost_mark_stands_after_the_first_digit(printed, value):
    assert published_moments.reread(printed) == value


@pytest.mark.parametrize("seed", range(5))
def test_the_smallest_mass_of_point_masses_is_not_above_theirs(seed):
    rng = np.random.default_rng(seed)
    m, p = rng.uniform(0.1, 2, 6), rng.normal(size=(6, 3))
    sigma = np.einsum("k,ki,kj->ij", m, p, p)
    J, h = np.trace(sigma) * np.eye(3) - sigma, m @ p
    least = published_moments.least_mass(J, h)
    assert 0 < least <= m.sum()
    # At the smallest mass the pseudo-inertia is singular; with less of it no body has these moments.
    for mass, sign in ((least * (1 + 1e-6), 1), (least * (1 - 1e-6), -1)):
        assert np.sign(np.linalg.eigvalsh(np.block([[sigma, h[:, None]], [h[None], mass]]))[0]) == sign


def test_a_tensor_that_no_body_has_is_told(exhibit):
    body = exhibit.body[0]
    flat = body.model_copy(update={"second": body.second.model_copy(update={"zz": 9.0})})
    rows, found = published_moments.recompute(exhibit.model_copy(update={"body": [flat]}))
    assert rows[0].slack < 0
    assert rows[0].mass_negated == np.inf
    assert "triangle" in next(f.message for f in found if f.code == "inertia.impossible")


def test_a_repair_must_follow_the_rule(tmp_path):
    text = FILE.read_text(encoding="utf-8").replace("xy = 1.24651e-05", "xy = 1.24651e-04")
    path = tmp_path / "exhibit.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DescriptionError, match=r"exhibit.toml:\d+: .*124651E-05"):
        published_moments.load(path)


def test_the_study_of_a_robot_is_that_of_its_folder(recomputed):
    rows, found = recomputed
    study = twin.study("pa10")
    assert (study.data["rows"], list(study.findings)) == ([r.as_dict() for r in rows], found)
    assert (study.verdict, study.exit_code) == ("disagree", 1)
    with pytest.raises(TwinError, match="lapbot has no study file and no published inertia tables"):
        twin.study("lapbot")


def test_equal_masses_in_another_order_tell_no_sign():
    """A running total of 0.1, 0.2 and 0.3 is larger than that of 0.3, 0.2 and 0.1, by rounding."""
    rows = []
    for printed, negated in ((0.1, 0.3), (0.2, 0.2), (0.3, 0.1)):
        row = published_moments.MassRow(
            "row", definite=True, slack=1.0, mass_printed=printed, mass_negated=negated, repaired=()
        )
        rows.append(row)
    assert published_moments.convention(rows) == "as printed"
