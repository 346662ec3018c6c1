"""Measuring: which face a name means, and the frames that faces define."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twin.cad import features
from twin.cad.description import CadTolerance, Feature, FrameSpec, NamedPoint
from twin.cad.features import MeasuredFeature
from twin.cad.step import Face, Part
from twin.core import spatial
from twin.core.errors import CadError
from twin.core.units import DEG, MM

TOLERANCE = CadTolerance(gross_mm=2.0, gross_deg=2.0, meeting_um=1.0, meeting_deg=0.001)
X, Y, Z = np.eye(3)


def face(kind, at_mm, direction=(0, 0, 0), radius_mm=0.0):
    d = np.array(direction, float)
    length = np.linalg.norm(d)
    return Face(kind, np.array(at_mm, float) * MM, d / length if length else d, radius_mm * MM)


def part(name, *faces):
    return Part(name, ("body",), np.zeros((0, 3)), np.zeros((0, 3), int), (0.6, 0.6, 0.6, 1.0), faces)


def cylinder(at, direction, radius=3.0):
    return face("cylinder", at, direction, radius)


def sphere(at, radius=8.0):
    return face("sphere", at, radius_mm=radius)


def plane(at, normal):
    return face("plane", at, normal)


def wanted(kind, near, **more):
    fields = {"kind": kind, "near_mm": tuple(near), **more}
    return Feature(**fields)


def find(spec, *parts):
    return features.find("bar", "thing", spec, parts, TOLERANCE)


PARTS = (
    part("pin", cylinder((0, 0, 0), Z), cylinder((50, 0, 0), Z), plane((0, 0, 10), Z), plane((0, 0, -10), Z)),
    part("ball", sphere((100, 0, 0)), sphere((0, 100, 0)), cylinder((0, 0, 40), Z, 4.0)),
)


# -- finding -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("spec", "point", "on"),
    [
        (wanted("cylinder", (50.4, 0, 0), radius_mm=3, direction=(0, 0, 1)), (50, 0, 0), "pin"),
        (wanted("cylinder", (0.4, 0.1, 3), radius_mm=3, direction=(0, 0, 1)), (0, 0, 0), "pin"),
        (wanted("cylinder", (0.4, 0.1, 3), radius_mm=4, direction=(0, 0, 1)), (0, 0, 40), "ball"),
        (wanted("plane", (3, 3, 9), direction=(0, 0, 1)), (0, 0, 10), "pin"),
        (wanted("plane", (3, 3, -9), direction=(0, 0, 1)), (0, 0, -10), "pin"),
        (wanted("sphere", (99, 0, 0), radius_mm=8), (100, 0, 0), "ball"),
        (wanted("sphere", (0, 101, 0), radius_mm=8), (0, 100, 0), "ball"),
    ],
)
def test_of_the_faces_of_its_kind_and_radius_the_nearest_is_taken(spec, point, on):
    found = find(spec, *PARTS)
    assert (found.name, found.part) == ("thing", on)
    assert np.array_equal(found.face.point, np.array(point, float) * MM)


@pytest.mark.parametrize("sign", [1, -1])
def test_the_direction_has_the_meant_sign_but_the_measured_line(sign):
    tilted = cylinder((0, 0, 0), (0.01, 0, 1))
    found = find(wanted("cylinder", (0, 0, 0), radius_mm=3, direction=(0, 0, sign)), part("p", tilted))
    assert np.array_equal(found.direction, sign * tilted.direction)


def test_of_two_bores_on_one_axis_the_nearer_along_it_is_taken():
    both = part("p", cylinder((0, 0, 0), Z), cylinder((0, 0, 60), Z))
    for z, expected in ((10, 0), (50, 60)):
        found = find(wanted("cylinder", (0, 0, z), radius_mm=3, direction=(0, 0, 1)), both)
        assert found.face.point[2] == expected * MM


def test_a_part_can_be_named():
    twins = (part("a", plane((0, 0, 0), Z)), part("b", plane((0, 0, 0.5), Z)))
    spec = wanted("plane", (0, 0, 0), direction=(0, 0, 1), part="b")
    assert find(spec, *twins).face.point[2] == 0.5 * MM
    with pytest.raises(CadError) as caught:
        find(wanted("plane", (0, 0, 0), direction=(0, 0, 1), part="c"), *twins)
    assert str(caught.value) == "feature 'thing' of body 'bar': there is no part 'c'. Known: a, b."


def test_two_faces_that_are_equally_near_are_refused():
    both = part("a", plane((0, 0, 1), Z)), part("b", plane((0, 0, -1), Z))
    with pytest.raises(CadError) as caught:
        find(wanted("plane", (0, 0, 0), direction=(0, 0, 1)), *both)
    assert str(caught.value) == (
        "feature 'thing' of body 'bar': two plane faces are equally near, on 'a' at (0.00, 0.00, 1.00) mm and on 'b' "
        "at (0.00, 0.00, -1.00) mm. Move near_mm towards the intended face, or name its `part`."
    )


@pytest.mark.parametrize(
    ("spec", "faces"),
    [
        (
            wanted("plane", (0, 0, 0), direction=(0, 0, 1)),
            (plane((5, 0, 0), Z), plane((-5, 0, 0), -Z)),
        ),
        (
            wanted("cylinder", (0, 0, 0), radius_mm=3, direction=(0, 0, 1)),
            (cylinder((0, 0, 4), Z), cylinder((0, 0, -4), -Z)),
        ),
        (wanted("sphere", (0, 0, 0), radius_mm=8), (sphere((0, 0, 0)), sphere((0, 0, 0)))),
    ],
)
def test_equally_near_faces_of_one_surface_measure_the_same_and_are_fine(spec, faces):
    assert find(spec, part("p", *faces)).face is faces[0]


def test_a_wrong_radius_lists_the_radii_that_exist():
    with pytest.raises(CadError) as caught:
        find(wanted("cylinder", (0, 0, 0), radius_mm=3.02, direction=(0, 0, 1)), *PARTS)
    assert str(caught.value) == (
        "feature 'thing' of body 'bar': the body has no cylinder of radius 3.02 mm; radii found: 3, 4 mm"
    )


@pytest.mark.parametrize(("radius", "fits"), [(3.004, True), (2.996, True), (3.006, False)])
def test_radii_are_told_apart_at_five_micrometres(radius, fits):
    spec = wanted("cylinder", (0, 0, 0), radius_mm=radius, direction=(0, 0, 1))
    if fits:
        assert find(spec, *PARTS).face.radius == 3 * MM
    else:
        with pytest.raises(CadError, match="radii found"):
            find(spec, *PARTS)


def test_a_kind_that_is_not_there():
    with pytest.raises(CadError) as caught:
        find(wanted("sphere", (0, 0, 0), radius_mm=8), part("p", plane((0, 0, 0), Z)))
    assert str(caught.value) == "feature 'thing' of body 'bar': the body has no sphere of radius 8 mm"


def test_a_face_that_is_grossly_off_is_an_error_with_its_distance():
    with pytest.raises(CadError) as caught:
        find(wanted("sphere", (103.5, 0, 0), radius_mm=8), *PARTS)
    assert str(caught.value) == (
        "feature 'thing' of body 'bar': the nearest sphere (on 'ball', at (100.00, 0.00, 0.00) mm) is 3.500 mm and "
        "0.00° away; gross tolerance 2 mm, 2°. Correct near_mm, the drawing, or tolerance.gross_mm."
    )


def test_a_face_that_is_grossly_tilted_is_an_error_with_its_angle():
    tilted = cylinder((0, 0, 0), (np.sin(3 * DEG), 0, np.cos(3 * DEG)))
    with pytest.raises(CadError, match=r"is 0\.000 mm and 3\.00° away; gross tolerance 2 mm, 2°"):
        find(wanted("cylinder", (0, 0, 0), radius_mm=3, direction=(0, 0, 1)), part("p", tilted))


@pytest.mark.parametrize(("off", "fits"), [(1.999, True), (2.001, False)])
def test_the_gross_tolerance_is_a_limit(off, fits):
    spec = wanted("sphere", (100 + off, 0, 0), radius_mm=8)
    if fits:
        assert find(spec, *PARTS).face.point[0] == 0.1
    else:
        with pytest.raises(CadError, match="gross tolerance"):
            find(spec, *PARTS)


# -- frames ------------------------------------------------------------------------------------------


def measured(**faces):
    return {n: MeasuredFeature(n, f, f.direction, "p") for n, f in faces.items()}


TILT = np.array([np.sin(0.2), 0, np.cos(0.2)])

KNOWN = measured(
    axis=cylinder((10, 20, 77), Z),
    leaning=cylinder((0, 0, 0), TILT),
    cross=cylinder((10, 99, 30), X),
    skew=cylinder((13, 90, 30), Y),
    beside=cylinder((40, 20, 0), Z),
    top=plane((500, 500, 5), Z),
    ramp=plane((10, 20, 8), (1, 0, 1)),
    wall=plane((10, 0, 0), X),
    s1=sphere((0, 0, 0)),
    s2=sphere((30, 0, 0)),
    s3=sphere((0, 60, 3)),
    along=sphere((10, 20, 500)),
)


@pytest.mark.parametrize(
    ("origin", "at", "point_mm"),
    [
        ("axis", None, (10, 20, 77)),
        ("axis", "top", (10, 20, 5)),
        ("axis", "ramp", (10, 20, 8)),
        ("leaning", "top", (5 * np.tan(0.2), 0, 5)),
        ("axis", "cross", (10, 20, 30)),
        ("axis", "skew", (10, 20, 30)),
        ("axis", "s3", (10, 20, 3)),
        ("s2", None, (30, 0, 0)),
        ("s2", "top", (30, 0, 0)),
        ("top", None, (500, 500, 5)),
    ],
)
def test_points_of_features(origin, at, point_mm):
    p = features.point(NamedPoint(body="bar", origin=origin, at=at), KNOWN)
    assert np.abs(p / MM - point_mm).max() < 1e-12


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.lists(st.floats(-1, 1), min_size=12, max_size=12))
def test_the_point_nearest_to_a_skew_axis_is_where_the_common_perpendicular_stands(numbers):
    p, q, d, e = np.array(numbers).reshape(4, 3)
    if min(np.linalg.norm(d), np.linalg.norm(e)) < 0.1:
        return
    d, e = d / np.linalg.norm(d), e / np.linalg.norm(e)
    if np.linalg.norm(np.cross(d, e)) < 0.15:
        return
    both = measured(a=cylinder(p / MM, d), b=cylinder(q / MM, e))
    found = features.centre("a", both, "b")
    assert spatial.point_to_line(found, p, d) < 1e-12
    apart = abs((q - p) @ np.cross(d, e)) / np.linalg.norm(np.cross(d, e))
    assert spatial.point_to_line(found, q, e) == pytest.approx(apart, abs=1e-12)


@pytest.mark.parametrize(
    ("origin", "at", "message"),
    [
        ("axis", "beside", "the axes of 'axis' and 'beside' are parallel: no point is nearest; name another `at`"),
        (
            "axis",
            "wall",
            "the axis of 'axis' does not meet the plane 'wall', because they are parallel; name another `at`",
        ),
        ("axes", None, "there is no feature 'axes'. Did you mean 'axis'?"),
        ("axis", "topp", "there is no feature 'topp'. Did you mean 'top'?"),
    ],
)
def test_points_that_do_not_exist(origin, at, message):
    with pytest.raises(CadError) as caught:
        features.centre(origin, KNOWN, at)
    assert str(caught.value).startswith(message)


def frame(**spec):
    return features.frame(FrameSpec(**spec), KNOWN)


def columns(T):
    return T[:3, 0], T[:3, 1], T[:3, 2], T[:3, 3] / MM


def test_a_frame_from_an_axis_and_a_plane():
    x, y, z, p = columns(frame(origin="axis", at="top", z="axis", x_along="wall"))
    assert np.array_equal(np.stack([x, y, z]), np.eye(3))
    assert np.abs(p - [10, 20, 5]).max() < 1e-12


def test_a_frame_from_an_axis_and_an_axis_turned_to_a_point():
    x, y, z, p = columns(frame(origin="axis", at="cross", z="axis", x_towards="s1"))
    towards = np.array([-10, -20, 0]) / np.hypot(10, 20)
    assert np.abs(x - towards).max() < 1e-15
    assert np.array_equal(z, Z)
    assert np.abs(y - np.cross(Z, towards)).max() < 1e-15
    assert np.abs(p - [10, 20, 30]).max() < 1e-12


def test_a_frame_whose_y_points_towards():
    T = frame(origin="axis", at="top", z="axis", y_towards="beside")
    assert np.abs(T[:3, 1] - X).max() < 1e-15  # 'beside' lies in +x of 'axis'
    assert np.abs(T[:3, 0] - -Y).max() < 1e-15
    assert spatial.is_pose(T)


def test_a_frame_at_the_centroid_of_spheres_with_their_normal():
    x, _, z, p = columns(frame(origin=["s1", "s2", "s3"], z=["s1", "s2", "s3"], x_towards=["s2", "s3"]))
    normal = np.cross([30, 0, 0], [0, 60, 3])
    assert np.abs(z - normal / np.linalg.norm(normal)).max() < 1e-15
    assert np.abs(p - [10, 20, 1]).max() < 1e-12
    to = np.array([15, 30, 1.5]) - p
    assert np.abs(x - to / np.linalg.norm(to)).max() < 1e-12
    clockwise = frame(origin="s1", z=["s1", "s3", "s2"], x_towards="s2")
    assert np.abs(clockwise[:3, 2] + z).max() < 1e-15


def test_a_given_frame():
    T = frame(position_mm=(1, 2, 3), angles_deg=(10, 20, 30))
    a, b, c = np.array([10, 20, 30]) * DEG
    Rz = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    Ry = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    Rx = np.array([[1, 0, 0], [0, np.cos(c), -np.sin(c)], [0, np.sin(c), np.cos(c)]])
    assert np.abs(T[:3, :3] - Rz @ Ry @ Rx).max() < 1e-15
    assert np.array_equal(T[:3, 3], [0.001, 0.002, 0.003])
    assert np.array_equal(frame(position_mm=(0, 0, 0)), np.eye(4))


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        (
            {"origin": "axis", "z": "axis", "x_along": "top"},
            "the frame at 'axis': its x or y direction is parallel to z; name another feature for it",
        ),
        (
            {"origin": "axis", "z": "axis", "x_towards": "along"},
            "the frame at 'axis': its x or y direction is parallel to z; name another feature for it",
        ),
        (
            {"origin": "axis", "z": "axis", "y_towards": "axis"},
            "the frame at 'axis': its x or y direction is parallel to z; name another feature for it",
        ),
        (
            {"origin": "s1", "z": "s1", "x_towards": "s2"},
            "z = 's1' defines no direction: use a cylinder, a plane, or three sphere centres not on one line",
        ),
        (
            {"origin": "s1", "z": ["s1", "s2", "s2"], "x_towards": "s3"},
            "z = ['s1', 's2', 's2'] defines no direction: use a cylinder, a plane, or three sphere "
            "centres not on one line",
        ),
        ({"origin": "axis", "z": "axiss", "x_towards": "s2"}, "there is no feature 'axiss'. Did you mean 'axis'?"),
    ],
)
def test_directions_that_span_no_frame(spec, message):
    with pytest.raises(CadError) as caught:
        frame(**spec)
    assert str(caught.value).startswith(message)


# -- on a STEP ---------------------------------------------------------------------------------------


def test_every_kind_is_measured_on_a_step_and_joints_meet():
    from twin.cad.build import read_mechanism

    cad = read_mechanism(Path(__file__).parents[1] / "data/cad/crank.toml")
    assert cad.findings == ()
    m = cad.mechanism
    turn, slide = m.joint("turn"), m.joint("slide")
    assert np.abs(turn.relative(m.rest["base"], m.rest["arm"]) - np.eye(4)).max() < 1e-15
    drawn = slide.relative(m.rest["base"], m.rest["slider"])
    assert np.abs(drawn - spatial.pose(p=[0, 0, -45 * MM])).max() < 1e-15
    assert np.abs(m.rest["arm"] @ np.append(m.point("tip").p_body, 1) - [0.08, 0, 0.02, 1]).max() < 1e-15
    T_base_tool = m.rest["arm"] @ m.frame("tool").T_body_frame
    assert np.abs(T_base_tool - spatial.pose(np.diag([-1.0, -1, 1]), [0.08, 0, 0.02])).max() < 1e-15
    assert turn.mating == ("arm_bar", "base_pin", "base_plate")
    assert turn.limits == pytest.approx((-np.pi / 2, np.pi / 2))
    assert (turn.max_speed, turn.max_acceleration) == (pytest.approx(np.pi / 3), None)
    assert (slide.limits, slide.max_acceleration, slide.max_jerk) == ((-0.1, 0.02), 0.5, 4.0)
    assert m.postures["home"] == {"turn": pytest.approx(np.pi / 6), "slide": -0.045}
    shown = {p.name: (p.value, p.unit) for p in m.parameters}
    assert shown["turn drive stiffness"] == (100.0, "N m/rad")
    assert shown["turn drive damping"] == (5.0, "N m s/rad")
    assert shown["slide limits from"] == (-0.1, "mm")
