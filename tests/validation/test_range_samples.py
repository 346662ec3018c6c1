"""Many states over the joint range: compiled kernels find the doubtful ones, the reference model decides."""

from __future__ import annotations

import json
from dataclasses import replace

import casadi
import numpy as np
import pytest

import twin
from made import own_robot
from made.arm import LINK, arm
from made.branches import RIGHT, THREE, TWO, WRONG
from made.formulas import with_reach
from made.processor_as_gpu import ProcessorAsGpu
from twin.api.equation_checks import validate_samples
from twin.cli import main
from twin.codegen import kernel as kernel_module
from twin.core import gpu, spatial
from twin.core.errors import TwinError
from twin.kinematics import compile_formula
from twin.kinematics.closed_loops import LoopSolver
from twin.reference import ReferenceModel
from twin.robots import load_formula
from twin.validation import range_samples
from twin.validation.range_samples import SampledRange, SuspectReservoir, _StageTally
from twin.validation.range_samples_result import RangeSamples
from twin.validation.residual_rows import Tolerances


def judge_of(tmp_path, template, parts, mechanism=None, reach=None) -> SampledRange:
    """Return the judge of a formula for a planar arm.

    `mechanism` is that of the reference model, if another one; `reach` are functions from tool pose to margin by row.
    """
    count = 2 if template is TWO else 3
    drawn = arm(count)
    path = tmp_path / "formula.py"
    path.write_text(template.format(link=LINK, error="pass", **parts))
    home = np.full(count, 0.3)
    driven = [(f"q{i}", True) for i in range(count)]
    start = ReferenceModel(drawn).solve(home)
    formula = load_formula(path, "arm", driven=lambda: (driven, start.T_base_tool, home))
    if reach:
        formula = with_reach(formula, reach)
    model = ReferenceModel(mechanism or drawn)
    return SampledRange("arm", compile_formula(formula), LoopSolver(drawn), None, model, Tolerances())


def judged(judge: SampledRange, samples: int) -> RangeSamples:
    return judge.judge(samples, lambda label, fraction: None)


@pytest.mark.parametrize(("template", "parts"), RIGHT)
def test_right_equations_agree(tmp_path, template, parts):
    found = judged(judge_of(tmp_path, template, parts), 3000)
    assert found.verdict == "agree"
    assert found.possible == 3000
    assert found.confirmed == 64
    (stage,) = found.stages
    assert stage.suspects == 0
    assert stage.position is not None
    assert stage.position < 1e-12


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_branch_is_found_and_judged_by_the_reference(tmp_path, name):
    template, parts, share = WRONG[name]
    found = judged(judge_of(tmp_path, template, parts), 4000)
    assert found.verdict == "disagree"
    (stage,) = found.stages
    assert stage.suspects == pytest.approx(share * 4000, rel=0.1)
    assert stage.examined == 256
    assert stage.wrong + stage.missing == 256
    assert stage.by_reference == 256 + 64
    for finding in found.findings:
        assert f"the compiled kernels suspect {stage.suspects} of 4000 states" in finding.message
        assert finding.code == "samples.no_answer" or "the largest error of those judged: " in finding.message


def test_equations_without_a_result_are_told_with_a_state(tmp_path):
    parts = {"first": "atan2(y, x + 1e-30 * sqrt(x))", "second": "c - q[0]"}
    found = judged(judge_of(tmp_path, TWO, parts), 1000)
    assert [finding.code for finding in found.findings] == ["samples.no_answer"]
    assert found.findings[0].when.startswith("q0 = ")


def test_a_doubt_of_the_kernels_is_no_verdict(tmp_path, monkeypatch):
    """The kernels take all for wrong, the reference model none; where it has not judged all, nothing is claimed."""
    judge = judge_of(tmp_path, *RIGHT[0])
    wrong = np.ones(1000)
    monkeypatch.setattr(SampledRange, "_inverse_errors", lambda self, q, Ts, states: (wrong[: len(q)], wrong[: len(q)]))
    few = judged(judge, 200)
    assert few.verdict == "agree"
    assert few.stages[0].suspects == few.stages[0].examined == 200
    many = judged(judge, 1000)
    assert many.verdict == "unchecked"
    assert [finding.code for finding in many.findings] == ["samples.undecided"]
    (stage,) = many.stages
    wrong_too = replace(stage, name="forward", wrong=1, worst=(1.0, 0.0, np.zeros(2)))
    assert replace(many, stages=(stage, wrong_too)).verdict == "disagree"


