"""Many states over the joint range: compiled kernels find the doubtful ones, the reference model decides."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import twin
from made.arm import LINK, arm
from made.branches import RIGHT, THREE, TWO, WRONG
from made.processor_as_gpu import ProcessorAsGpu
from twin.api.judge import validate_samples
from twin.cli import main
from twin.codegen import kernel as kernel_module
from twin.core import gpu, spatial
from twin.core.errors import TwinError
from twin.kinematics import compile_formula
from twin.kinematics.closed_loops import LoopSolver
from twin.reference import ReferenceModel
from twin.robots import load_formula
from twin.validation import range_samples
from twin.validation.range_samples import RangeSamples, SampledRange
from twin.validation.rows import Tolerances


def judge_of(tmp_path, template, parts, mechanism=None) -> SampledRange:
    """Return the judge of a formula for a planar arm; `mechanism` is that of the reference model, if another one."""
    count = 2 if template is TWO else 3
    drawn = arm(count)
    path = tmp_path / "formula.py"
    path.write_text(template.format(link=LINK, error="pass", **parts))
    home = np.full(count, 0.3)
    driven = [(f"q{i}", True) for i in range(count)]
    start = ReferenceModel(drawn).solve(home)
    formula = load_formula(path, "arm", driven=lambda: (driven, start.T_base_tool, home))
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


def test_equations_without_a_result_are_told_with_a_state(tmp_path):
    parts = {"first": "atan2(y, x + 1e-30 * sqrt(x))", "second": "c - q[0]"}
    found = judged(judge_of(tmp_path, TWO, parts), 1000)
    assert [finding.code for finding in found.findings] == ["samples.no_answer"]
    assert found.findings[0].when.startswith("q0 = ")


def test_a_doubt_of_the_kernels_is_no_verdict(tmp_path, monkeypatch):
    """The kernels take all for wrong, the reference model none; where it has not judged all, nothing is claimed."""
    judge = judge_of(tmp_path, *RIGHT[0])
    wrong = np.ones(1000)
    monkeypatch.setattr(SampledRange, "_of_inverse", lambda self, q, Ts, states: (wrong[: len(q)], wrong[: len(q)]))
    few = judged(judge, 200)
    assert few.verdict == "agree"
    assert few.stages[0].suspects == few.stages[0].examined == 200
    many = judged(judge, 1000)
    assert many.verdict == "unchecked"
    assert [finding.code for finding in many.findings] == ["samples.undecided"]


def test_the_reference_judges_states_without_a_doubt_too(tmp_path):
    """Here, the compiled loops are those of an arm as the equations have it, and the reference's arm is longer."""
    drawn = arm(2)
    tool = replace(drawn.frames[0], T_body_frame=spatial.pose(p=[1.01 * LINK, 0, 0]))
    longer = replace(drawn, frames=(tool,))
    found = judged(judge_of(tmp_path, *RIGHT[0], mechanism=longer), 500)
    assert found.stages[0].suspects == 0
    assert found.verdict == "disagree"


def test_blocks_change_nothing(tmp_path, monkeypatch):
    judge = judge_of(tmp_path, THREE, WRONG["no sign of the elbow"][1])
    whole = judged(judge, 3000)
    monkeypatch.setattr(range_samples, "_BLOCK", 512)
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
    monkeypatch.setattr(kernel_module, "_MANY", 1)
    by_card = validate_samples("davinci_ecm", 3000, device="gpu")
    assert by_card.device == card.name
    assert by_processor.device == "processor"
    assert by_card.stages == by_processor.stages


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
    with pytest.raises(TwinError):
        twin.validate_samples(twin.load("sher"), 0)
