"""Compare two mechanisms independently of the choice of their body frames; used by the tests of `twin new`."""

from __future__ import annotations

import numpy as np

from twin import api
from twin.cad.build import read_mechanism
from twin.core.errors import AssemblyError
from twin.exchange.read import read
from twin.exchange.read.loop_closing import close
from twin.exchange.read.robot_folder import write_folder
from twin.reference import ReferenceModel
from twin.usd.read import read_stage


def made(source, name, folder, closures=None, root=None):
    """Import a file to a robot folder; return the import with closed loops, and the mechanisms of folder and stage."""
    imported = close(read(source, closures, root, guarded=False))
    write_folder(imported, name, folder, source)
    robot = api.load(folder)
    written = api.build(robot)[0]
    return imported, read_mechanism(robot.files.description).mechanism, read_stage(written)


def assert_same(a, b, tolerance=1e-12):
    """Assert that two mechanisms agree in names, joints in space, limits, drives, masses, frames and points.

    Body frames may differ, so everything is compared in the base frame, in the rest poses. In a stage, joints of the
    tree point away from the base. A joint may therefore have exchanged bodies; its frames are then rotated by 180 deg
    about x.
    """
    assert [x.name for x in a.bodies] == [x.name for x in b.bodies]
    assert {j.name for j in a.loops} == {j.name for j in b.loops}
    assert [j.name for j in a.active] == [j.name for j in b.active]
    by_name = {j.name: j for j in b.joints}
    for j in a.joints:
        k = by_name.pop(j.name)
        assert j.type == k.type
        sides = {k.parent: k.T_parent_joint, k.child: k.T_child_joint}
        turn = np.eye(4) if k.parent == j.parent else np.diag([1.0, -1.0, -1.0, 1.0])
        for body, T in ((j.parent, j.T_parent_joint), (j.child, j.T_child_joint)):
            np.testing.assert_allclose(a.rest[body] @ T, b.rest[body] @ sides[body] @ turn, atol=tolerance)
        for key in ("limits", "soft_limits", "max_speed", "max_acceleration", "max_jerk", "cone"):
            x, y = getattr(j, key), getattr(k, key)
            assert (x is None) == (y is None), (j.name, key)
            if x is not None:
                np.testing.assert_allclose(x, y, atol=max(tolerance, 1e-14), rtol=1e-6)
        assert (j.drive is None) == (k.drive is None)
        if j.drive and k.drive:
            x, y = ((d.stiffness, d.damping, d.max_effort or -1) for d in (j.drive, k.drive))
            np.testing.assert_allclose(x, y, rtol=1e-6)
    assert not by_name
    for x, y in zip(a.bodies, b.bodies, strict=True):
        assert (x.inertia is None) == (y.inertia is None)
        if x.inertia and y.inertia:
            np.testing.assert_allclose(x.inertia.mass, y.inertia.mass, rtol=1e-6)
            com = [(m.rest[x.name] @ np.append(i.p_body_com, 1))[:3] for m, i in ((a, x.inertia), (b, y.inertia))]
            np.testing.assert_allclose(*com, atol=max(tolerance, 1e-12))
            turned = [
                m.rest[x.name][:3, :3] @ i.I_com @ m.rest[x.name][:3, :3].T for m, i in ((a, x.inertia), (b, y.inertia))
            ]
            np.testing.assert_allclose(*turned, rtol=1e-5, atol=1e-5 * np.abs(turned[0]).max())
        assert len(x.meshes) == len(y.meshes)
        for p, q in zip(x.meshes, y.meshes, strict=True):
            np.testing.assert_allclose(p.color_rgba, q.color_rgba, atol=1e-6)
            corners = [_box(m.rest[x.name], s.vertices) for m, s in ((a, p), (b, q))]
            np.testing.assert_allclose(*corners, atol=max(tolerance, 1e-7))
    for frame in a.frames:
        other = b.frame(frame.name)
        assert other.body == frame.body
        at = [m.rest[frame.body] @ f.T_body_frame for m, f in ((a, frame), (b, other))]
        np.testing.assert_allclose(*at, atol=tolerance)
    for point in a.points:
        at = [m.rest[point.body] @ np.append(p.p_body, 1) for m, p in ((a, point), (b, b.point(point.name)))]
        np.testing.assert_allclose(*at, atol=tolerance)
    assert [c.name for c in a.couplings] == [c.name for c in b.couplings]
    for c, d in zip(a.couplings, b.couplings, strict=True):
        x, y = (dict(zip(e.joints, e.ratios, strict=True)) for e in (c, d))  # the order of the joints may differ
        assert x.keys() == y.keys()
        np.testing.assert_allclose([*x.values(), c.total], [*(y[k] for k in x), d.total], rtol=1e-9, atol=1e-12)


def _box(T, vertices):
    points = vertices @ T[:3, :3].T + T[:3, 3]
    return np.array([points.min(axis=0), points.max(axis=0)])


def moved_from_rest(m, state):
    """Return the motion (4, 4) of each body from its rest pose, in base; it is independent of the body frames."""
    return {b.name: state.link_poses[b.name] @ np.linalg.inv(m.rest[b.name]) for b in m.bodies}


def worst_apart(mechanisms, rng, count=10, reach=0.2):
    """Return (largest difference of a link's motion from the first mechanism's, largest loop gap in m).

    The first mechanism is solved at `count` random values of its driven joints around home; at least half of them must
    be reachable. The other mechanisms get the values of all its joints, because a mechanism may have more degrees of
    freedom than driven joints. The difference is the largest entry of the difference of two motions (4, 4).
    """
    models = [ReferenceModel(m) for m in mechanisms]
    home = models[0].home()
    worst, gap, reached = 0.0, 0.0, 0
    scale = np.where([j.is_angle for j in mechanisms[0].active], 1.0, 0.1)
    for _ in range(count):
        try:
            first = models[0].solve(home.q + rng.uniform(-reach, reach, len(home.q)) * scale, home)
        except AssemblyError:
            continue
        reached += 1
        there = moved_from_rest(mechanisms[0], first)
        gap = max(gap, first.worst_gap)
        for m, model in zip(mechanisms[1:], models[1:], strict=True):
            state = model.state(_taken_over(models[0], model, first.x))
            gap = max(gap, state.worst_gap)
            for body, T in moved_from_rest(m, state).items():
                worst = max(worst, float(np.abs(T - there[body]).max()))
    assert reached >= count / 2
    return worst, gap


def _taken_over(a, b, x):
    out = np.zeros(b.tree.model.nq)
    for name, i in a.tree.joint_id.items():
        j, k = a.tree.model.joints[i], b.tree.model.joints[b.tree.joint_id[name]]
        out[k.idx_q : k.idx_q + k.nq] = x[j.idx_q : j.idx_q + j.nq]
    return out
