"""A STEP as a skeleton: bodies, fitting faces, and proposed joints that turn out to be those of the robot."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from twin import api, cli
from twin.cad.build import read_mechanism
from twin.cad.step import _numbered
from twin.exchange.formats.step.read import read_skeleton, write_skeleton
from twin.reference import ReferenceModel

ROOT = Path(__file__).parents[2]


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


def step_of_copies(places):
    """Return the text of a STEP file whose assembly uses the crank at each place (x, y, z) in mm."""
    text = (ROOT / "tests/data/cad/crank.step").read_text("latin-1")
    n = 100_000
    placements = ",".join(f"#{n + 100 + 10 * k}" for k in range(len(places)))
    rows = [
        f"#{n + 1}=SHAPE_DEFINITION_REPRESENTATION(#{n + 2},#{n + 8});",
        f"#{n + 2}=PRODUCT_DEFINITION_SHAPE('','',#{n + 3});",
        f"#{n + 3}=PRODUCT_DEFINITION('design','',#{n + 4},#{n + 7});",
        f"#{n + 4}=PRODUCT_DEFINITION_FORMATION('','',#{n + 5});",
        f"#{n + 5}=PRODUCT('hexapod','hexapod','',(#{n + 6}));",
        f"#{n + 6}=PRODUCT_CONTEXT('',#2,'mechanical');",
        f"#{n + 7}=PRODUCT_DEFINITION_CONTEXT('part definition',#2,'design');",
        f"#{n + 8}=SHAPE_REPRESENTATION('',(#11,{placements}),#18);",
    ]
    for k, (x, y, z) in enumerate(places):
        m = n + 100 + 10 * k
        rows += [
            f"#{m}=AXIS2_PLACEMENT_3D('',#{m + 1},#13,#14);",
            f"#{m + 1}=CARTESIAN_POINT('',({x:.6f},{y:.6f},{z:.6f}));",
            f"#{m + 2}=CONTEXT_DEPENDENT_SHAPE_REPRESENTATION(#{m + 3},#{m + 5});",
            f"#{m + 3}=( REPRESENTATION_RELATIONSHIP('','',#10,#{n + 8})"
            f"REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION(#{m + 4})SHAPE_REPRESENTATION_RELATIONSHIP() );",
            f"#{m + 4}=ITEM_DEFINED_TRANSFORMATION('','',#11,#{m});",
            f"#{m + 5}=PRODUCT_DEFINITION_SHAPE('Placement','Placement of an item',#{m + 6});",
            f"#{m + 6}=NEXT_ASSEMBLY_USAGE_OCCURRENCE('{m}','crank','',#{n + 3},#5,$);",
        ]
    return text.replace("ENDSEC;\nEND-ISO", "\n".join(rows) + "\nENDSEC;\nEND-ISO")


@pytest.mark.parametrize("count", [2, 6])
def test_a_part_that_is_used_several_times_is_several_bodies(count, tmp_path, rng):
    """Each occurrence is a body with a number, at its own place; so are its meshes in the robot folder."""
    places = rng.uniform(-500, 500, (count, 3))
    (tmp_path / "hexapod.step").write_text(step_of_copies(places), "latin-1")
    skeleton = read_skeleton(tmp_path / "hexapod.step")
    names = [f"crank_{k + 1}" for k in range(count)]
    assert list(skeleton.parts) == names
    assert sum(f.code == "import.copies" for f in skeleton.findings) == count
    _, mechanism = write_skeleton(skeleton, "hexapod", tmp_path / "hexapod", tmp_path / "hexapod.step")
    assert [b.name for b in mechanism.bodies] == names
    own = read_skeleton(ROOT / "tests/data/cad/crank.step")
    whole = np.concatenate([p.vertices for parts in own.parts.values() for p in parts])
    for name, place in zip(names, places, strict=True):
        body = mechanism.body(name)
        points = np.concatenate([m.vertices for m in body.meshes]) + mechanism.rest[name][:3, 3]
        np.testing.assert_allclose(points.min(axis=0), whole.min(axis=0) + place / 1e3, atol=1e-6)
        np.testing.assert_allclose(points.max(axis=0), whole.max(axis=0) + place / 1e3, atol=1e-6)


@pytest.mark.parametrize(
    ("names", "numbered"),
    [
        (["leg", "base"], ["leg", "base"]),
        (["leg", "base", "leg"], ["leg_1", "base", "leg_2"]),
        (["leg", "leg_1", "leg"], ["leg_2", "leg_1", "leg_3"]),
        (["a", "a", "a_1", "a_1"], ["a_2", "a_3", "a_1_1", "a_1_2"]),
        ([], []),
        (["pin", "pin"], ["pin_3", "pin_4"]),
    ],
)
def test_siblings_of_one_name_are_numbered_with_free_names(names, numbered):
    """Free in the whole file: a body of the description is found by its node's name alone."""
    taken = {*names, "pin_1", "pin_2"}
    assert _numbered(names, taken) == numbered
    assert taken == {*names, *numbered, "pin_1", "pin_2"}
