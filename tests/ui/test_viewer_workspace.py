"""The reachable set: right pose by pose, and computed by a process that can be stopped, fails in words and ends."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import twin
from made.lanes import thinned
from twin.core.errors import KinematicsError, TwinError
from twin.core.units import MM
from twin.kinematics import conditioning
from twin.kinematics.closed_loops.bounds import Bound
from twin.ui.session import workspace_cloud
from twin.ui.session.movable_robot import MovableRobot
from twin.ui.session.workspace_cloud import Cloud, WorkspaceJob, evaluate, poses

REACH = {"sils": 0.3, "sher": 0.05, "pa10": 0.8, "lapbot": 0.15, "hibou": 0.1}
ENDLESS = 10**9

FORWARD_ONLY = '''
import casadi as ca
from twin.formula.contract import ActiveJoint, Coordinates, Equation, Formula
from twin.kinematics import symbolic

FORMULA = Formula(
    name="slide", title="three slides", source="test", parameters=(),
    joints=tuple(ActiveJoint(n, "prismatic") for n in ("turn", "slide", "lift")),
    coordinates=Coordinates(
        ("x", "y", "z"), ("m",) * 3,
        lambda x, y, z: symbolic.pose(symbolic.rotation_x(0), ca.vertcat(x, y, z)),
        lambda T: (T[0, 3], T[1, 3], T[2, 3]),
    ),
    equations=(
        Equation("eq1", "joints -> pose", "test", "forward", ("T_base_tool",),
                 {"corrected": lambda turn, slide, lift:
                  symbolic.pose(symbolic.rotation_x(0), ca.vertcat(turn, slide, lift))}),
    ),
    characteristic_length=lambda: 0.1,
    points={"tool": ("x", "y", "z")},
)
'''  # fmt: skip


def home_job(name: str, count: int = 500, **changes) -> WorkspaceJob:
    """Return the job about a robot's home posture, with its own limits."""
    robot = twin.load(name)
    T = robot.kinematics().forward(robot.mechanism.posture("home"))
    limits = np.array([j.limits for j in robot.mechanism.active])
    return replace(WorkspaceJob(name, None, {}, limits, T, REACH[name], count), **changes)


@pytest.fixture(scope="module")
def sils() -> WorkspaceJob:
    return home_job("sils")


@pytest.fixture(scope="module")
def shared():
    cloud = Cloud()
    yield cloud
    cloud.close()


def joined(chunks) -> tuple[np.ndarray, np.ndarray]:
    chunks = list(chunks)
    return np.concatenate([c.points for c in chunks]), np.concatenate([c.condition for c in chunks])


def wait(cloud: Cloud, until=lambda c: c.error or c.evaluated == c.count) -> list[workspace_cloud.WorkspaceChunk]:
    """Poll until a chunk is the one that is waited for; return all."""
    chunks, end = [], time.monotonic() + 300  # a nice process on a busy machine
    while not chunks or not until(chunks[-1]):
        assert time.monotonic() < end, "nothing came"
        if (chunk := cloud.poll()) is not None:
            chunks.append(chunk)
        time.sleep(0.005)
    return chunks


def children() -> set[int]:
    """Return the processes that this one has started and that run."""
    stats = ([*p.read_text().rpartition(")")[2].split(), p.parent.name] for p in Path("/proc").glob("[0-9]*/stat"))
    return {int(s[-1]) for s in stats if int(s[1]) == os.getpid() and s[0] != "Z"}


# --------------------------------------------------------------------------------- what is evaluated


def test_poses_begin_at_the_present_one_and_fill_the_box_evenly_from_the_start(sils):
    Ts = poses(sils, 0, 4000)
    np.testing.assert_allclose(Ts[0], sils.T_base_tool, atol=1e-15)
    assert (Ts[:, :3, :3] == sils.T_base_tool[:3, :3]).all()
    box = (Ts[:, :3, 3] - sils.T_base_tool[:3, 3]) / sils.reach
    assert np.abs(box).max() <= 1
    for first in (0, 3000):
        cells = np.floor((box[first : first + 1000] + 1) * 2).astype(int)
        share = np.bincount(cells @ [16, 4, 1], minlength=64)
        assert share.min() >= 12  # of 15.6
        assert share.max() <= 20
    np.testing.assert_array_equal(poses(sils, 700, 900), Ts[700:900])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sils", "sher", "pa10", "lapbot"])
def test_agrees_pose_by_pose_with_the_equations(name, monkeypatch):
    monkeypatch.setattr(workspace_cloud, "POSES_PER_CHECK", 150)
    job, kin = home_job(name), twin.load(name).kinematics()
    points, condition, out = [], [], 0
    for T in poses(job, 0, job.count):
        try:
            q = kin.inverse(T)
        except KinematicsError:
            out += 1
            continue
        if ((q < job.limits[:, 0]) | (q > job.limits[:, 1])).any():
            out += 1
            continue
        points.append(T[:3, 3])
        condition.append(kin.condition(T))
    assert points
    assert out  # else nothing is shown to be left out
    chunks = list(evaluate(job))
    assert [c.evaluated for c in chunks] == [150, 300, 450, 500]
    found = joined(chunks)
    assert found[0].dtype == found[1].dtype == np.float32
    np.testing.assert_allclose(found[0], points, atol=1e-7)
    np.testing.assert_allclose(found[1], condition, rtol=1e-6)