def test_the_reference_judges_states_without_a_doubt_too(tmp_path):
    """Here, the compiled loops are those of an arm as the equations have it, and the reference's arm is longer."""
    drawn = arm(2)
    tool = replace(drawn.frames[0], T_body_frame=spatial.pose(p=[1.01 * LINK, 0, 0]))
    longer = replace(drawn, frames=(tool,))
    found = judged(judge_of(tmp_path, *RIGHT[0], mechanism=longer), 500)
    assert found.stages[0].suspects == 0
    assert found.verdict == "disagree"


def test_what_the_reference_cannot_judge_is_not_claimed(tmp_path, monkeypatch):
    judge = judge_of(tmp_path, *RIGHT[0])
    monkeypatch.setattr(SampledRange, "_judged_by_reference", lambda self, closing, q: None)
    found = judged(judge, 50)
    assert (found.unsuspected, found.confirmed) == (50, 0)
    assert found.verdict == "unchecked"
    (finding,) = found.findings
    assert finding.code == "samples.undecided"
    assert "could judge only 0 of 50 states" in finding.message


def test_a_margin_without_a_value_excludes_no_state(tmp_path):
    """The arm can take the states at which y is negative, and the equations are right there."""
    found = judged(judge_of(tmp_path, *RIGHT[0], reach={"upper": lambda T: casadi.sqrt(T[1, 3])}), 3000)
    assert found.beyond == 0
    assert found.verdict == "disagree"
    inverse, reach = found.stages
    assert inverse.suspects == 0
    assert inverse.judged == 3000
    assert reach.suspects == pytest.approx(1500, rel=0.1)
    assert reach.missing == reach.examined == 256
    (finding,) = found.findings
    assert finding.code == "samples.no_margin"
    assert "the row 'upper' of reach has no value at 256 of 320 states" in finding.message
    assert "reach, upper" in "".join(str(part) for part in found.text())


def test_a_margin_may_have_no_value_where_another_is_negative(tmp_path):
    rows = {"upper": lambda T: casadi.sqrt(T[1, 3]), "above": lambda T: T[1, 3]}
    found = judged(judge_of(tmp_path, *RIGHT[0], reach=rows), 3000)
    assert found.verdict == "agree"
    assert found.beyond == pytest.approx(1500, rel=0.1)
    assert [stage.name for stage in found.stages] == ["inverse"]


def test_whether_the_orientation_is_read_is_decided_once(tmp_path, monkeypatch):
    asked = []
    decide = range_samples.reads_orientation
    monkeypatch.setattr(range_samples, "reads_orientation", lambda *given: asked.append(0) or decide(*given))
    monkeypatch.setattr(range_samples, "_BLOCK_STATES", 512)
    assert judged(judge_of(tmp_path, *RIGHT[4]), 3000).verdict == "agree"
    assert len(asked) == 1


def test_the_worst_of_the_kernels_is_relative_to_the_tolerances():
    """A turn of 1 rad is worse than an offset of 1 µm, although only the second state has an offset."""
    tally = _StageTally()
    tally.add(np.array([[1.0], [2.0]]), np.array([0.0, 1e-6]), np.array([1.0, 0.0]), Tolerances())
    assert tally.worst is not None
    assert tally.worst.q == [1.0]
    assert tally.position is None


def test_kept_suspects_are_spread_over_all():
    """Given in blocks, as at once; a suspect without a result is no worst one."""
    q = np.arange(5000.0)[:, None]
    reservoir = SuspectReservoir()
    tally = _StageTally()
    for block in np.array_split(q, 7):
        reservoir.add(block)
        missing = np.full(len(block), np.nan)
        assert tally.add(block, missing, missing, Tolerances()).all()
    chosen = reservoir.chosen()
    assert reservoir.found == 5000
    assert chosen is not None
    assert len(chosen) == 256
    assert chosen[0] == 0
    assert chosen[-1] > 4900
    assert np.diff(chosen[:, 0]).max() < 2 * 5000 / 256
    assert tally.worst is None
    assert np.array_equal(tally.examined(1), chosen)


