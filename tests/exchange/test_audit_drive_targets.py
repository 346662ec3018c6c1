"""The targets of the drives of a USD stage hold the robot where the stage shows it."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdPhysics

import twin
from made.lanes import robots
from twin.core import assets
from twin.exchange.audit.file_drives import FileDrive
from twin.exchange.audit.file_joints import FileJoint
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.mechanism_data import FileMass, FileMechanism
from twin.exchange.audit.motion_lines import JointLine
from twin.exchange.formats.usd.audit import read_usd
from twin.exchange.formats.usd.audit.drive_targets import check_drive_targets

STAGES = assets.data_folder() / "usd"


def told(file: Path) -> list[str]:
    """Return the joints whose drive targets are reported."""
    ledger = Ledger(file.name)
    read_usd(file, ledger)
    found = [finding.where for finding in ledger.found if finding.code.startswith("usd.drive_target")]
    return [where.rpartition(": ")[2] for where in found]


@pytest.fixture
def sher(tmp_path: Path) -> Path:
    return Path(shutil.copytree(STAGES / "sher", tmp_path / "usd")) / "sher.usda"


def spoilt(file: Path, joint: str, **changed: float) -> Path:
    """Change attributes of the drive of a joint, in the units of the stage."""
    layer = Sdf.Layer.FindOrOpen(str(file.parent / "physics.usda"))
    assert layer is not None
    stage = Usd.Stage.Open(layer)
    prim = next(p for p in stage.Traverse() if p.GetName() == joint)
    token = "angular" if prim.IsA(UsdPhysics.RevoluteJoint) else "linear"
    drive = UsdPhysics.DriveAPI(prim, token)
    for name, by in changed.items():
        attribute = getattr(drive, f"Create{name}Attr")()
        attribute.Set((attribute.Get() or 0.0) + by)
    layer.Save()
    return file


@pytest.mark.parametrize("name", robots(["sher"], slow=("sils", "lapbot")))
def test_the_targets_of_a_stage_hold_its_robot(name: str) -> None:
    stages = sorted(file for file in (STAGES / name).glob("*.usda") if file.name != "physics.usda")
    assert stages
    assert [told(file) for file in stages] == [[]] * len(stages)


@pytest.mark.parametrize(
    ("joint", "changed"),
    [
        ("q4", {"TargetPosition": 0.02}),  # deg
        ("q1", {"TargetPosition": 0.0002}),  # m
        ("q4", {"TargetPosition": 360.0}),
        ("q2", {"TargetVelocity": 0.001}),
        ("q5", {"TargetVelocity": -2.0}),
    ],
)
def test_a_target_elsewhere_is_reported_at_its_joint(sher: Path, joint: str, changed: dict[str, float]) -> None:
    assert told(spoilt(sher, joint, **changed)) == [joint]


def test_a_target_without_the_deflection_under_the_weight_is_reported(sher: Path) -> None:
    stage = Usd.Stage.Open(str(sher))
    prim = next(p for p in stage.Traverse() if p.GetName() == "q1")
    stiffness = UsdPhysics.DriveAPI(prim, "linear").GetStiffnessAttr().Get()
    deflection = 5.646 / stiffness  # N: a third of the weight of the stage and of what it carries
    assert told(spoilt(sher, "q1", TargetPosition=-deflection)) == ["q1"]


@pytest.mark.slow
@pytest.mark.parametrize("robot", [None, "sher"])
def test_the_audit_names_the_target_with_and_without_the_mechanism(sher: Path, robot: str | None) -> None:
    assert not [f for f in twin.audit(sher, robot).findings if f.code == "usd.drive_target"]
    found = twin.audit(spoilt(sher, "q4", TargetPosition=0.1), robot).findings
    told = [f.where for f in found if f.code == "usd.drive_target" and f.severity == "disagreement"]
    assert told == ["sher.usda: q4"]


GRAVITY = np.array([0.0, 0.0, -10.0])

STIFFNESS = 100.0


def sliding(name: str, parent: str, child: str, *, driven: bool = True) -> FileJoint:
    """Return a vertical slide whose drive, if there is one, has the stiffness STIFFNESS in N/m."""
    line = JointLine("slide", np.zeros(3), np.array([0.0, 0.0, 1.0]))
    drive = FileDrive(driven=driven, stiffness=STIFFNESS if driven else None)
    return FileJoint((name,), parent, child, np.eye(4), (line,), drive)


def notes(joints: list[FileJoint], held: frozenset[str], target: float) -> list[tuple[str, str]]:
    """Return (severity, message) of the findings on links "a", of 1 kg, and "b", of 2 kg, on the link "base"."""
    stage = Usd.Stage.CreateInMemory()
    for joint in joints:
        if joint.motions and joint.drive.driven:
            prim = UsdPhysics.PrismaticJoint.Define(stage, f"/{joint.names[0]}").GetPrim()
            UsdPhysics.DriveAPI.Apply(prim, "linear").CreateTargetPositionAttr(target)
    used = {joint.child for joint in joints}
    masses = {"a": FileMass(1.0, np.zeros(3)), "b": FileMass(2.0, np.zeros(3))}
    links = ("base", *sorted(used))
    mechanism = FileMechanism(links, masses, joints=joints, fixed_to_world=held, gravity=GRAVITY, all_motors=True)
    ledger = Ledger("made.usda")
    check_drive_targets(stage, dict.fromkeys(mechanism.links, np.eye(4)), mechanism, 1.0, ledger, moving=False)
    return [(finding.severity, finding.message) for finding in ledger.found]


BASE = frozenset({"base"})


def test_a_slide_is_held_by_a_target_ahead_of_its_place() -> None:
    joints = [sliding("j", "base", "a")]
    assert notes(joints, BASE, 10.0 / STIFFNESS) == []
    ((severity, text),) = notes(joints, BASE, 0.0)
    assert severity == "disagreement"
    assert "'j' has the target 0 m; 0.1 m holds" in text


@pytest.mark.parametrize(
    ("joints", "held", "reason"),
    [
        ([sliding("j", "base", "a")], frozenset(), "no joint holds a link of the robot in the world"),
        (
            [sliding("j", "base", "a"), sliding("k", "base", "a")],
            BASE,
            "2 drives ('j', 'k') act on 1 independent motion",
        ),
        ([sliding("j", "base", "a"), sliding("k", "a", "b", driven=False)], BASE, "% of its power remains"),
        ([sliding("j", "base", "a")], frozenset({"base", "a"}), "1 drive ('j') acts on 0 independent motions"),
        ([sliding("j", "lost", "a")], BASE, "the poses of its bodies and frames give no coordinate"),
    ],
)
def test_targets_that_are_not_checked_are_noted_with_the_reason(
    joints: list[FileJoint], held: frozenset[str], reason: str
) -> None:
    ((severity, text),) = notes(joints, held, 7.0)
    assert severity == "info"
    assert text.startswith("target")
    assert " not checked: " in text
    assert reason in text


def test_a_robot_of_which_nothing_can_move_is_read() -> None:
    fixed = FileJoint(("f",), "base", "a", np.eye(4))
    slide = sliding("j", "base", "b", driven=False)
    assert notes([fixed], frozenset({"base", "a"}), 0.0) == []
    reason = notes([fixed, slide, sliding("k", "base", "b")], frozenset({"base", "a", "b"}), 0.0)
    assert [severity for severity, _ in reason] == ["info"]
