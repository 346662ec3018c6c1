"""Exports used as a stranger uses them: the file is loaded and stepped, or played from a track, and nothing is set up.

MuJoCo and Drake on the MJCF, Newton's default importer on the stage, Pinocchio and yourdfpy on the URDF; every robot,
along its default protocol (`TWIN_ALL_PROTOCOLS=1`: along every one). PhysX is in test_engines.py, Drake's URDF too.
"""

from __future__ import annotations

import json
import os
from functools import cache

import numpy as np
import pytest

import twin
from made.motions import motions
from twin.core import spatial

pytestmark = pytest.mark.witness

ROBOTS = twin.names()
CASES = motions()
SECONDS = float(os.environ.get("TWIN_STRANGERS_SECONDS", "3"))
NEWTON_SECONDS = float(os.environ.get("TWIN_NEWTON_SECONDS", "1"))
"""s of motion along which Newton is driven; 0 takes it to its end."""
STARTED, HELD, PLAYED = 1e-6, 100e-6, 1e-6
"""m: how far a loop may be open as loaded, and while it moves; how far a link may be off that plays a track. What is
held is also how far the joints of a coupling may be off their sum, m or rad."""
OPENS = {("USD", "sher"): 0.1}
"""m: loops that Newton does not hold, as docs/headset.md says: it takes a hinge's second point from joint zero."""
LEAD = 2.0
"""s from home to the first key of a track."""


@cache
def scene(name: str, protocol: str):
    """Return the mechanism with its trocar where the protocol has it, the one as drawn, and the clip."""
    from twin.exchange.write.key_rate import make_clip

    robot = twin.load(name).weighed()
    chosen = robot.protocol(protocol)
    mechanism = robot.bound(chosen).mechanism
    return mechanism, robot.mechanism, make_clip(mechanism, twin.plan(robot, chosen))


def track_of(name: str, protocol: str, folder) -> dict:
    from twin.exchange.formats.tracks.write import write_tracks

    mechanism, drawn, clip = scene(name, protocol)
    return json.loads(write_tracks(mechanism, clip, folder, drawn)[0].read_text("utf-8"))


def load_mjcf(mechanism, folder):
    import mujoco

    from twin.exchange.formats.mjcf.write import write_mjcf

    model = mujoco.MjModel.from_xml_path(str(write_mjcf(mechanism, folder)))
    assert model.opt.timestep == 1e-3
    return mujoco, model, mujoco.MjData(model)


ON_PIN = {"spherical": [(0, 0, 0)], "revolute": [(0, 0, -1), (0, 0, 1)], "cylindrical": [(0, 0, -1), (0, 0, 1)]}
ON_BLOCK = [(0, 0, -1), (0, 0, 1), (1, 0, 0)]
"""Points of a joint, in units of 25 mm, that show whether it is open: of what slides or is fixed three."""


def ties_of(mechanism) -> list[tuple[str, np.ndarray, str, np.ndarray, np.ndarray]]:
    """Return the loops that a file closes as points of two bodies, by the mechanism, and the direction, seen by the
    first body, in which one may slide along the other: (0, 0, 0) if in none.
    """
    from twin.usd.write.spanning import spanning

    out = []
    for joint in spanning(mechanism).cut:
        free = joint.T_parent_joint[:3, 2] * (2 in joint.free_axes)
        for at in 0.025 * np.array(ON_PIN.get(joint.type, ON_BLOCK)):
            one, two = (T[:3, :3] @ at + T[:3, 3] for T in (joint.T_parent_joint, joint.T_child_joint))
            out.append((joint.parent, one, joint.child, two, free))
    return out


def told(ties) -> list[list]:
    """Return ties for a job."""
    return [[x if isinstance(x, str) else x.tolist() for x in tie] for tie in ties]


def closed_by(mechanism, kinds: tuple[str, ...]) -> int:
    """Return how many of its loops joints of such kinds close."""
    from twin.usd.write.spanning import spanning

    return sum(j.type in kinds for j in spanning(mechanism).cut)


