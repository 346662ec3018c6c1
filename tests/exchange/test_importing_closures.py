"""Closure YAML: each type of closure and of joint, against the same linkage written out in hinges."""

from __future__ import annotations

import numpy as np
import pytest

from twin.core.errors import SourceError
from twin.exchange.formats.urdf.read.closures import RETYPED
from twin.exchange.read import read
from twin.exchange.read.loop_closing import close
from twin.reference import ReferenceModel

HINGE = (
    '<joint name="{name}" type="{type}"><origin xyz="{xyz}" rpy="{rpy}"/><parent link="{parent}"/>'
    '<child link="{child}"/><axis xyz="{axis}"/></joint>'
)
AXES = {"X": "1 0 0", "Y": "0 1 0", "Z": "0 0 1"}


def linkage(between):
    """Return the URDF of crank, rod and rocker; `between` gives the types and axes of the joints of crank and rod."""
    shape = '<visual><geometry><box size="0.01 0.01 0.01"/></geometry></visual>'
    links = [f'<link name="{n}">{shape}</link>' for n in ("base", "crank", "rod", "rocker")]
    hinges = [
        HINGE.format(name="q", type="continuous", xyz="0 0 0", rpy="0 0 0", parent="base", child="crank", axis="0 0 1")
    ]
    parent = "crank"
    for k, (name, kind, axis) in enumerate(between):
        last = k == len(between) - 1
        child = "rod" if last else f"cross{k}"
        links += [] if last else [f'<link name="{child}"/>']
        xyz, rpy = ("0.05 0 0.02", "0.3 -0.2 0.5") if k == 0 else ("0 0 0", "0 0 0")
        hinges.append(HINGE.format(name=name, type=kind, xyz=xyz, rpy=rpy, parent=parent, child=child, axis=axis))
        parent = child
    hinges += [
        HINGE.format(
            name="r", type="continuous", xyz="0.2 0 0", rpy="0.4 0 0", parent="base", child="rocker", axis="0 1 0"
        ),
        HINGE.format(
            name="a", type="fixed", xyz="0.16 0.03 -0.04", rpy="0 0 0", parent="rod", child="end_A", axis="0 0 1"
        ),
        HINGE.format(name="b", type="fixed", xyz="0 0 0.1", rpy="0 0 0", parent="rocker", child="end_B", axis="0 0 1"),
    ]
    links += ['<link name="end_A"/>', '<link name="end_B"/>']
    return f'<robot name="rssr">{"".join(links)}{"".join(hinges)}</robot>'


def written_out(kind):
    if kind == "FIXED":
        return [("s", "fixed", "0 0 1")]
    axes = "XYZ" if kind == "SPHERICAL" else kind[-2:]
    return [(f"s_{a}", "continuous", AXES[a]) for a in axes]


def made(folder, name, urdf, yaml):
    (folder / f"{name}.urdf").write_text(urdf)
    (folder / f"{name}.yaml").write_text(yaml)
    return close(read(folder / f"{name}.urdf"))


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "closure"), [*((k, "3d") for k in RETYPED), ("SPHERICAL", "6D"), ("UJOINT_XY", "3D")])
def test_a_retyped_joint_moves_as_its_hinges_do(kind, closure, tmp_path):
    yaml = f"closed_loop: [[end_A, end_B]]\ntype: [{closure}]\nname_mot: [q]\n"
    # The URDF's own axis and type of a retyped joint mean nothing.
    short = made(
        tmp_path, "short", linkage([("s", "revolute", "1 1 1")]), f"{yaml}joint_name: [s]\njoint_type: [{kind}]\n"
    )
    long = made(tmp_path, "long", linkage(written_out(kind)), yaml)
    ours, theirs = ReferenceModel(short.mechanism), ReferenceModel(long.mechanism)
    assert ours.mobility(ours.home().x).freedom == theirs.mobility(theirs.home().x).freedom
    assert ours.home().worst_gap == pytest.approx(theirs.home().worst_gap, abs=1e-8)
    assert "import.retyped" in {f.code for f in short.findings}
    if kind == "FIXED" or closure == "6D":
        return  # too stiff to move
    assert ours.home().worst_gap < 1e-9
    q = ours.home().q + 0.1
    a, b = (m.solve(q, near) for m, near in ((ours, ours.home()), (theirs, theirs.home())))
    np.testing.assert_allclose(
        a.link_poses["rocker"] - ours.home().link_poses["rocker"],
        b.link_poses["rocker"] - theirs.home().link_poses["rocker"],
        atol=1e-9,
    )


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ("joint_name: [t]\njoint_type: [FIXED]", "joint_name: there is no joint 't'. Known:"),
        (
            "joint_name: [s]\njoint_type: [UJOINT_XX]",
            "joint_type: there is no joint type 'UJOINT_XX'. Did you mean 'UJOI",
        ),
        (
            "joint_name: [s]\njoint_type: []",
            "joint_name has 1 names, but joint_type has 0 entries; give one type for each name",
        ),
        ("joint_name: [q]\njoint_type: [SPHERICAL]", "name_mot: joint 'q' is SPHERICAL and cannot be driven"),
        ("joint_name: [q]\njoint_type: [UJOINT_XY]", "name_mot: there is no joint 'q'. Known: a, b, q_X, q_Y"),
        ("joint_names: [s]\njoint_type: [FIXED]", "there is no key 'joint_names'. Did you mean 'joint_name'?"),
    ],
)
def test_a_wrong_type_is_named(changed, message, tmp_path):
    yaml = f"closed_loop: [[end_A, end_B]]\ntype: [3d]\nname_mot: [q]\n{changed}\n"
    with pytest.raises(SourceError) as error:
        made(tmp_path, "bad", linkage([("s", "continuous", "1 0 0")]), yaml)
    assert message in str(error.value)
    assert "bad.yaml" in str(error.value)


