"""The closing joints that a workspace certificate states: derivatives, displaced frames, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.stated_closures import stated_closures
from twin.exchange.audit.workspace_certificate import audit_workspace

FRAME = np.eye(4)[:3].tolist()
RAISED = [[1.0, 0.0, 0.0, 0.1], [0.0, 0.0, -1.0, 0.2], [0.0, 1.0, 0.0, 0.3]]


def hinge_and_slide() -> dict:
    """A tool on a slide, on a hinge: the certificate of its two joints, which one closing joint determines."""
    steps = [["frame", RAISED], ["turn", 0, 1], ["inverse", FRAME], ["frame", RAISED], ["slide", 1, -1]]
    paths = [{"from_tool": True, "steps": [["frame", RAISED]]}, {"from_tool": False, "steps": steps}]
    closure = {"name": "c", "type": "spherical", "cone": 0.5, "paths": paths}
    return {"joints": ["hinge", "slide"], "active": [True, True], "closures": [closure]}


def poses(count: int) -> np.ndarray:
    return np.tile(np.eye(4, dtype=complex), (count, 1, 1))


def test_derivatives_are_those_of_differences():
    closures = stated_closures(hinge_and_slide())
    x = np.array([[0.3, 0.2], [-1.0, 0.5]], complex)
    conditions, cosines = closures.conditions(x, poses(2))
    assert conditions.shape == (2, 3)
    assert cosines[0].minimum == pytest.approx(np.cos(0.5))
    step = 1e-7
    for joint in range(2):
        moved = x.copy()
        moved[:, joint] += step
        difference = (closures.conditions(moved, poses(2))[0] - conditions).real / step
        assert np.allclose(closures.by_joints(x, poses(2), [joint])[..., 0], difference, atol=1e-6)
    shifted = poses(2)
    shifted[:, 1, 3] += step
    difference = (closures.conditions(x, shifted)[0] - conditions).real / step
    assert np.allclose(closures.by_tool(x, poses(2))[..., 1], difference, atol=1e-6)
    assert closures.by_joints(x, poses(2), []).shape == (2, 3, 0)


def test_equal_frames_are_displaced_equally_and_the_tool_is_not():
    closures = stated_closures(hinge_and_slide())
    displaced = closures.displaced(1e-3, 5, np.random.default_rng(0)).closures[0]
    first, *_ = displaced.first.steps
    assert first.frame.shape == (4, 4)  # of the tool
    frames = [step.frame for step in displaced.second.steps if step.kind == "frame"]
    assert frames[0].shape == (5, 4, 4)
    assert np.array_equal(frames[0], frames[1])
    assert 0 < np.abs(frames[0][:, :3, 3] - np.array(RAISED)[:, 3]).max() <= 1e-3
    # 4 constant frames on the two paths
    assert closures.largest_redundant_gap(1e-3) == pytest.approx(4 * np.sqrt(3) * 1e-3)


def without_type(data):
    data["closures"][0]["type"] = "loose"


def negative_joint(data):
    data["closures"][0]["paths"][1]["steps"][1][1] = -1


def unknown_step(data):
    data["closures"][0]["paths"][1]["steps"][1][0] = "jump"


@pytest.mark.parametrize("change", [without_type, negative_joint, unknown_step])
def test_a_closing_joint_that_is_none_is_refused(change):
    """Otherwise it would be judged by fewer conditions, or at another joint, than the certificate states."""
    data = hinge_and_slide()
    change(data)
    with pytest.raises(ValueError, match=r"joint|step"):
        stated_closures(data)


def test_rows_of_joints_have_the_units_of_both_kinds_of_joints():
    """One row is of all joints: a prediction of a slide is not in degrees."""
    steps = [["slide", 0, 1]]
    paths = [{"from_tool": True, "steps": [["frame", FRAME]]}, {"from_tool": False, "steps": steps}]
    data = {
        "joints": ["slide"],
        "active": [True],
        "orientation": np.eye(3).tolist(),
        "boxes": [[[-1e-3] * 3, [1e-3] * 3, [0.0]]],
        "closures": [{"type": "spherical", "cone": None, "paths": paths}],
        "limits": [],
        "tolerance_m": 0.0,
    }
    ledger = Ledger("c.json")
    audit_workspace(data, ledger)
    units = {check.where: check.unit for check in ledger.checks}
    assert units == {"loops": "m or 1", "predictions": "m or rad", "limits": "m or rad", "cones": "", "derivatives": ""}