def test_narrower_limits_leave_exactly_what_keeps_them(sils):
    limits = sils.limits.copy()
    limits[0] = (0.2, 0.4)
    q = twin.load("sils").kinematics().inverse_many(poses(sils, 0, 5000))
    kept = ((q >= limits[:, 0]) & (q <= limits[:, 1])).all(axis=1)
    wide, narrow = (joined(evaluate(replace(sils, count=5000, limits=x)))[0] for x in (sils.limits, limits))
    assert 0 < len(narrow) == kept.sum() < len(wide)
    assert {tuple(p) for p in narrow} < {tuple(p) for p in wide}


def test_carriages_of_one_rail_and_motors_leave_exactly_what_keeps_their_limits(sils):
    """The page and `twin workspace` ask one kernel, so that they cannot differ."""
    kin, gap = twin.load("sils").kinematics(), 0.1
    (_, upper), (lower, _) = (1, 0), (0, 1)
    row = np.zeros(6)
    row[[lower, upper]] = -1.0, 1.0
    q = kin.inverse_many(poses(sils, 0, sils.count))
    kept = [k for k in range(sils.count) if ((q[k] >= sils.limits[:, 0]) & (q[k] <= sils.limits[:, 1])).all()]
    near = [k for k in kept if gap <= q[k] @ row <= 0.3]
    assert 0 < len(near) < len(kept)
    found, _ = joined(evaluate(replace(sils, bounds=(Bound("1 2", "gap", row, gap), Bound("m", "motor", -row, -0.3)))))
    np.testing.assert_allclose(found, poses(sils, 0, sils.count)[near][:, :3, 3], atol=1e-7)


def test_parameters_and_variants_are_those_of_the_job(sils):
    own = joined(evaluate(sils))[0]
    shorter = joined(evaluate(replace(sils, parameters={"l_2": 350 * MM})))[0]
    assert len(own) != len(shorter)
    with pytest.raises(KinematicsError, match="within the joint limits"):  # the odd carriages as printed are elsewhere
        list(evaluate(replace(sils, variants={"eq2": "printed"})))


def test_condition_numbers_of_many_are_those_of_single_ones():
    rng = np.random.default_rng(0)
    for shape in ((6, 6), (6, 5), (6, 7)):
        U, V = (np.linalg.qr(rng.normal(size=(40, n, n)))[0] for n in shape)
        n = min(shape)
        S = np.zeros((40, *shape))
        S[:, np.arange(n), np.arange(n)] = np.geomspace(1, np.geomspace(1, 1e-12, 40), n, axis=-1)
        J = U @ S @ V
        np.testing.assert_allclose(conditioning.condition_many(J)[:25], np.linalg.cond(J)[:25], rtol=1e-7)
        np.testing.assert_allclose(conditioning.condition_many(J), np.linalg.cond(J), rtol=1e-2)
    J = np.stack([np.zeros((6, 6)), np.full((6, 6), np.nan), np.diag([1.0, 1, 1, 1, 1, 0]), np.eye(6)])
    np.testing.assert_array_equal(conditioning.condition_many(J), [np.inf, np.inf, np.inf, 1])
    assert conditioning.condition_many(J[:0]).shape == (0,)


# --------------------------------------------------------------------------------- what cannot be


def test_five_joints_that_cannot_hold_the_orientation_are_named_at_once():
    with pytest.raises(KinematicsError, match="hibou: its 5 joints cannot move"):
        next(evaluate(home_job("hibou", ENDLESS)))


def test_equations_without_a_closed_inverse_are_refused(tmp_path):
    (tmp_path / "cad").mkdir()
    shutil.copy(Path(__file__).parents[1] / "data/cad/crank.toml", tmp_path / "cad")
    (tmp_path / "formula.py").write_text(FORWARD_ONLY)
    with pytest.raises(KinematicsError, match="slide: its equations have no closed-form inverse"):
        next(evaluate(WorkspaceJob(str(tmp_path), None, {}, np.zeros((3, 2)), np.eye(4), 0.1)))


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"robot": "silz"}, "there is no robot 'silz'"),
        ({"parameters": {"l_9": 1.0}}, "there is no parameter 'l_9'"),
        ({"limits": np.zeros((5, 2))}, "limits"),
        ({"count": 0}, "the number of poses 0"),
        ({"limits": np.full((6, 2), 9.0)}, "none of 500 positions is within the joint limits with this orientation"),
        (
            {"T_base_tool": np.diag([1.0, 1, 1, 1]) + 9 * np.eye(4, k=3)},
            "none of 500 positions is reachable with this orientation",
        ),
    ],
)
def test_what_does_not_fit_or_finds_nothing_says_so(sils, changes, text):
    with pytest.raises(TwinError, match=text):
        list(evaluate(replace(sils, **changes)))


# --------------------------------------------------------------------------------- the process


