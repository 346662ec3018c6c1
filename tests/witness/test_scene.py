"""Scenes with a console, as exported: programs that nobody here wrote hold every arm where the console takes it over,
and the shaft stays on its port by the linkage alone.
"""

from __future__ import annotations

import json

import numpy as np
import pytest

import twin
from made.lanes import nightly
from twin.api.scene_export import export_scene
from twin.core import assets, spatial
from twin.model.scene import load_scene

LED = [s for s in assets.scenes() if not load_scene(assets.scene_file(s)).has_protocols]
RATE, SECONDS = 1000, 1.0
RCM_MUJOCO, RCM_PHYSX = 1e-6, 5e-6
"""m that the shaft may be off its port; PhysX is single precision, and starts 0.6 um off."""
NO = float("nan")
pytestmark = pytest.mark.witness


@pytest.fixture(scope="module", params=nightly(LED, every=2))
def exported(request, tmp_path_factory):
    """(scene, folder, {place: mechanism as exported}) of a scene."""
    folder = tmp_path_factory.mktemp(request.param)
    bundle = export_scene(assets.scene_file(request.param), folder, ("usd", "glb", "mjcf"))
    assert bundle.verdict == "agree"
    return bundle.scene, folder, {n: b.order.mechanism for n, b in bundle.bundles.items()}


def off_port(mechanism, p_port, T_of) -> float:
    """Return how far the axis of the joint behind the insertion, about which the shaft turns, passes the port, m.

    `T_of` gives the pose of a body, in the frame in which the port is (3,).
    """
    slide = next(j for j in mechanism.tree if j.active and j.type == "prismatic")
    turn = next(j for j in mechanism.tree if j.parent == slide.child)
    T = T_of(turn.parent) @ turn.T_parent_joint
    to = p_port - T[:3, 3]
    return float(np.linalg.norm(to - T[:3, 2] * (T[:3, 2] @ to)))


def test_mujoco_holds_each_arm_on_its_port(exported, figures):
    import mujoco

    scene, folder, mechanisms = exported
    for place in scene.places:
        model = mujoco.MjModel.from_xml_path(str(folder / place.name / f"{place.robot}.xml"))
        data = mujoco.MjData(model)
        (port,) = (spatial.inverse(place.T_world_base) @ [*p, 1] for p in place.p_world_ports.values())

        def pose(body, data=data):
            return spatial.pose(data.body(body).xmat.reshape(3, 3), data.body(body).xpos)

        worst = 0.0
        for _ in range(int(SECONDS / model.opt.timestep)):
            mujoco.mj_step(model, data)
            worst = max(worst, off_port(mechanisms[place.name], port[:3], pose))
        figures.add(f"mujoco {mujoco.__version__}", f"{scene.name}/{place.name}", f"{SECONDS:g} s", worst, NO, "RCM")
        assert worst <= RCM_MUJOCO


@pytest.mark.witness("physx")
def test_physx_holds_all_arms_of_the_stage_on_their_ports(exported, foreign, figures):
    scene, folder, mechanisms = exported
    job = folder / "job.json"
    robots = [f"{scene.name}/{p.name}" for p in scene.places]
    stage = folder / "usd" / f"{scene.name}_sim.usda"
    job.write_text(
        json.dumps({"stage": str(stage), "robots": robots, "rate": RATE, "steps": int(SECONDS * RATE), "every": 100})
    )
    answer = foreign.read("physx", "read_physx.py", job)
    for place in scene.places:
        found = answer[f"{scene.name}/{place.name}"]
        (port,) = place.p_world_ports.values()
        for what in ("start", "run"):
            rows = {n: np.array(v) for n, v in found[what].items()}
            count = len(next(iter(rows.values())))

            def pose(body, k, rows=rows):
                x, y, z, *quaternion = rows[body][k]
                return spatial.pose(spatial.matrix_from_quat_wxyz(np.roll(quaternion, 1)), [x, y, z])

            mechanism = mechanisms[place.name]
            worst = max(off_port(mechanism, port, lambda b, k=k: pose(b, k)) for k in range(count))
            figures.add("physx", f"{scene.name}/{place.name}", what, worst, NO, "RCM")
            assert worst <= RCM_PHYSX
        moved = max(float(np.abs(np.array(v)[:, :3] - found["start"][n][0][:3]).max()) for n, v in found["run"].items())
        figures.add("physx", f"{scene.name}/{place.name}", "run", moved, NO, "any link")
        assert moved <= 20e-6


@pytest.mark.witness("nvidia", "node")
def test_validators_find_nothing_in_the_scene(exported, foreign, figures):
    scene, folder, _ = exported
    stages = [folder / "usd" / f"{scene.name}{end}.usda" for end in ("", "_sim")]
    printed = foreign.read("nvidia", "check_nvidia.py", "--same-meshes", *stages)
    glbs = [folder / p.name / f"{p.robot}.glb" for p in scene.places]
    khronos = foreign.read("node", "check_glb.mjs", *glbs)
    for said, files in ((printed, stages), (khronos, glbs)):
        for file in files:
            found = said[str(file)]
            what = f"{len(found)} issues" if said is printed else f"{found['errors']} errors"
            figures.add(said["version"], scene.name, file.name, NO, NO, what)
    assert not any(printed[str(s)] for s in stages), printed
    assert all(khronos[str(g)][k] == 0 for g in glbs for k in ("errors", "warnings", "infos", "hints"))


WITHHELD = {"SR.002", "SR.004"}
"""Of SimReady: a picture, and what a publisher says (author, licence, class, date). twin writes none of it."""


@pytest.mark.witness("simready")
def test_simready_asks_only_for_what_a_publisher_says(exported, foreign, figures):
    scene, folder, _ = exported
    place = scene.places[0]
    stage = folder / place.name / "usd" / f"{place.robot}.usda"
    found = foreign.read("simready", "check_simready.py", "Robot-Body", "3.0.0", stage)
    count = f"{len(found['passed'])} features passed; required: {sorted(found['required'])}"
    figures.add(found["version"], place.robot, stage.name, NO, NO, count)
    assert set(found["required"]) == WITHHELD
    physics = {f"FET_{n}_{kind}" for n in ("003", "004", "022", "024") for kind in ("STANDARD", "PHYSX")}
    assert physics <= set(found["passed"])


def test_the_audit_proves_the_folder(exported):
    scene, folder, _ = exported
    report = twin.audit(folder)
    assert report.verdict == "agree"
    of_files = [check for check in report.checks if check.against != "a new export"]
    assert {c.file.split("/")[0] for c in of_files} == {"scene.json", "usd", *(p.name for p in scene.places)}
    assert len(of_files) == len(report.checks) - 1