def connects_of(mechanism) -> int:
    """Return how many ties of one point close the loops of its MJCF: of a ball one, of a pin two."""
    return closed_by(mechanism, ("spherical",)) + 2 * closed_by(mechanism, ("revolute",))


def mimics_of(mechanism) -> list[tuple[dict[str, float], float]]:
    """Return ratios and sum of the couplings that a stage holds as mimic joints: of two joints with ends."""
    out = []
    for c in mechanism.couplings:
        ends = (j.limits or j.type == "prismatic" for j in map(mechanism.joint, c.joints))
        if len(c.joints) == 2 and all(ends):
            out.append((dict(zip(c.joints, c.ratios, strict=True)), c.total))
    return out


class Watch:
    """How far ties are open, and joints of couplings off their sums, by arrays: asked at each step of minutes."""

    def __init__(self, mechanism, model, data):
        ties, slots = ties_of(mechanism), model.jnt_qposadr
        self._data = data
        self._ends = [(np.array([data.body(t[k]).id for t in ties], int), [t[k + 1] for t in ties]) for k in (0, 2)]
        self._free = np.reshape([t[4] for t in ties], (-1, 3, 1))
        self._ratios = np.zeros((len(mechanism.couplings), model.nq))
        for row, c in zip(self._ratios, mechanism.couplings, strict=True):
            for name, ratio in zip(c.joints, c.ratios, strict=True):
                row[slots[model.joint(name).id]] = ratio
        self._totals = np.array([c.total for c in mechanism.couplings])

    def open(self) -> float:
        """Return how far points that are tied are apart, m; of one that may slide, how far it is off its line."""
        R = self._data.xmat.reshape(-1, 3, 3)
        one, two = (self._data.xpos[body] + (R[body] @ np.reshape(at, (-1, 3, 1)))[..., 0] for body, at in self._ends)
        way = (R[self._ends[0][0]] @ self._free)[..., 0]
        off = one - two
        off -= way * (way * off).sum(axis=1, keepdims=True)
        return float(np.sqrt((off * off).sum(axis=1)).max(initial=0.0))

    def uncoupled(self) -> float:
        """Return how far the joints of a coupling are off their sum, m or rad."""
        return float(np.abs(self._ratios @ self._data.qpos - self._totals).max(initial=0.0))


@pytest.mark.parametrize("name", ROBOTS)
def test_mujoco_stands_still_as_loaded(figures, tmp_path, name):
    mechanism = scene(name, next(p for r, p in CASES if r == name))[0]
    mujoco, model, data = load_mjcf(mechanism, tmp_path)
    watch = Watch(mechanism, model, data)
    mujoco.mj_forward(model, data)
    start, before = watch.open(), data.xpos.copy()
    held = moved = 0.0
    for _ in range(round(SECONDS / model.opt.timestep)):
        mujoco.mj_step(model, data)
        held = max(held, watch.open())
        moved = max(moved, float(np.abs(data.xpos - before).max()))
    figures.add("mujoco, as loaded", name, "start", start, float("nan"), "loop gap")
    figures.add("mujoco, as loaded", name, f"{SECONDS:g} s at rest", held, float("nan"), "loop gap")
    figures.add("mujoco, as loaded", name, f"{SECONDS:g} s at rest", moved, float("nan"), "any link")
    assert (model.eq_type == mujoco.mjtEq.mjEQ_CONNECT).sum() == connects_of(mechanism)
    welds = closed_by(mechanism, ("prismatic", "cylindrical", "fixed"))
    assert (model.eq_type == mujoco.mjtEq.mjEQ_WELD).sum() == welds
    assert start <= STARTED
    assert held <= HELD
    assert moved <= HELD
    assert not any(w.number for w in data.warning)