@pytest.mark.slow
def test_cloud_gives_what_evaluate_gives(shared, sils):
    job = replace(sils, count=50_000)
    assert shared.poll() is None
    shared.start(job)
    chunks = wait(shared)
    assert chunks[-1].evaluated == chunks[-1].count == 50_000
    for got, want in zip(joined(chunks), joined(evaluate(job)), strict=True):
        np.testing.assert_array_equal(got, want)
    assert shared.poll() is None


@pytest.mark.slow
def test_errors_arrive_as_text_and_the_next_job_runs(shared, sils):
    for bad, text in (
        (replace(sils, parameters={"l_9": 1.0}), "there is no parameter 'l_9'"),
        (replace(sils, limits=None), "limits"),  # type: ignore[arg-type]
        (replace(sils, T_base_tool="no pose"), "IndexError"),  # type: ignore[arg-type]
        (replace(sils, limits=np.full((6, 2), 9.0)), "positions is within the joint limits with this orientation"),
    ):
        shared.start(bad)
        assert text in wait(shared)[-1].error
        assert shared.poll() is None
    shared.start(sils)
    assert wait(shared)[-1].evaluated == sils.count


@pytest.mark.slow
def test_cancel_stops_a_job_and_a_new_one_replaces_it(shared, sils):
    shared.start(replace(sils, count=ENDLESS))
    wait(shared, until=lambda c: c.evaluated > 0)
    shared.cancel()
    assert shared.poll() is None
    shared.start(replace(sils, count=ENDLESS))
    shared.start(sils)  # arrives only if the endless ones have stopped
    chunks = wait(shared)
    assert {c.count for c in chunks} == {sils.count}
    np.testing.assert_array_equal(joined(chunks)[0], joined(evaluate(sils))[0])


@pytest.mark.slow
def test_close_leaves_no_process_and_start_begins_another(sils):
    before = children()
    cloud = Cloud()
    cloud.cancel()
    cloud.close()
    cloud.start(replace(sils, count=ENDLESS))
    (pid,) = children() - before
    wait(cloud, until=lambda c: c.evaluated > 0)
    assert os.getpriority(os.PRIO_PROCESS, pid) == min(os.getpriority(os.PRIO_PROCESS, 0) + 10, 19)
    os.kill(pid, signal.SIGINT)
    wait(cloud, until=lambda c: c.evaluated > 0)  # it goes on
    cloud.close()
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    assert cloud.poll() is None
    cloud.close()
    cloud.start(replace(sils, count=ENDLESS))
    (pid,) = children() - before
    os.kill(pid, signal.SIGKILL)
    assert "ended by SIGKILL" in wait(cloud)[-1].error
    assert cloud.poll() is None
    assert children() == before
    cloud.close()


VIEWER = """
import time
import numpy as np
from twin.ui.session.movable_robot import MovableRobot
from twin.ui.session.workspace_cloud import Cloud, WorkspaceJob

if __name__ == "__main__":
    try:
        cloud = Cloud()
        cloud.start(WorkspaceJob("sils", None, {}, np.tile([-9.0, 9.0], (6, 1)), np.eye(4), 0.5, 10**9))
        while cloud.poll() is None:
            time.sleep(0.01)
        print("runs", flush=True)
        time.sleep(60)
    except KeyboardInterrupt:
        pass
"""


@pytest.mark.slow
@pytest.mark.parametrize("how", thinned([signal.SIGINT, signal.SIGKILL], every=2))
def test_nothing_is_left_of_a_viewer_that_does_not_close(tmp_path, how):
    script = tmp_path / "viewer.py"
    script.write_text(VIEWER)
    command, env = [sys.executable, str(script)], {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, env=env, start_new_session=True) as viewer:
        assert viewer.stdout is not None
        assert viewer.stdout.readline() == "runs\n"
        if how == signal.SIGINT:
            os.killpg(viewer.pid, how)  # as the terminal does: to viewer and worker
        else:
            viewer.kill()
        rest = viewer.communicate(timeout=300)  # ends when the last process that holds the pipes has ended
    assert rest == ("", "")


def test_the_job_has_the_trocar_of_the_protocol_and_changed_parameters():
    """The process loads the robot anew: without these numbers, it would compute the workspace of another port."""
    robot = twin.load("lapbot")
    port = robot.protocol("other_port")
    movable = MovableRobot(robot.bound(port))
    assert movable.parameters == {}  # the trocar of a bound robot is none of the changed parameters
    job = workspace_cloud.job_of(movable, "lapbot", 0.1, 500)
    trocar = [job.parameters[name] for name in ("trocar_x", "trocar_y", "trocar_z")]
    assert trocar == [0.42, 0.025, 0.29]  # as its file says; the robot's own is at 0.4, 0, 0.3
    name = next(iter(robot.kinematics().formula.parameters)).name
    movable.change(parameters={name: movable.kin.parameters[name] + 0.001})
    changed = workspace_cloud.job_of(movable, "lapbot", 0.1, 500)
    assert set(changed.parameters) == {"trocar_x", "trocar_y", "trocar_z", name}
    assert changed.parameters[name] == movable.kin.parameters[name]
