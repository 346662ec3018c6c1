"""Newton (on the CPU) as its users start it: a stage or an MJCF, its importers as they are, its MuJoCo solver.

    read_newton_stranger.py

Reads paths of jobs, one a line, and answers each with a line. A job: {"stage" or "mjcf", "seconds", "step",
"ties": [[body, point, body, point, free]], "stiff", "times", "ways"}. "free" is the direction of the first body in
which a tie may slide, (0, 0, 0) if in none. "stiff" gives the springs of loops that time constant, which Newton's
importer of stages cannot be told. "ways" are how far each joint is driven from where it is loaded,
{joint: [m or rad]}, at "times"; "controls" are the same for the actuators of an MJCF, in their order. "couplings" are
[{joint: ratio}, sum] that should hold. The answer: {"start": gap, "unplaced": m, "held": gap, "moved": m, "late": m or
rad, "uncoupled": m or rad, "skipped": warnings}: how far the farthest tie is open, m, how far forward kinematics is
from the authored poses, how far a link has moved, how far a driven joint is from its way at the end, how far the joints
of a coupling are off their sum, and what the solver left out.
"""

import json
import sys
import warnings
from pathlib import Path

import newton
import numpy as np
import warp as wp

wp.config.quiet = True


def points(T, which, at):
    """Return where points of bodies are in the world, (n, 3)."""
    v, w, p = T[which, 3:6], T[which, 6:7], np.reshape(at, (-1, 3))
    return T[which, :3] + p + 2 * np.cross(v, np.cross(v, p) + w * p)


def answer(job):
    builder = newton.ModelBuilder()
    newton.solvers.SolverMuJoCo.register_custom_attributes(builder)
    if "stage" in job:
        builder.add_usd(job["stage"])
    else:
        with warnings.catch_warnings():  # two ties of one pin are two balls between the same bodies
            warnings.simplefilter("ignore")
            builder.add_mjcf(job["mjcf"], parse_meshes=False)  # masses are given; meshes would want trimesh
    model = builder.finalize(device="cpu")
    now, then, control = model.state(), model.state(), model.control()
    authored = model.body_q.numpy()[:, :3].copy()
    newton.eval_fk(model, model.joint_q, model.joint_qd, now)
    bodies = {label.rsplit("/", 1)[-1]: i for i, label in enumerate(model.body_label)}
    ends = [(np.array([bodies[t[k]] for t in job["ties"]], int), [t[k + 1] for t in job["ties"]]) for k in (0, 2)]
    free = np.reshape([t[4] for t in job["ties"]], (-1, 3))

    def gap():
        T = now.body_q.numpy().astype(float)
        apart = points(T, *ends[0]) - points(T, *ends[1])
        ways = points(T, ends[0][0], free) - T[ends[0][0], :3]
        apart -= ways * (ways * apart).sum(axis=1, keepdims=True)
        return float(np.nan_to_num(np.linalg.norm(apart, axis=1), nan=np.inf).max(initial=0.0))

    placed = now.body_q.numpy()[:, :3].copy()
    tied = int((model.joint_articulation.numpy() < 0).sum())
    found = {"start": gap(), "unplaced": float(np.abs(placed - authored).max()), "loops": tied}
    joints = {label.rsplit("/", 1)[-1]: i for i, label in enumerate(model.joint_label)}
    begin = model.joint_q.numpy().copy()
    starts = model.joint_q_start.numpy()
    driven = {name: int(starts[joints[name]]) for name in job.get("ways", {})}
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        solver = newton.solvers.SolverMuJoCo(model, use_mujoco_cpu=True)
    found["skipped"] = [str(w.message) for w in said if "Skipping" in str(w.message)]
    if job.get("stiff"):
        solver.mj_model.eq_solref[:] = (job["stiff"], 1.0)
        solver.mj_model.eq_solimp[:] = (0.9999, 0.9999, 0.001, 0.5, 2.0)
    # An MJCF's actuators have controls of their own, in the order of the file; a stage's drives have targets by joint.
    inputs = control.mujoco.ctrl if "mjcf" in job else control.joint_target_q
    rest = inputs.numpy().copy()
    steered = job.get("controls", list(job.get("ways", {}).values()))
    slots = list(range(len(steered))) if "mjcf" in job else list(driven.values())
    held = moved = uncoupled = 0.0
    for step in range(round(job["seconds"] / job["step"])):
        if driven:
            wanted = rest.copy()
            for slot, way in zip(slots, steered, strict=True):
                wanted[slot] += np.interp((step + 1) * job["step"], job["times"], way)
            inputs.assign(wanted)
        now.clear_forces()
        solver.step(now, then, control, None, job["step"])
        now, then = then, now
        if step % 10 == 9:
            held = max(held, gap())
            moved = max(moved, float(np.nan_to_num(np.abs(now.body_q.numpy()[:, :3] - placed), nan=np.inf).max()))
            if job.get("couplings"):
                newton.eval_ik(model, now, model.joint_q, model.joint_qd)
                q = model.joint_q.numpy().astype(float)
                sums = [sum(r * q[starts[joints[n]]] for n, r in c.items()) - total for c, total in job["couplings"]]
                uncoupled = max(uncoupled, float(np.nan_to_num(np.abs(sums), nan=np.inf).max()))
    newton.eval_ik(model, now, model.joint_q, model.joint_qd)
    went = model.joint_q.numpy() - begin
    late = [abs(went[at] - np.interp(job["seconds"], job["times"], job["ways"][n])) for n, at in driven.items()]
    found |= {"held": held, "moved": moved, "uncoupled": uncoupled, "late": float(max(late, default=0.0))}
    return found


for line in sys.stdin:
    print(json.dumps(answer(json.loads(Path(line.strip()).read_text()))), flush=True)