@pytest.mark.parametrize(("name", "protocol"), CASES)
def test_mujoco_follows_a_track(figures, tmp_path, name, protocol):
    mechanism = scene(name, protocol)[0]
    mujoco, model, data = load_mjcf(mechanism, tmp_path)
    watch = Watch(mechanism, model, data)
    track = track_of(name, protocol, tmp_path)
    q = np.reshape(track["positions"], (track["frames"], -1))
    columns, home = driven_in(mechanism, model, track)
    ways = mechanism.motors(q[:, columns] - home)  # of motors, which cables may lead to several joints
    actuators = [model.actuator(n).id for n in mechanism.motor_names]
    assert len(actuators) == model.nu
    held, off, step = 0.0, 0.0, model.opt.timestep
    t = step * np.arange(1, round((LEAD + track["times"][-1]) / step) + 1)
    s = np.minimum(t / LEAD, 1.0)
    way = s**3 * (10 - 15 * s + 6 * s * s)
    goals = np.zeros((len(t), model.nu))
    for k, actuator in enumerate(actuators):
        goals[:, actuator] = way * np.interp(np.maximum(t - LEAD, 0.0), track["times"], ways[:, k])
    for goal in goals:
        data.ctrl[:] = goal
        mujoco.mj_step(model, data)
        held, off = max(held, watch.open()), max(off, watch.uncoupled())
    figures.add("mujoco, as loaded", name, f"{protocol}, driven", held, float("nan"), "loop gap")
    assert held <= HELD
    if mechanism.couplings:
        figures.add("mujoco, as loaded", name, f"{protocol}, driven", off, float("nan"), "couplings, um or urad")
    assert off <= HELD
    assert not any(w.number for w in data.warning)
    last = [abs(data.joint(j.name).qpos[0] - q[-1, i]) for j, i in zip(mechanism.active, columns, strict=True)]
    assert max(last) < 0.05  # its drives are springs, and the weight at home is all that they know of


def driven_in(mechanism, model, track) -> tuple[list[int], np.ndarray]:
    """Return the columns of a track that are driven joints, in the mechanism's order, and their values at home."""
    columns = [track["joints"].index(j.name) for j in mechanism.active]
    assert sorted(columns) == [i for i, active in enumerate(track["joint_active"]) if active]
    return columns, np.array([model.joint(j.name).qpos0[0] for j in mechanism.active])


def targets_of(mechanism, model, track) -> tuple[list[float], dict[str, list[float]], dict[str, tuple[float, float]]]:
    """Return times, where each joint is to go, and stiffness and damping at each joint: from home along a track.

    Motors that cables lead to several joints are to each joint the spring that they are to it alone. What a drive bears
    at home is added as the way that its stiffness needs for it, as the file's controls do.
    """
    columns, home = driven_in(mechanism, model, track)
    q = np.reshape(track["positions"], (track["frames"], -1))[:, columns]
    actuators = [model.actuator(n) for n in mechanism.motor_names]
    offset, stiffness, damping = np.array([a.biasprm[:3] for a in actuators]).T * [[1], [-1], [-1]]
    assert [a.gainprm[0] for a in actuators] == stiffness.tolist()
    to_motors = mechanism.motors(np.eye(len(home))).T  # (motors, joints)
    efforts = to_motors.T @ (offset - stiffness * (to_motors @ home))
    kp, kv = ((to_motors**2).T @ gains for gains in (stiffness, damping))
    s = np.linspace(0, 1, 100)
    way = (s**3 * (10 - 15 * s + 6 * s * s))[:, None]
    values = efforts / kp + np.concatenate([home + way * (q[0] - home), q[1:]])
    times = [*(LEAD * s), *(LEAD + np.array(track["times"][1:]))]
    names = [j.name for j in mechanism.active]
    gains = zip(kp.tolist(), kv.tolist(), strict=True)
    return times, dict(zip(names, values.T.tolist(), strict=True)), dict(zip(names, gains, strict=True))


