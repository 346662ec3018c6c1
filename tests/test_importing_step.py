"""A STEP as a skeleton: bodies, fitting faces, and proposed joints that turn out to be those of the robot."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from twin import api, cli
from twin.cad.build import read_mechanism
from twin.exchange.read.step import read_skeleton, write_skeleton
from twin.reference import ReferenceModel

ROOT = Path(__file__).parents[1]


def uncommented(text):
    """Return a skeleton's description as its user would leave it: every proposal taken, every hold deleted."""
    text = re.sub(r"^# (\[\[joint\]\]|(?:name|type|parent|child|on_parent|on_child) = )", r"\1", text, flags=re.M)
    return re.sub(r"\n\[\[joint\]\]\nname = \"hold_.*?(?=\n\n)", "", text, flags=re.S)


@pytest.fixture(scope="module")
def sils(tmp_path_factory):
    source = ROOT / "cad/sils/sils.step"
    skeleton = read_skeleton(source)
    folder = tmp_path_factory.mktemp("step") / "again"
    _, mechanism = write_skeleton(skeleton, "again", folder, source)
    return skeleton, folder, mechanism


def test_the_skeleton_is_rigid_and_has_a_body_for_each_node(sils):
    skeleton, folder, mechanism = sils
    assert {b.name for b in mechanism.bodies} == set(api.load("sils").cad.description.body)
    assert mechanism.base == "frame"
    assert {j.type for j in mechanism.joints} == {"fixed"}
    assert ReferenceModel(mechanism).mobility(ReferenceModel(mechanism).home().x).freedom == 0
    assert api.load(folder).mechanism.name == "again"
    assert {f.code for f in skeleton.findings if f.severity == "warning"} == {"import.mass", "import.joints"}


def test_the_faces_of_sils_suggest_exactly_its_joints(sils):
    skeleton, _, _ = sils
    wanted = {(j.type, frozenset((j.parent, j.child))) for j in api.load("sils").mechanism.joints}
    assert {(p.type, frozenset((p.parent, p.child))) for p in skeleton.proposals} == wanted
    assert len(skeleton.proposals) == len(api.load("sils").mechanism.joints)


def test_the_proposals_taken_make_the_robot(sils, tmp_path):
    _, folder, _ = sils
    (tmp_path / "again.step").write_bytes((folder / "cad/again.step").read_bytes())
    text = uncommented((folder / "cad/again.toml").read_text())
    for i, joint in enumerate(re.findall(r'name = "(j\d+)"\ntype = "prismatic"', text)):
        text = text.replace(f'name = "{joint}"\n', f'name = "{joint}"\nactive = true\n')
        text += f"{joint}_mm = 0\n"
        assert i < 6
    (tmp_path / "again.toml").write_text(text)
    cad = read_mechanism(tmp_path / "again.toml", with_mass=False)
    assert not [f for f in cad.findings if f.code in ("cad.meeting", "cad.tilt")]
    model, own = ReferenceModel(cad.mechanism), api.load("sils").reference()
    assert len(cad.mechanism.loops) == 5
    assert model.home().worst_gap < 1e-9
    assert model.mobility(model.home().x).freedom == own.mobility(own.home().x).freedom == 6


def test_proposed_axes_of_pa10_are_those_of_the_arm(tmp_path):
    source = ROOT / "cad/pa10/pa10.step"
    write_skeleton(read_skeleton(source), "arm", tmp_path / "arm", source)
    path = tmp_path / "arm/cad/arm.toml"
    path.write_text(uncommented(path.read_text()))
    ours, theirs = read_mechanism(path, with_mass=False).mechanism, api.load("pa10").mechanism
    by_pair = {(j.parent, j.child): j for j in ours.joints}
    for joint in theirs.joints[:7]:
        own = by_pair[joint.parent, joint.child]
        # As drawn, in the frame of the drawing: of both, relative to joint 1 of the arm.
        A, B = (
            np.linalg.inv(_at(m, j)) @ _at(m, k)
            for m, j, k in ((ours, by_pair["base", "link1"], own), (theirs, theirs.joints[0], joint))
        )
        assert abs(A[2, 2]) == pytest.approx(abs(B[2, 2]), abs=1e-9)
        assert np.linalg.norm(A[:3, 3]) == pytest.approx(np.linalg.norm(B[:3, 3]), abs=1e-9)


def _at(m, joint):
    return m.rest[joint.parent] @ joint.T_parent_joint


@pytest.mark.slow
def test_every_command_works_on_a_new_skeleton_at_once(tmp_path, capsys):
    source, folder = ROOT / "cad/pa10/pa10.step", tmp_path / "arm"
    assert cli.main(["new", str(source), "--out", str(folder), "--quiet"]) == 0
    said = capsys.readouterr().out
    assert "8 joints are proposed" in said
    assert cli.main(["info", str(folder), "--quiet"]) == 0
    assert cli.main(["build", str(folder), "--quiet"]) == 0
    capsys.readouterr()
    assert cli.main(["validate", str(folder), "--quiet"]) == 2
    assert "no joint of the robot is driven" in capsys.readouterr().err
    assert (folder / "cad/pa10.step").is_file()