def test_a_hinge_of_a_universal_joint_can_be_driven(tmp_path):
    yaml = "closed_loop: [[end_A, end_B]]\ntype: [3d]\nname_mot: [s_Y]\njoint_name: [s]\njoint_type: [UJOINT_XY]\n"
    m = made(tmp_path, "driven", linkage([("s", "continuous", "1 0 0")]), yaml).mechanism
    assert [j.name for j in m.active] == ["s_y"]


@pytest.mark.parametrize("ratio", [1, 2])
def test_a_transmission_may_name_a_hinge_of_a_universal_joint(tmp_path, ratio):
    yaml = "closed_loop: [[end_A, end_B]]\ntype: [3d]\nname_mot: [s_Y]\njoint_name: [s]\njoint_type: [UJOINT_XY]\n"
    parts = f'<joint name="s_Y"/><actuator name="m"/><mechanicalReduction>{ratio}</mechanicalReduction>'
    end = f'<transmission name="t">{parts}</transmission></robot>'
    text = linkage([("s", "continuous", "1 0 0")]).replace("</robot>", end)
    found = made(tmp_path, "hinge", text, yaml)
    assert "s_y" in [joint.name for joint in found.mechanism.active]


@pytest.mark.slow
def test_a_gap_is_the_models_own_only_if_all_of_the_file_was_read(tmp_path):
    # The ends are 1 m apart: nothing closes it.
    urdf = linkage([("s", "fixed", "1 0 0")]).replace("0.16 0.03 -0.04", "1.16 0 0")
    yaml = "closed_loop: [[end_A, end_B]]\ntype: [3d]\nname_mot: [q]\n"
    said = [f.message for f in made(tmp_path, "whole", urdf, yaml).findings if f.code == "import.gap"]
    assert said
    assert "a defect of the model" in said[0]
    partly = urdf.replace("</robot>", "<loop_joint name='x'/></robot>")
    said = [f.message for f in made(tmp_path, "partly", partly, yaml).findings if f.code == "import.gap"]
    assert "a defect of the model" not in said[0]
    assert "<loop_joint> is not read" in said[0]


def test_ends_of_loops_that_nothing_closes_are_told(tmp_path):
    urdf = linkage([("s", "continuous", "1 0 0")]).replace("end_A", "loop1_A").replace("end_B", "loop1_B")
    (tmp_path / "tree.urdf").write_text(urdf)
    told = [f for f in read(tmp_path / "tree.urdf").findings if f.code == "import.closures"]
    assert ["'loop1_A' and 'loop1_B'" in f.message for f in told] == [True]
    yaml = "closed_loop: [[loop1_A, loop1_B]]\ntype: [3d]\nname_mot: [q]\n"
    closed = made(tmp_path, "closed", urdf, yaml)
    assert not [f for f in closed.findings if f.code == "import.closures"]
