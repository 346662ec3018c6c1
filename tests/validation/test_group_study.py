"""Tables of independent groups: what cannot follow is found, what can is left alone; groups of one's own by ranks."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twin.api.published_tables import study
from twin.cli import main
from twin.core.errors import DescriptionError, TwinError
from twin.core.units import MM
from twin.simulation.controllers.console_equations import READINGS, console
from twin.validation import simulated_accuracy
from twin.validation.group_study import check_tables, smallest_std
from twin.validation.group_tables import load
from twin.validation.rank_tests import compare

FILE = Path(__file__).parents[2] / "trajectories/davinci/study/console.toml"


def ideal(chain):
    """An accuracy chain without error."""
    return {"largest_error_mm": 0.05, "largest_error_unquantised_mm": 0.0}, [0.0225] * 3


def ideal_turn(chain):
    """An accuracy chain with rotations without error."""
    return {"largest_error_deg": 0.08, "largest_error_unquantised_deg": 0.0}, [0.0225] * 3


@pytest.fixture(scope="module")
def found():
    return check_tables(load(FILE), ideal, ideal_turn)


def of(found, code):
    return [f for f in found.findings if f.code == code]


def test_every_mean_of_integers_follows_from_the_users_that_were_counted(found):
    assert not of(found, "study.integers")


def test_the_users_that_were_enrolled_do_not_give_the_means(tmp_path):
    """23 controls were enrolled, 22 went to the end: the print itself tells which were counted."""
    file = tmp_path / "all.toml"
    file.write_text(FILE.read_text().replace("users = 22", "users = 23"))
    assert {f.where for f in of(check_tables(load(file), ideal, ideal_turn), "study.integers")} >= {"attractiveness"}


def test_rmse_has_no_reading_for_the_angles(found):
    (only,) = of(found, "study.rmse")
    assert only.where == "err_ang"
    first = found.data["accuracy"][0]["readings"]
    assert first["root mean square of the axes"] == pytest.approx([0.0365, 0.0365], abs=8e-4)
    assert first["length of the vector"] == pytest.approx([0.0633, 0.0633], abs=1.2e-3)
    assert first["worst axis"] == pytest.approx([0.0441, 0.0441], abs=7e-4)


def test_ranges_claims_and_corrections(found):
    (age,) = of(found, "study.range")
    assert (age.where, age.size) == ("age", pytest.approx(11.14, abs=0.01))
    assert "NO RS" in age.message
    assert len(of(found, "study.range_repeated")) == len(of(found, "study.twice")) == 1
    (claim,) = of(found, "study.claim")
    assert "1.423" in claim.message
    assert "1.417" in claim.message
    (holm,) = of(found, "study.multiple")
    assert "0 of 5" in holm.message
    assert holm.size == pytest.approx(12 * 0.0185)


def test_the_pen_alone_does_not_explain_the_largest_axis(found):
    (only,) = of(found, "study.quantised")
    assert "z 0.043" in only.message
    assert "x" not in only.message.split("the paper prints")[1]


@settings(max_examples=200, deadline=None)
@given(st.lists(st.floats(-100, 100), min_size=3, max_size=20))
def test_no_values_deviate_less_than_the_smallest(values):
    x = np.array(values)
    assert smallest_std(x.mean(), x.min(), x.max(), len(x)) <= x.std() + 1e-9


SMALL = """
title = "t"
source = "s"
printed_test = "rank"
group = [{ name = "A", users = 4 }, { name = "B", users = 5 }]
[[outcome]]
name = "errors"
unit = "errors"
decimals = 2
items = 1
mean = { A = 1.25, B = 1.40 }
std = { A = 1.0, B = 1.0 }
compared = [{ between = ["A", "B"], printed_p = 0.01 }]
[[accuracy]]
name = "lin"
unit = "mm"
mean = [0.0, 0.0, 0.0]
std = [0.03, 0.03, 0.02]
rmse = 0.05
decimals = 2
[[range]]
name = "age"
unit = "years"
mean = { A = 40.0, B = 45.0 }
std = { A = 9.0, B = 20.0 }
lower = { A = 30, B = 20 }
upper = { A = 50, B = 70 }
[chain]
displacements = 12
resolution_mm = 0.055
required_mm = 1.0
of = "lin"
[[claim]]
text = "all above 1"
outcomes = ["errors"]
above = 1.0
[[twice]]
name = "scale"
where = ["here", "there"]
values = [[0, 1], [0, 1]]
"""


def small(tmp_path, *change):
    file = tmp_path / "small.toml"
    text = SMALL
    for old, new in change:
        assert old in text
        text = text.replace(old, new)
    file.write_text(text)
    return check_tables(load(file), ideal, ideal_turn)


def test_the_prices_of_the_console_give_its_cost_only_if_they_are_for_pairs(found):
    """By hand: 400 + 5000 + 1600 + 350 + 1000 = 8350, within 50 of 8400; with two pens and grippers, 14950."""
    (finding,) = of(found, "study.sum")
    assert finding.severity == "warning"
    assert "8,350 USD if each is counted once, and 14,950 USD with 2 × Geomagic Touch and 2 × Twee stylus" in str(
        finding
    )


PRICES = """
[[sum]]
name = "cost"
unit = "USD"
printed = 250
rounded_to = 10
part = [{ name = "pen", price = 100, pieces = 2 }, { name = "cart", price = 50, pieces = 1 }]
"""


@pytest.mark.parametrize(("printed", "severities"), [(250, []), (254, []), (150, ["warning"]), (300, ["disagreement"])])
def test_a_sum_of_prices_is_counted_with_and_without_the_pieces(printed, severities, tmp_path):
    text = PRICES.replace("printed = 250", f"printed = {printed}")
    changed = small(tmp_path, ("[chain]", f"{text}[chain]"))
    assert [f.severity for f in of(changed, "study.sum")] == severities


@pytest.mark.parametrize(("std", "severities"), [(0.02, ["info"]), (0.05, ["warning"])])
def test_a_gimbal_explains_the_printed_angles_or_not(std, severities, tmp_path):
    chain = '[angle_chain]\nrotations = 12\nresolution_deg = 0.06\nprovenance = "ASSUMED"\nnote = "-"\nof = "lin"\n'
    changed = small(tmp_path, ("[chain]", f"{chain}[chain]"), ("std = [0.03, 0.03", f"std = [{std}, 0.02"))
    assert [f.severity for f in changed.findings if "gimbal" in f.message] == severities


@pytest.mark.slow
def test_rotations_without_quantisation_are_exact_and_a_gimbal_adds_its_rounding():
    """Two rounded angles about one axis differ by a triangular error: r sqrt(2/12), as for positions."""
    from twin.simulation.controllers.console_equations import console

    fine, _ = simulated_accuracy.measure_angles(console(), 4, 1e-12)
    assert fine["largest_error_unquantised_deg"] < 1e-9
    data, stds = simulated_accuracy.measure_angles(console(), 12, np.radians(0.06))
    # the yaw of the gimbal is about z: its error is the rounding of one angle; the others add parts of it
    assert min(stds) > 0.5 * 0.06 * np.sqrt(2 / 12)
    assert max(stds) < 2.0 * 0.06 * np.sqrt(2 / 12)
    assert data["resolution_deg"] == pytest.approx(0.06)


def test_a_study_that_fits_has_nothing_but_what_is_unpublished(tmp_path):
    assert [f.code for f in small(tmp_path).findings] == ["study.raw"]


@pytest.mark.parametrize(
    ("code", "old", "new"),
    [
        ("study.integers", "A = 1.25", "A = 1.30"),
        ("study.rmse", "rmse = 0.05", "rmse = 0.09"),
        ("study.range", "A = 9.0", "A = 3.0"),
        ("study.range_repeated", "A = 30, B = 20 }\nupper = { A = 50", "A = 20, B = 20 }\nupper = { A = 70"),
        ("study.multiple", "printed_p = 0.01 }", 'printed_p = 0.04 }, { between = ["B", "A"] }'),
        ("study.claim", "above = 1.0", "above = 1.3"),
        ("study.twice", "[0, 1]]", "[0, 2]]"),
        ("study.quantised", "std = [0.03, 0.03", "std = [0.03, 0.09"),
    ],
)
def test_what_cannot_follow_is_found(code, old, new, tmp_path):
    assert code in {f.code for f in small(tmp_path, (old, new)).findings}


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("mean = { A = 1.25, B = 1.40 }", "mean = { A = 1.25 }", "give one number for each group: A, B"),
        ('["A", "B"], printed', '["A", "C"], printed', "groups are A, B"),
        ('outcomes = ["errors"]', 'outcomes = ["time"]', "there is no outcome 'time'"),
        ('where = ["here", "there"]', 'where = ["here"]', "give one list of values for each place: 1 place, 2 lists"),
        ("std = { A = 1.0", "std = { A = -1.0", "out of range"),
        ("std = { A = 1.0", "std = { A = 1e200", "out of range"),
        ("mean = { A = 1.25", "mean = { A = -1e308", "out of range"),
        ("upper = { A = 50", "upper = { A = 1e200", "out of range"),
        ("std = [0.03, 0.03, 0.02]", "std = [0.03, -0.03, 0.02]", "out of range"),
        ("upper = { A = 50", "upper = { A = 20", "A: the range ends below its beginning"),
        ('of = "lin"', 'of = "ang"', r"no \[\[accuracy\]\] section has the name 'ang'; the names are lin"),
    ],
)
def test_bad_files_are_told_with_their_line(old, new, said, tmp_path):
    with pytest.raises(DescriptionError, match=rf"small\.toml:\d+.*{said}"):
        small(tmp_path, (old, new))


def test_a_file_of_many_nested_lists_is_refused(tmp_path):
    file = tmp_path / "deep.toml"
    file.write_text("a = " + 3000 * "[" + 3000 * "]")
    with pytest.raises(TwinError, match=r"deep\.toml: depth of the brackets"):
        study(file)


# -- the accuracy chain ---------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def chain():
    return simulated_accuracy.measure(console(), 12, 0.055 * MM)


def test_quantised_pens_give_the_predicted_deviation(chain):
    data, std = chain
    assert data["predicted_std_mm"] == pytest.approx(0.02245, abs=1e-5)
    assert std == pytest.approx([0.0225] * 3, rel=0.05)
    assert data["rms_3d_mm"] == pytest.approx(0.0389, rel=0.03)


def test_without_quantisation_the_chain_is_exact(chain):
    assert chain[0]["largest_error_unquantised_mm"] * MM < 1e-9


def test_a_wrong_chain_is_seen(monkeypatch):
    """The printed equations fail the very test that the paper makes of them with eq. (7)."""
    monkeypatch.setattr(simulated_accuracy, "_REPEATS", 1)
    data, _ = simulated_accuracy.measure(console(READINGS["paper"]), 12, 0.055 * MM)
    assert data["largest_error_unquantised_mm"] > 100


# -- one's own users ------------------------------------------------------------------------------------------------


def users(tmp_path, text):
    file = tmp_path / "users.csv"
    file.write_text(text)
    return file


def test_ranks_against_counting(tmp_path):
    """Without ties, U counts pairs, and the exact p is a part of all orders."""
    (c,) = compare(
        users(tmp_path, "group,time\n" + "".join(f"A,{x}\n" for x in (1, 2, 3, 4)) + "B,5\nB,6\nB,7\nB,8\n")
    ).comparisons
    assert (c.u, c.effect, c.p) == (0.0, -1.0, pytest.approx(2 / 70))


def test_holm_multiplies_the_smallest_most(tmp_path):
    rng = np.random.default_rng(3)
    lines = [f"{g},{rng.normal(m):.6f},{rng.normal():.6f}" for g, m in (("A", 0), ("B", 2), ("C", 4)) for _ in range(8)]
    found = compare(users(tmp_path, "group,time,errors\n" + "\n".join(lines))).comparisons
    assert len(found) == 6
    ordered = sorted(found, key=lambda c: c.p)
    assert ordered[0].holm == pytest.approx(min(1, 6 * ordered[0].p))
    assert all(a.holm <= b.holm for a, b in pairwise(ordered))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("who,time\nA,1\n", r"users\.csv:1: the header needs a column 'group'"),
        ("group,time\nA,1\nB,fast\n", r"users\.csv:3: time is 'fast'"),
        ("group,time\nA,1\nB,inf\n", r"users\.csv:3: time is 'inf'"),
        ("group,time\nA,1,2\n", r"users\.csv:2: 3 cells; the header has 2"),
        ("group,time\nA,1\nA,2\n", "nothing to compare"),
        ("", "the header needs"),
    ],
)
def test_bad_rows_are_told_with_their_line(text, said, tmp_path):
    with pytest.raises(DescriptionError, match=said):
        compare(users(tmp_path, text))


def test_commands(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(simulated_accuracy, "_REPEATS", 3)
    assert main(["study", "davinci", "--json"]) == 1
    data = json.loads(capsys.readouterr().out)
    assert {c["between"][1] for c in data["studies"][0]["comparisons"]} == {"RS"}
    file = users(tmp_path, "group,time\nA,1\nA,2\nB,3\nB,\n")
    assert main(["study", str(file)]) == 0
    out = capsys.readouterr().out
    assert "Wilcoxon-Mann-Whitney" in out
    assert "2 and 1 users" in out
    assert main(["study", str(tmp_path / "missing.csv")]) == 2
    assert "cannot be read" in capsys.readouterr().err