def test_blocks_change_nothing(tmp_path, monkeypatch):
    judge = judge_of(tmp_path, THREE, WRONG["no sign of the elbow"][1])
    whole = judged(judge, 3000)
    monkeypatch.setattr(range_samples, "_BLOCK_STATES", 512)
    parts = judged(judge, 3000)
    assert parts.content() == whole.content()
    assert [finding.message for finding in parts.findings] == [finding.message for finding in whole.findings]


def test_loops_are_judged_on_lines_from_the_rest_poses():
    found = validate_samples("hibou", 2000)
    assert found.verdict == "agree"
    assert found.on_lines
    assert 400 < found.possible < 2000
    assert [stage.name for stage in found.stages] == ["inverse", "forward"]


def test_the_device_is_named_and_answers_alike(monkeypatch):
    by_processor = validate_samples("davinci_ecm", 3000)
    card = ProcessorAsGpu()
    monkeypatch.setattr(gpu, "found", lambda: (card, ""))
    monkeypatch.setattr(kernel_module, "_FEWEST_GPU_SAMPLES", 1)
    by_card = validate_samples("davinci_ecm", 3000, device="gpu")
    assert by_card.device == card.name
    assert by_processor.device == "processor"
    assert by_card.stages == by_processor.stages


def test_the_command_tells_findings_and_verdict(tmp_path, capsys):
    options = ["--samples", "500", "--variant", "eq1=printed", "--out", str(tmp_path)]
    assert main(["validate", "sils", *options]) == 1
    out = capsys.readouterr().out
    assert "over the joint range, the inverse equations are wrong at" in out
    assert "DISAGREE: the equations are wrong" in out
    cells = next(line for line in out.splitlines() if line.startswith("  inverse ")).split()
    assert cells[2] == "-"  # no state is without a suspicion, so that there is no largest error
    assert cells[1] == cells[3]


def test_the_command_takes_the_device_of_the_environment(tmp_path, capsys, monkeypatch):
    card = ProcessorAsGpu()
    monkeypatch.setattr(gpu, "found", lambda: (card, ""))
    monkeypatch.setattr(kernel_module, "_FEWEST_GPU_SAMPLES", 1)
    command = ["validate", "davinci_ecm", "--samples", "100", "--json", "--out", str(tmp_path)]
    for choice, device in (("cpu", "processor"), ("gpu", card.name)):
        monkeypatch.setenv("TWIN_DEVICE", choice)
        assert main(command) == 0
        assert json.loads(capsys.readouterr().out)["device"] == device


def test_the_command_writes_a_result(tmp_path, capsys):
    assert main(["validate", "davinci_ecm", "--samples", "2e3", "--json", "--out", str(tmp_path)]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["schema"] == "twin/samples/1"
    assert result["samples"] == 2000
    assert result["device"] == "processor"
    assert (tmp_path / "samples/samples.html").is_file()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--samples", "100", "--sweep"], "--sweep and --samples cannot be combined"),
        (["--samples", "100", "--prove"], "--prove and --samples cannot be combined"),
        (["--samples", "0"], "--samples 0: give at least 1"),
        (["--device", "gpu"], "--device applies to --samples N"),
    ],
)
def test_options_without_effect_are_refused(options, said, capsys):
    assert main(["validate", "sher", *options]) == 2
    assert said in capsys.readouterr().err


def test_a_robot_without_equations_is_refused(tmp_path):
    folder = own_robot.folder(tmp_path)
    (folder / "formula.py").unlink()
    with pytest.raises(TwinError, match="formula"):
        twin.validate_samples(folder, 10)


def test_less_than_one_sample_is_refused():
    with pytest.raises(TwinError, match="samples = 0: give at least 1"):
        twin.validate_samples("sher", 0)
