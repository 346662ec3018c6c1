"""The paper's user study against its own rows: what does not fit is found, not listed by hand."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from scipy import stats

from twin.cli import main
from twin.core.errors import DescriptionError
from twin.validation.study import load, recompute

FILE = Path(__file__).parents[2] / "trajectories/sher/study/insertion.toml"


@pytest.fixture(scope="module")
def recomputed():
    rows, findings = recompute(load(FILE))
    return {r.name: r for r in rows}, findings


@pytest.mark.parametrize(
    ("name", "paired", "welch", "student"),
    [
        ("completion time", 0.726, 0.686, 0.683),
        ("clutch presses", 0.174, 0.250, 0.242),
        ("path length", 0.998, 0.998, 0.998),
    ],
)
def test_p_values_of_the_five_rows(recomputed, name, paired, welch, student):
    tests = recomputed[0][name].tests
    assert tests["paired t"] == pytest.approx(paired, abs=6e-4)
    assert tests["Welch t"] == pytest.approx(welch, abs=6e-4)
    assert tests["Student t"] == pytest.approx(student, abs=6e-4)


@pytest.mark.parametrize(
    ("name", "population", "sample"),
    [
        ("mental demand", 0.206, 0.162),
        ("physical demand", 0.475, 0.426),
        ("temporal demand", 0.727, 0.697),
        ("performance", 0.907, 0.896),
        ("effort", 0.498, 0.450),
        ("frustration", 0.162, 0.123),
    ],
)
def test_questionnaire_is_reproduced_by_population_deviations(recomputed, name, population, sample):
    row = recomputed[0][name]
    assert row.tests["Student t, +- as population std"] == pytest.approx(population, abs=6e-4)
    assert row.tests["Student t, +- as sample std"] == pytest.approx(sample, abs=6e-4)
    assert row.test()


def test_a_p_that_would_be_printed_with_another_digit_does_not_agree(recomputed):
    """The cells give 0.998, printed as 1.00; by the rounding of all cells it is at least 0.997, and 0.99 is printed."""
    row = recomputed[0]["path length"]
    assert row.test() == ""
    assert min(p - row.reach[test] for test, p in row.tests.items() if p > 0.99) > 0.995
    assert row.reach["Mann-Whitney"] == 0.0
    (told,) = [f for f in recomputed[1] if f.code == "study.p" and f.where == "path length"]
    assert "p = 0.99 is printed" in told.message
    assert {f.where for f in recomputed[1] if f.code == "study.p"} == set(recomputed[0]) - REPRODUCED


REPRODUCED = {"mental demand", "physical demand", "temporal demand", "performance", "effort", "frustration"}


def test_the_rounding_of_cells_moves_p_by_its_slope(recomputed):
    """Student t of means 8.4 and 10.4; those of the deviations are of the same size."""
    row = recomputed[0]["mental demand"]
    name = "Student t, +- as population std"
    std = [x * (5 / 4) ** 0.5 for x in (1.85, 2.24)]
    p = [stats.ttest_ind_from_stats(8.4, std[0], 5, 10.4 + d, std[1], 5).pvalue for d in (-0.001, 0.001)]
    of_means = 2 * 0.005 * abs(p[1] - p[0]) / 0.002
    assert of_means < row.reach[name] < 3 * of_means
    assert row.test() == name


def test_the_row_of_all_users_is_not_the_mean_of_its_rows(recomputed):
    wrong = {(f.where, f.message.split(",")[1].split(":")[0].strip()) for f in recomputed[1] if f.code == "study.mean"}
    assert ("path length", "physical") in wrong
    assert ("clutch presses", "simulation") in wrong
    assert ("completion time", "physical") not in wrong  # 41.622 rounds to what is printed
    assert ("clutch presses", "physical") not in wrong


def test_claims_of_the_prose_are_checked(recomputed):
    claims = [f.message for f in recomputed[1] if f.code == "study.claim"]
    assert any("is false for physical demand" in c for c in claims)
    assert any("the sign should be >=" in c for c in claims)


def test_a_table_that_is_not_utf8_says_how_to_save_it(tmp_path, capsys):
    (tmp_path / "latin.csv").write_bytes(b"group,time_s\nexp\xe9rt,3\n")
    assert main(["study", str(tmp_path / "latin.csv")]) == 2
    assert "latin.csv: not UTF-8 text at byte 16; save the file as UTF-8" in capsys.readouterr().err


def test_a_study_that_fits_agrees(tmp_path, capsys):
    """Rows whose printed means and p follow from them: nothing is said."""
    file = tmp_path / "fits.toml"
    file.write_text(
        'title = "t"\nsource = "s"\nusers = 3\n[[measure]]\nname = "time"\nunit = "s"\nphysical = [1.0, 2.0, 3.0]\n'
        "simulation = [2.0, 3.0, 5.0]\nprinted_mean = [2.0, 3.33]\nprinted_p = 0.06\n"
    )
    assert main(["study", str(file)]) == 0
    printed = capsys.readouterr().out
    assert "paired t" in printed
    assert printed.splitlines()[0].endswith("are consistent (exit code 0)")


def test_groups_without_any_difference_have_p_1(tmp_path):
    """Mean and deviation of a rating that all users gave alike: t is 0 / 0."""
    file = tmp_path / "alike.toml"
    file.write_text(
        'title = "t"\nsource = "s"\nusers = 5\n[[rating]]\nname = "effort"\nphysical = [5.0, 0.0]\n'
        "simulation = [5.0, 0.0]\nprinted_p = 1.0\n"
    )
    (row,), findings = recompute(load(file))
    assert set(row.tests.values()) == {1.0}
    assert not findings


def test_the_exact_test_of_ranks_is_a_usual_one(tmp_path):
    """U = 8 of 5 and 5 users: exact p = 0.42, as R prints it; the normal approximation gives 0.40."""
    file = tmp_path / "exact.toml"
    file.write_text(
        'title = "t"\nsource = "s"\nusers = 5\n[[measure]]\nname = "time"\nunit = "s"\n'
        "physical = [1.0, 2.0, 3.0, 8.0, 9.0]\nsimulation = [4.0, 5.0, 6.0, 7.0, 90.0]\nprinted_mean = [4.6, 22.4]\n"
        "printed_p = 0.42\n"
    )
    (row,), findings = recompute(load(file))
    assert row.test() == "Mann-Whitney, exact"
    assert not findings


def test_command(capsys):
    assert main(["study", "sher"]) == 1
    printed = capsys.readouterr().out
    assert "agrees with the printed p" in printed
    verdict, way = (line.strip() for line in printed.splitlines()[:2])
    assert main(["study", "sher", "--json"]) == 1
    data = json.loads(capsys.readouterr().out)
    assert data["verdict"] == "disagree"
    wrong = sum(f["severity"] == "disagreement" for f in data["findings"])
    assert verdict.startswith(f"DISAGREE: {wrong} inconsistencies in the printed means, p-values and claims")
    assert verdict.endswith("(exit code 1)")
    assert way == f"WHAT TO DO: {data['what_to_do']}"
    assert len(data["studies"][0]["rows"]) == 9


def test_inertia_tables_begin_with_a_verdict(capsys):
    assert main(["study", "pa10"]) == 1
    verdict, way = (line.strip() for line in capsys.readouterr().out.splitlines()[:2])
    assert verdict.startswith("DISAGREE: 1 inconsistency in the printed masses and inertias")
    assert way.startswith("WHAT TO DO: ")


def test_bad_files_are_told_with_their_line(tmp_path, capsys):
    file = tmp_path / "bad.toml"
    file.write_text(FILE.read_text().replace("[46.65, 38.11, 40.92, 36.80, 45.63]", "[46.65, 38.11]"))
    with pytest.raises(DescriptionError, match=r"bad\.toml:\d+.*5 values, but `physical` has 2; give one per user"):
        load(file)
    file.write_text(FILE.read_text().replace("physical = [8.4, 1.85]", "physical = [8.4, -1.85]"))
    with pytest.raises(DescriptionError, match=r"bad\.toml:33: rating.*out of range"):
        load(file)
    assert main(["study", "sils"]) == 2
    assert "sils has no study file and no published inertia tables" in capsys.readouterr().err