@pytest.mark.parametrize(("name", "protocol"), CASES)
def test_drake_holds_the_loops_of_the_mjcf(foreign, figures, tmp_path, name, protocol):
    """At rest, then along a protocol: in Drake's discrete solver, with drives of the gains that the file has."""
    foreign.need("drake")
    mechanism = scene(name, protocol)[0]
    ties = told(ties_of(mechanism))
    _, model, _ = load_mjcf(mechanism, tmp_path)
    times, values, gains = targets_of(mechanism, model, track_of(name, protocol, tmp_path))
    file, path = str(tmp_path / f"{mechanism.name}.xml"), tmp_path / "job.json"
    job = {"mjcf": file, "step": 1e-3, "drives": gains, "ties": ties}
    for what, t, goals in (
        ("2 s at rest", [0.0, 2.0], {n: [v[0]] * 2 for n, v in values.items()}),
        (f"{protocol}, driven", times, values),
    ):
        path.write_text(json.dumps(job | {"times": list(map(float, t)), "targets": goals}))
        found = foreign.read("drake", "read_drake_stranger.py", path, timeout=900.0)
        figures.add("drake, as loaded", name, what, found["held"], float("nan"), "loop gap")
        assert found["constraints"] == connects_of(mechanism)  # Drake reads no welds
        assert found["start"] <= STARTED
        assert found["held"] <= HELD
        if "rest" in what and not mechanism.couplings:  # Drake reads no tendons: belts are not there
            figures.add("drake, as loaded", name, what, found["moved"], float("nan"), "any link")
            assert found["moved"] <= HELD


@pytest.mark.parametrize("name", ROBOTS)
def test_newtons_default_importer_starts_at_home(foreign, figures, tmp_path, name):
    """Its MuJoCo solver gives loops springs of its own, and places the second point of a hinge at joint zero."""
    from twin.exchange.formats.usd.write import write_usd
    from twin.usd.write.spanning import spanning

    foreign.need("newton")
    mechanism = scene(name, next(p for r, p in CASES if r == name))[0]
    write_usd(mechanism, [], tmp_path)
    ties = told(ties_of(mechanism))
    job = {
        "stage": str(tmp_path / f"{mechanism.name}_sim.usda"),
        "seconds": min(SECONDS, 2.0),
        "step": 1e-3,
        "ties": ties,
    }
    path, held = tmp_path / "job.json", {}
    for stiff in (0.0, 1e-3):
        path.write_text(json.dumps(job | {"stiff": stiff}))
        found = foreign.ask("newton", "read_newton_stranger.py", path, timeout=900.0)
        held[stiff] = found["held"]
        # Newton's MuJoCo solver has no tie for a slide: docs/headset.md says so.
        assert len(found["skipped"]) == closed_by(mechanism, ("prismatic", "cylindrical")), found["skipped"]
        assert found["loops"] == len(spanning(mechanism).cut)
        assert found["start"] <= STARTED
        assert found["unplaced"] <= 2e-6  # single precision, at more than 1 m
    figures.add("newton, as loaded", name, "start", found["start"], float("nan"), "loop gap")
    figures.add("newton, as loaded", name, "2 s at rest", held[0.0], float("nan"), "loop gap, MuJoCo's default springs")
    figures.add("newton, as loaded", name, "2 s at rest", held[1e-3], float("nan"), "loop gap, stiff springs")
    if all(j.type == "spherical" for j in spanning(mechanism).cut):
        assert held[0.0] <= 300e-6
        assert held[1e-3] <= HELD


