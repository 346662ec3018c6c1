"""Physics of files: a file alone against nature, files against the mechanism, joints whatever they are split into."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from twin.exchange.audit import audit
from twin.exchange.audit.colors import color_difference, linear
from twin.exchange.audit.file_content import Content
from twin.exchange.audit.file_drives import FileDrive
from twin.exchange.audit.file_joints import FileJoint
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.mechanism_comparison import compare_mechanisms
from twin.exchange.audit.mechanism_data import FileMechanism
from twin.exchange.audit.motion_lines import motion_lines
from twin.exchange.audit.poses import about, inverse, pose
from twin.exchange.formats.mjcf.write import write_mjcf
from twin.exchange.formats.urdf.write import write_urdf
from twin.exchange.formats.usd.write import write_usd
from twin.model.inertia import Inertia

HERE = Path(__file__).parents[1]
from made import audit_seeds as seeds
from made import bundle as base


@pytest.fixture(scope="module")
def bars(tmp_path_factory) -> Path:
    return base.write_good(tmp_path_factory.mktemp("good") / "bars")


# ------------------------------------------------------------------------------------------------ a file alone

ALONE = {
    "URDF: mass zero": "physics.mass_not_positive",
    "URDF: mass negative": "physics.mass_not_positive",
    "URDF: all masses x 1000": "physics.density",
    "URDF: inertia negative": "physics.inertia_impossible",
    "URDF: inertia x 10": "physics.inertia_impossible",
    "URDF: inertia in g mm2": "physics.inertia_impossible",
    "MJCF: all masses x 1000": "physics.density",
    "MJCF: gravity up": "physics.gravity",
    "MJCF: gravity sideways": "physics.gravity",
    "MJCF: gravity 981": "physics.gravity",
    "MJCF: keyframe open": "mjcf.keyframe",
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ALONE)
def test_a_file_alone_is_held_against_nature(name, bars, tmp_path):
    folder = tmp_path / "bars"
    shutil.copytree(bars, folder)
    assert next(s for s in seeds.SEEDS if s.name == name).edit(folder) is not False
    report = audit(folder / ("bars.urdf" if name.startswith("URDF") else "bars.xml"))
    assert ALONE[name] in {f.code for f in report.findings}, [(f.code, f.message) for f in report.findings]
    assert report.exit_code == 1


@pytest.mark.slow
@pytest.mark.parametrize("unknown", [("base", "crank", "coupler", "rocker"), ("coupler",)])
def test_masses_that_are_unknown_are_no_contradiction(unknown, tmp_path):
    """MJCF and URDF require a mass, and state that they assume one; a base fixed to the world needs none."""
    robot = base.made.four_bar()
    robot = replace(robot, bodies=tuple(replace(b, inertia=None) if b.name in unknown else b for b in robot.bodies))
    write_usd(robot, (), tmp_path / "usd")
    write_mjcf(robot, tmp_path)
    write_urdf(robot, tmp_path)
    assert audit(tmp_path).exit_code == 0
    text = (tmp_path / "bars.urdf").read_text(encoding="utf-8")
    (tmp_path / "bars.urdf").write_text(text.replace("is unknown", "is known"), encoding="utf-8")
    seen = {f.code for f in audit(tmp_path).findings if f.severity == "disagreement"}
    assert seen == (set() if len(unknown) > 1 else {"physics.weighed"})


# --------------------------------------------------------------------------------------------- the mechanism


def heavier(m):
    I = m.bodies[-1].inertia  # noqa: E741 - the symbol of the field
    bodies = (*m.bodies[:-1], replace(m.bodies[-1], inertia=Inertia(2 * I.mass, I.p_body_com, 2 * I.I_com)))
    return replace(m, bodies=bodies)


def of_joint(**change):
    def edit(m):
        i = next(i for i, j in enumerate(m.joints) if j.active)
        return replace(m, joints=(*m.joints[:i], replace(m.joints[i], **change), *m.joints[i + 1 :]))

    return edit


def other_frame(m):
    f = m.frames[-1]
    return replace(m, frames=(*m.frames[:-1], replace(f, T_body_frame=f.T_body_frame @ pose(p=[0.05, 0, 0]))))


MECHANISMS = {
    "as it is": (lambda m: m, set()),
    "twice the mass": (heavier, {"physics.mass", "physics.inertia"}),
    "other limits": (of_joint(limits=(-1.0, 1.0)), {"physics.limits", "physics.range_of_control"}),
    "other frame": (other_frame, {"physics.frame_pose"}),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", MECHANISMS)
def test_the_mechanism_outweighs_all_files(name, bars):
    edit, codes = MECHANISMS[name]
    found = base.grave(audit(bars, mechanism=edit(base.made.four_bar())).findings)
    assert {f.code for f in found} == codes, [(f.code, f.where, f.message) for f in found]
    assert not codes or all("the mechanism" in f.message for f in found)


# ------------------------------------------------------------------------------------------- joints in parts


def test_three_turns_over_small_links_are_a_ball():
    T = pose(about([0.6, 0, 0.8], 0.7), [0.1, 0.2, 0.3])
    back = pose(about([0, 1, 0], 0.4), [0.0, 0.1, 0.0])
    step = [pose(p=[0, 0, 0])] * 2
    parts, inner = [], "arm"
    for i, (name, place) in enumerate(zip(("b_x", "b_y", "b_z"), (T, *step), strict=True)):
        parts.append(FileJoint((name,), inner, f"small{i}", place, motion_lines("revolute", place, i)))
        inner = f"small{i}"
    parts.append(FileJoint(("b_body",), inner, "hand", inverse(back)))
    (ball,) = FileMechanism(joints=parts).joints_between({"arm", "hand"})
    assert ball.kind == "spherical"
    for link, place in (("arm", T), ("hand", back)):
        end = ball.end(link)
        assert end
        assert end[0] == pytest.approx(place[:3, 3])


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("kind", ["revolute", "prismatic", "cylindrical"])
def test_a_joint_seen_from_its_child_is_the_same(kind, turned):
    T_parent, T_child = pose(about([1, 2, 0], 0.5), [0.1, 0, 0.2]), pose(about([0, 1, 3], -0.9), [0, 0.3, 0.1])
    T = T_parent @ inverse(T_child)
    joint = FileJoint(("j",), "b", "a", T, motion_lines(kind, T_parent), FileDrive((-1.0, 2.0)))
    seen = joint.reversed() if turned else joint
    assert seen.kind == kind
    for link, T in (("b", T_parent), ("a", T_child)):
        end = seen.end(link)
        assert end
        point, direction = end
        assert direction == pytest.approx(-T[:3, 2])  # by the order of names
        off = np.cross(T[:3, 2], point - T[:3, 3])
        assert off == pytest.approx(np.zeros(3), abs=1e-12)


def test_a_slide_on_a_carrier_that_is_welded_is_a_slide():
    T = pose(about([1, 0, 0], 0.3), [0, 0.1, 0])
    parts = [
        FileJoint(("s",), "base", "carrier", T, motion_lines("prismatic", T)),
        FileJoint(("s_0",), "carrier", "block", pose(p=[0, 0, 0.2])),
    ]
    (slide,) = FileMechanism(joints=parts).joints_between({"base", "block"})
    assert (slide.kind, slide.parent, slide.child, slide.names) == ("prismatic", "base", "block", ("s", "s_0"))


def test_two_tied_points_are_a_pin_and_one_is_a_ball():
    def tie(name, z):
        return FileJoint((name,), "a", "b", tied=((np.array([0, 0, z]), np.array([1, 0, z])),))

    one, two = tie("p_0", 0.0), tie("p_1", 0.05)
    assert [j.kind for j in FileMechanism(joints=[one, two]).joints_between({"a", "b"})] == ["revolute"]
    assert [j.kind for j in FileMechanism(joints=[one]).joints_between({"a", "b"})] == ["spherical"]


@pytest.mark.parametrize(
    ("points", "kind"),
    [
        ([(0, 0, 0), (0, 0, 1e-4)], "spherical"),
        ([(0, 0, 0), (0, 0, 0.1), (0, 0, 0.1)], "revolute"),
        ([(0, 0, 0.1), (0, 0, 0), (0, 0, 0.2)], "revolute"),
        ([(0, 0, 0), (0, 0, 0.1), (0.05, 0, 0.05)], "fixed"),
    ],
)
def test_tied_points_in_a_place_are_a_ball_and_on_a_line_a_pin(points, kind):
    tied = []
    for point in points:
        tied.append((np.array(point, float), np.array([1.0, 0.0, 0.0]) + point))
    joint = FileJoint(("p",), "a", "b", tied=tuple(tied))
    assert joint.kind == kind
    for link in ("a", "b"):
        point, direction = joint.end(link)
        assert np.array_equal(point, tied[0][0 if link == "a" else 1])
        assert np.allclose(direction, [0, 0, 1])


@pytest.mark.parametrize("order", [("usda", "tracks"), ("tracks", "mjcf")])
def test_a_table_may_hold_a_ball_as_three_numbers(order):
    T = pose(p=[0.1, 0, 0])
    ball = FileJoint(("b",), "arm", "hand", T, motion_lines("spherical", T))
    said = {"tracks": [FileJoint((f"b_{a}",), "", "", stated_kind="revolute") for a in "xyz"]}
    contents = []
    for kind in order:
        mechanism = FileMechanism(("arm", "hand"), joints=said.get(kind, [ball]), complete=kind != "tracks")
        contents.append(Content(Ledger(f"file.{kind}"), kind, declared=("arm", "hand"), mechanism=mechanism))
    compare_mechanisms(contents)
    assert not [f for c in contents for f in c.ledger.findings]


def test_a_table_may_hold_a_ball_of_a_scene_that_tells_no_kinds():
    """A GLB and tracks, handed over alone: the numbers of the ball are no joints that the GLB lacks."""
    table = [FileJoint((n,), "", "", stated_kind="revolute") for n in ("b_x", "b_y", "b_z", "other")]
    contents = []
    for kind, said in (("tracks", table), ("glb", [FileJoint(("b",), "", "hand")])):
        mechanism = FileMechanism(("arm", "hand"), joints=said)
        contents.append(Content(Ledger(f"file.{kind}"), kind, declared=("arm", "hand"), mechanism=mechanism))
    compare_mechanisms(contents)
    assert [f.where for c in contents for f in c.ledger.findings] == ["file.glb: joint 'other'"]


# ------------------------------------------------------------------------------------------------- small parts


@pytest.mark.parametrize(("other", "codes"), [(4e-12, set()), (1e-4, {"physics.sum"})])
def test_rounding_of_a_sum_that_is_zero_is_no_difference(other, codes):
    ledgers = [Ledger("a.usda"), Ledger("b.xml")]
    contents = []
    for ledger, form, total in zip(ledgers, ("usda", "mjcf"), (0.0, other), strict=True):
        said = FileMechanism(links=("base", "arm"), couplings={"belt": ({"q1": 1.0, "q2": 1.0}, total)})
        contents.append(Content(ledger, form, mechanism=said))
    compare_mechanisms(contents, None)
    assert {f.code for ledger in ledgers for f in ledger.findings} == codes


def test_colours_are_compared_by_area():
    red, blue = (0.8, 0.1, 0.1, 1.0), (0.1, 0.1, 0.8, 1.0)
    assert color_difference({red: 0.3, blue: 0.7}, {blue: 0.7, red: 0.3}) == pytest.approx(0)
    assert color_difference({red: 0.3, blue: 0.7}, {blue: 1.0}) == pytest.approx(0.3)
    assert color_difference({red: 1.0}, {(0.81, 0.1, 0.1, 1.0): 1.0}) == pytest.approx(0)
    assert linear(np.array([0.0, 0.5, 1.0])) == pytest.approx([0, 0.21404, 1], abs=1e-5)
