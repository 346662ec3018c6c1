"""The picture of the robot in a report: hard meshes; a picture that fails leaves the report."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from made import reports
from twin.ui.report import plots, raster, report_folder, robot_picture


def body(name, *meshes):
    made = []
    for vertices, triangles in meshes:
        made.append(SimpleNamespace(vertices=vertices, triangles=triangles, color_rgba=(0.5, 0.5, 0.5, 1.0)))
    return SimpleNamespace(name=name, meshes=made)


def sheet(n):
    """Return (vertices, triangles) of a square of 1 m with 2 n² triangles."""
    x, y = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1))
    vertices = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    corner = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    first = np.column_stack([corner, corner + 1, corner + n + 1])
    second = np.column_stack([corner + 1, corner + n + 2, corner + n + 1])
    return vertices, np.concatenate([first, second])


def test_an_empty_mesh_in_a_robot_with_too_many_triangles_is_left_out():
    empty = np.zeros((0, 3)), np.zeros((0, 3), int)
    bodies = [body("base", sheet(200), empty), body("link", empty)]
    mechanism: Any = SimpleNamespace(bodies=bodies, points=[], frames=[], joints=[])
    assembly: Any = SimpleNamespace(link_poses={"base": np.eye(4), "link": np.eye(4)})
    parts = robot_picture._triangles(mechanism, assembly, ())
    assert parts is not None
    vertices, triangles, colors = parts
    assert 0 < len(triangles) <= robot_picture.MAX_TRIANGLES
    assert len(colors) == len(triangles)
    assert triangles.max() < len(vertices)
    links, place = robot_picture._place(mechanism, assembly, ("link",))
    assert links == ("link",)
    np.testing.assert_array_equal(place, np.zeros(3))


def test_a_picture_that_fails_leaves_the_report_and_is_named_in_it(tmp_path, monkeypatch):
    def fails():
        raise ValueError("zero-size <array>")

    report = reports.make_report("disagree", 50)
    monkeypatch.setattr(report_folder, "drawable", lambda: False)  # plots take longer than all else
    monkeypatch.setattr(plots, "figures", lambda report: {})
    written = report_folder.write_report(report, tmp_path, ["html"], robot=fails)
    page = written["html"].read_text("utf-8")
    assert "picture of the robot could not be drawn (ValueError: zero-size &lt;array&gt;)" in page


def layers(count):
    """Return (vertices, triangles, colours) of squares one behind the other, the nearest one red, the others blue."""
    ahead = raster.VIEW_DIRECTION / np.linalg.norm(raster.VIEW_DIRECTION)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, ahead)
    square = np.array([-right - up, right - up, right + up, -right + up])
    vertices = np.concatenate([square + 0.01 * k * ahead for k in range(count)])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    triangles = np.concatenate([faces + 4 * k for k in range(count)])
    colors = np.tile(np.array([0, 0, 255], np.uint8), (len(triangles), 1))
    colors[:2] = [255, 0, 0]
    return vertices, triangles, colors


def test_more_points_than_allowed_make_a_coarser_picture_of_the_nearest_triangles(monkeypatch):
    vertices, triangles, colors = layers(12)
    monkeypatch.setattr(raster, "_MAX_POINTS", 2e5)
    monkeypatch.setattr(raster, "_POINTS_PER_BATCH", 30_000)
    drawn = []
    points = raster._points

    def counted(places, depth, faces, counts):
        drawn.append(counts.sum())
        return points(places, depth, faces, counts)

    monkeypatch.setattr(raster, "_points", counted)
    picture = raster.shaded_picture(vertices, triangles, colors, None)
    assert picture.shape == (raster.PICTURE_HEIGHT, raster.PICTURE_WIDTH, 3)
    assert sum(drawn) < 2.1e5
    assert len(drawn) > 3
    middle = picture[50:-50, 120:-120].reshape(-1, 3).astype(int)
    is_red = (middle[:, 0] > 100) & (middle[:, 2] < 20)
    assert is_red.mean() > 0.97


def test_the_picture_is_the_same_in_parts_and_at_once(monkeypatch):
    vertices, triangles, colors = layers(4)
    mark = np.array([0.1, 0.2, 0.3])
    monkeypatch.setattr(raster, "PICTURE_WIDTH", 100)
    monkeypatch.setattr(raster, "PICTURE_HEIGHT", 80)
    whole = raster.shaded_picture(vertices, triangles, colors, mark)
    monkeypatch.setattr(raster, "_POINTS_PER_BATCH", 40_000)
    np.testing.assert_array_equal(raster.shaded_picture(vertices, triangles, colors, mark), whole)