@pytest.mark.parametrize(("name", "protocol"), CASES)
@pytest.mark.parametrize("file", ["MJCF", "USD"])
def test_newton_is_driven_along_a_protocol(foreign, figures, tmp_path, file, name, protocol):
    """The MJCF as loaded, with the springs of its loops; the stage with stiff ones, where Newton places them right.

    `TWIN_NEWTON_SECONDS` of motion; 0 is all of it, which takes 17 minutes for the MJCF of all robots.
    """
    from twin.exchange.formats.usd.write import write_usd

    foreign.need("newton")
    mechanism = scene(name, protocol)[0]
    _, model, _ = load_mjcf(mechanism, tmp_path)
    times, values, _ = targets_of(mechanism, model, track_of(name, protocol, tmp_path))
    ways = {n: np.array(v) - v[0] for n, v in values.items()}
    motors = dict(zip(mechanism.motor_names, mechanism.motors(np.array(list(ways.values())).T).T, strict=True))
    controls = [motors[model.actuator(i).name].tolist() for i in range(model.nu)]  # in the order of the file
    ties = told(ties_of(mechanism))
    job = {
        "step": 1e-3,
        "ties": ties,
        "times": list(map(float, times)),
        "ways": {n: w.tolist() for n, w in ways.items()},
    }
    if file == "MJCF":
        job |= {"mjcf": str(tmp_path / f"{mechanism.name}.xml"), "controls": controls}
    else:
        write_usd(mechanism, [], tmp_path)
        job |= {"stage": str(tmp_path / f"{mechanism.name}_sim.usda"), "stiff": 1e-3, "couplings": mimics_of(mechanism)}
    path = tmp_path / "job.json"
    path.write_text(json.dumps(job | {"seconds": min(float(times[-1]), NEWTON_SECONDS or np.inf)}))
    found = foreign.ask("newton", "read_newton_stranger.py", path, timeout=3600.0)
    figures.add(f"newton, {file}", name, "start", found["start"], float("nan"), "loop gap")
    figures.add(f"newton, {file}", name, f"{protocol}, driven", found["held"], float("nan"), "loop gap")
    assert found["start"] <= STARTED
    if (file, name) in OPENS:
        assert HELD < found["held"] <= OPENS[file, name], "Newton holds it now: docs/headset.md says that it does not"
        return
    assert found["held"] <= HELD
    if job.get("couplings"):
        off = found["uncoupled"]
        figures.add(f"newton, {file}", name, f"{protocol}, driven", off, float("nan"), "couplings, um or urad")
        assert off <= HELD
    assert found["late"] < 0.05


@pytest.mark.parametrize(("name", "protocol"), CASES)
@pytest.mark.parametrize("player", ["pinocchio", "yourdfpy"])
def test_a_urdf_is_played_from_a_track(foreign, figures, tmp_path, player, name, protocol):
    from twin.exchange.formats.urdf.write import write_urdf

    _, drawn, _ = scene(name, protocol)
    track = track_of(name, protocol, tmp_path)
    keys = np.unique(np.linspace(0, track["frames"] - 1, 24).astype(int))
    q = np.reshape(track["positions"], (track["frames"], -1))[keys]
    frames = [dict(zip(track["joints"], row.tolist(), strict=True)) for row in q]
    seven = np.reshape(track["poses"], (track["frames"], -1, 7))[keys]
    urdf = write_urdf(drawn, tmp_path)
    if player == "pinocchio":
        links = played_by_pinocchio(urdf, frames)
    else:
        path = tmp_path / "job.json"
        path.write_text(json.dumps({"urdf": str(urdf), "base": drawn.base, "frames": frames}))
        answer = foreign.read("yourdfpy", "read_yourdfpy.py", path)
        assert answer["unnamed"] == []
        links = {n: np.array(Ts) for n, Ts in answer["links"].items()}
    position = rotation = 0.0
    for i, link in enumerate(track["links"]):
        R = spatial.matrix_from_quat_wxyz(seven[:, i, [6, 3, 4, 5]])
        turned = np.swapaxes(links[link][:, :3, :3], 1, 2) @ R
        position = max(position, float(np.linalg.norm(links[link][:, :3, 3] - seven[:, i, :3], axis=1).max()))
        rotation = max(rotation, float(spatial.rotation_angle(turned).max()))
    figures.add(player, name, f"{protocol}, URDF from the track", position, rotation, f"{len(links)} links")
    assert position <= PLAYED
    assert rotation <= 1e-5


def played_by_pinocchio(urdf, frames):
    import pinocchio as pin

    model = pin.buildModelFromUrdf(str(urdf))
    data, out = model.createData(), {f.name: [] for f in model.frames}
    for frame in frames:
        q = pin.neutral(model)
        for joint, name in zip(model.joints[1:], model.names[1:], strict=True):
            v = frame[name]
            q[joint.idx_q : joint.idx_q + joint.nq] = v if joint.nq == 1 else [np.cos(v), np.sin(v)]
        pin.framesForwardKinematics(model, data, q)
        for f in model.frames:
            out[f.name].append(data.oMf[model.getFrameId(f.name)].homogeneous.copy())
    return {n: np.array(Ts) for n, Ts in out.items()}
