"""The targets of the drives of a USD stage hold the robot where the stage shows it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from pxr import Sdf, Usd, UsdPhysics

import twin
from made.lanes import robots
from twin.core import assets
from twin.exchange.audit.report import Ledger
from twin.exchange.formats.usd.audit import read_usd

STAGES = assets.data_folder() / "usd"


def told(file: Path) -> list[str]:
    """Return the joints whose drive targets are reported."""
    ledger = Ledger(file.name)
    read_usd(file, ledger)
    found = [finding.where for finding in ledger.found if finding.code == "usd.drive_target"]
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
