"""Newton (on the CPU) as its users start it: a stage, the importer as it is, nothing set by hand, its MuJoCo solver.

    read_newton_stranger.py job.json

The job: {"stage", "seconds", "step", "stiff"}; with "stiff" the springs of loops get that time constant, which Newton's
importer cannot be told. Prints {"start": gap, "unplaced": m, "held": gap, "moved": m, "skipped": warnings}: how far the
farthest loop is open, m, how far forward kinematics is from the authored poses, how far a link has moved, and what the
solver left out.
"""

import json
import sys
import warnings
from pathlib import Path

import newton
import numpy as np
import warp as wp

wp.config.quiet = True
job = json.loads(Path(sys.argv[1]).read_text())
builder = newton.ModelBuilder()
newton.solvers.SolverMuJoCo.register_custom_attributes(builder)
builder.add_usd(job["stage"])
model = builder.finalize(device="cpu")
now, then, control = model.state(), model.state(), model.control()
authored = model.body_q.numpy()[:, :3].copy()
newton.eval_fk(model, model.joint_q, model.joint_qd, now)
tied = model.joint_articulation.numpy() < 0
ends = [
    (a.numpy()[tied], X.numpy()[tied].astype(float))
    for a, X in (
        (model.joint_parent, model.joint_X_p),
        (model.joint_child, model.joint_X_c),
    )
]


def points(T, bodies, frames):
    """Return where the frames of joints are on their bodies in the world, (n, 3)."""
    v, w, p = T[bodies, 3:6], T[bodies, 6:7], frames[:, :3]
    return T[bodies, :3] + p + 2 * np.cross(v, np.cross(v, p) + w * p)


def gap():
    T = now.body_q.numpy().astype(float)
    apart = points(T, *ends[0]) - points(T, *ends[1])
    return float(np.nan_to_num(np.linalg.norm(apart, axis=1), nan=np.inf).max(initial=0.0))


placed = now.body_q.numpy()[:, :3].copy()
answer = {"start": gap(), "unplaced": float(np.abs(placed - authored).max()), "loops": int(tied.sum())}
if job["seconds"]:
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        solver = newton.solvers.SolverMuJoCo(model, use_mujoco_cpu=True)
    answer["skipped"] = [str(w.message) for w in said if "Skipping" in str(w.message)]
    if job.get("stiff"):
        solver.mj_model.eq_solref[:] = (job["stiff"], 1.0)
        solver.mj_model.eq_solimp[:] = (0.9999, 0.9999, 0.001, 0.5, 2.0)
    held = moved = 0.0
    for step in range(round(job["seconds"] / job["step"])):
        now.clear_forces()
        solver.step(now, then, control, None, job["step"])
        now, then = then, now
        if step % 10 == 9:
            held = max(held, gap())
            moved = max(moved, float(np.nan_to_num(np.abs(now.body_q.numpy()[:, :3] - placed), nan=np.inf).max()))
    answer |= {"held": held, "moved": moved}
print(json.dumps(answer), flush=True)
