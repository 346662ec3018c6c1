"""The faces of a STEP file are picked by rays; the TOML of picked faces gives a robot the same joints."""

from __future__ import annotations

import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest

from made.lanes import nightly
from twin.cad.build import read_mechanism
from twin.cad.description import load
from twin.cad.face_feature import naming_feature
from twin.cad.features import find
from twin.cad.step import read_step
from twin.cli import main
from twin.core.errors import CadError, TwinError
from twin.core.foreign import budget
from twin.core.units import MM
from twin.ui.session.drawn_faces import StepDrawing
from twin.ui.session.face_picker import FacePicker

ROOT = Path(__file__).parents[2]
HIBOU = ROOT / "cad/hibou/hibou.step"
FILES = sorted(ROOT.glob("cad/*/*.step"), key=lambda path: path != HIBOU)
STEPS = nightly(FILES, len(FILES))


@pytest.fixture
def alone(tmp_path):
    """The drawing of HIBOU without a description beside it: no face has a name yet."""
    path = tmp_path / "hibou.step"
    shutil.copy(HIBOU, path)
    return StepDrawing(path)


def ray_to(part, index):
    """Return (origin, direction) of a ray from outside the solid to the largest triangle of a face."""
    corners = part.vertices[part.triangles[part.face_of_triangle == index]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    largest = int(np.argmax(np.linalg.norm(normals, axis=1)))
    outwards = normals[largest] / np.linalg.norm(normals[largest])
    return corners[largest].mean(axis=0) + 1e-6 * outwards, -outwards


def pick(picker, body, face):
    """Pick a face by a ray; other parts, which may touch the face, are hidden."""
    for number, (owner, part) in enumerate(picker.drawing.placed_parts()):
        for index, drawn in enumerate(part.drawn):
            if owner == body and drawn is not None and _equal(drawn, face):
                return picker.pick(*ray_to(part, index), visible_parts=[number])
    raise AssertionError(f"body '{body}' has no such face")


def _equal(a, b):
    return a.kind == b.kind and np.array_equal(a.point, b.point) and np.array_equal(a.direction, b.direction)


@pytest.mark.parametrize("path", STEPS, ids=lambda path: path.stem)
def test_every_triangle_lies_on_the_face_that_it_is_said_to_belong_to(path):
    for part in read_step(path).parts:
        assert len(part.face_of_triangle) == len(part.triangles)
        for index, face in enumerate(part.drawn):
            corners = part.vertices[part.triangles[part.face_of_triangle == index]].reshape(-1, 3)
            if face is None:
                continue
            away = corners - face.point
            along = away @ face.direction
            across = np.linalg.norm(away - along[:, None] * face.direction, axis=1)
            # vertices have single precision, and lie on the face, not within the tolerance of the triangles
            if face.kind == "plane":
                off = np.abs(along)
            elif face.kind == "cone":
                off = np.abs(across * np.cos(face.half_angle) - np.abs(along * np.sin(face.half_angle)))
            elif face.kind == "torus":
                tube = np.hypot(across - face.radius, along)
                off = tube - tube.mean()
            else:
                off = np.abs(across - face.radius)
            assert np.abs(off).max() < 0.001 * MM, (part.name, index, face.kind)


@pytest.mark.parametrize("path", STEPS, ids=lambda path: path.stem)
def test_the_toml_of_a_picked_face_names_this_face(path):
    drawing = StepDrawing(path)
    step = 7 if path == HIBOU else 1
    seen = 0
    for body, parts in drawing.parts.items():
        for part in parts:
            for face in part.faces[::step]:
                try:
                    spec = naming_feature(body, face, face.direction, part.name, parts, drawing.tolerance)
                except CadError as error:
                    assert "cannot be named" in str(error)  # noqa: PT017 - the other faces are looked at as well
                    continue
                found = find(body, "again", spec, parts, drawing.tolerance)
                assert np.abs(found.face.point - face.point).max() < 1e-9
                assert np.abs(np.cross(found.direction, face.direction)).max() < 1e-9
                seen += 1
    assert seen > 20


def test_a_robot_whose_faces_were_all_picked_has_the_same_joints(tmp_path, alone):
    """The tables [feature.BODY] of the description are replaced by what was copied from the page."""
    source = ROOT / "cad/hibou/hibou.toml"
    d = load(source)
    steps = StepDrawing(HIBOU)
    picker = FacePicker(alone)
    wanted = read_mechanism(source, with_mass=False).mechanism
    copied = {}
    for body, specs in d.feature.items():
        for name, spec in specs.items():
            named = find(body, name, spec, steps.parts[body], d.tolerance)
            picker.clear()
            face = pick(picker, body, named.face)
            picker.rename(name)
            table = tomllib.loads(picker.toml())["feature"]
            assert list(table) == [body]
            if face.feature.direction is not None and np.dot(face.feature.direction, named.direction) < 0:
                # the user turns an axis round by its sign
                turned = [-value for value in table[body][name]["direction"]]
                table[body][name]["direction"] = turned
            copied.setdefault(body, {})[name] = table[body][name]
    lines = []
    for body, features in copied.items():
        lines.append(f"[feature.{body}]")
        for name, values in features.items():
            pairs = [f"{key} = {value!r}" for key, value in values.items()]
            lines.append(f"{name} = {{ {', '.join(pairs)} }}")
    before, _, features_and_more = source.read_text().partition("[feature.")
    _, joint, after = features_and_more.partition("[[joint]]")
    text = before + "\n".join(lines) + "\n\n" + joint + after
    (tmp_path / "hibou.toml").write_text(text)
    built = read_mechanism(tmp_path / "hibou.toml", with_mass=False).mechanism
    for joint, same in zip(built.joints, wanted.joints, strict=True):
        assert joint.name == same.name
        assert np.abs(joint.T_parent_joint - same.T_parent_joint).max() < 1e-12
        assert np.abs(joint.T_child_joint - same.T_child_joint).max() < 1e-12


def test_picked_faces_stay_once_in_the_list_and_have_free_names(alone):
    picker = FacePicker(alone)
    body, part = next(iter(alone.placed_parts()))
    planes = [k for k, face in enumerate(part.drawn) if face is not None and face.kind == "plane"]
    first = picker.pick(*ray_to(part, planes[0]), visible_parts=[0])
    second = picker.pick(*ray_to(part, planes[1]), visible_parts=[0])
    assert picker.pick(*ray_to(part, planes[0]), visible_parts=[0]) is first
    assert [face.name for face in picker.picked] == ["face_1", "face_2"]
    assert picker.current is first
    with pytest.raises(TwinError, match="another picked face of body"):
        picker.rename("face_2")
    with pytest.raises(TwinError, match="lower-case letters"):
        picker.rename("Face 2")
    assert picker.pick(np.array([9.0, 9.0, 9.0]), np.array([1.0, 0.0, 0.0])) is None
    assert picker.current is first
    assert set(tomllib.loads(picker.toml())["feature"][body]) == {"face_1", "face_2"}
    # the normal of a plane points out of the solid: the ray came from there
    _, direction = ray_to(part, planes[1])
    assert np.dot(second.feature.direction, direction) == pytest.approx(-1)
    picker.drop()
    assert picker.current is second
    picker.clear()
    assert picker.toml() == ""


def test_a_cone_shows_its_geometry_and_says_why_it_has_no_toml():
    drawing = StepDrawing(ROOT / "cad/hibou/hibou.step")
    picker = FacePicker(drawing)
    for number, (_, part) in enumerate(drawing.placed_parts()):
        for index, face in enumerate(part.drawn):
            if face is not None and face.kind == "cone":
                picked = picker.pick(*ray_to(part, index), visible_parts=[number])
                assert picked.drawn.index == index
                facts = dict(picked.facts())
                assert facts["kind"] == "cone"
                assert float(facts["half angle"].rstrip("°")) == pytest.approx(np.degrees(face.half_angle), rel=1e-5)
                assert picked.feature is None
                assert "planes, cylinders and spheres" in picked.reason
                assert picker.toml() == ""
                return
    raise AssertionError("no cone")


def test_a_face_that_the_description_names_is_told():
    picker = FacePicker(StepDrawing(HIBOU))
    d = load(ROOT / "cad/hibou/hibou.toml")
    name, spec = next(iter(d.feature["turret"].items()))
    face = find("turret", name, spec, picker.drawing.parts["turret"], d.tolerance).face
    picked = pick(picker, "turret", face)
    assert name in picked.known_as
    with pytest.raises(TwinError, match="the description has a feature"):
        picker.rename(name)


def test_a_broken_description_leaves_the_names_of_the_step(tmp_path):
    shutil.copy(HIBOU, tmp_path / "hibou.step")
    (tmp_path / "hibou.toml").write_text('step = "hibou.step"\nname = 3\n')
    drawing = StepDrawing(tmp_path / "hibou.step")
    assert drawing.source is None
    assert "hibou.toml is not used" in drawing.note
    assert "turret" in drawing.parts


@pytest.mark.parametrize(
    ("content", "options", "text"),
    [
        (b"", [], "is empty"),
        (b"solid cube\n", [], "is not a STEP file"),
        (b"ISO-10303-21;\nDATA;\n", [], "is truncated"),
        (None, [], "cannot read the STEP file"),
        (b"ISO-10303-21;" + 3000 * b" ", [], "the limit for STEP is 2,000"),
        (b"", ["--html", "x.html"], "omit --html"),
        (b"", ["--watch"], "omit --watch"),
    ],
)
def test_what_cannot_be_shown_is_refused_before_a_page_opens(tmp_path, capsys, monkeypatch, content, options, text):
    path = tmp_path / "x.step"
    if content is not None:
        path.write_bytes(content)
    monkeypatch.setitem(budget.BUDGETS, "STEP", budget.Budget(2000))
    assert main(["view", str(path), "--port", "0", "--no-browser", *options]) == 2
    assert text in capsys.readouterr().err
