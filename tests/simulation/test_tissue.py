"""Soft organs: they give way to instruments, keep their volume and return to rest; bad input is refused."""

from __future__ import annotations

import copy
import os
import time
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.interpolate import RegularGridInterpolator

import twin
from made import organs as made
from made.lanes import contrasting, designs, nightly
from made.loops import two_links
from twin.core import spatial
from twin.core.errors import TwinError, WorldError
from twin.core.units import MM
from twin.model.surface import Surface, inside, nearest, rings, volume
from twin.simulation.limits import JointLimits
from twin.simulation.plants.kinematic import Kinematic
from twin.simulation.plants.tissue import Links, Organs, Tissues, Tool
from twin.simulation.world import Block, Placed, World

LONG = float(os.environ.get("TWIN_TISSUE_SECONDS", "12"))
"""Simulated time in s of random instruments for each seed in the slow lane; 360 is an hour in all."""


def change(organs, tissue):
    return abs(volume(organs.vertices(tissue.name), tissue.surface.triangles) / tissue.surface.volume - 1)


def off(organs, tissue):
    return np.linalg.norm(organs.vertices(tissue.name) - tissue.surface.vertices, axis=1)


# -- surfaces ------------------------------------------------------------------------------------------


def test_surface_is_refined_without_gaps():
    box = trimesh.creation.box((0.1, 0.05, 0.02))
    fine = Surface("box", box.vertices, box.faces, 0.008)
    again = trimesh.Trimesh(fine.vertices, fine.triangles, process=False)
    assert again.is_watertight
    assert again.is_winding_consistent
    assert again.volume == pytest.approx(box.volume, rel=1e-12)
    assert again.edges_unique_length.max() <= 0.008


BOX = trimesh.creation.box((0.1, 0.1, 0.1))


@pytest.mark.parametrize(
    ("vertices", "triangles", "edge", "message"),
    [
        (BOX.vertices, BOX.faces[1:], np.inf, r"surface 'liver' is open: 3 edges .* at \(.*\) mm"),
        (BOX.vertices, BOX.faces[:, ::-1], np.inf, r"is inverted: its volume is -1e\+03 cm3"),
        (
            BOX.vertices,
            np.r_[BOX.faces[:1, ::-1], BOX.faces[1:]],
            np.inf,
            "triangles of both orientations: 3 edges join two triangles of different",
        ),
        (BOX.vertices, BOX.faces, 0.001, "is too fine: more than 6000 vertices; allow longer edges"),
        (trimesh.creation.icosphere(6).vertices, trimesh.creation.icosphere(6).faces, np.inf, "draw it coarser"),
        (BOX.vertices, BOX.faces[:0], np.inf, "is empty"),
        (BOX.vertices * np.nan, BOX.faces, np.inf, "is not finite"),
    ],
)
def test_surface_that_is_no_organ_is_refused(vertices, triangles, edge, message):
    with pytest.raises(TwinError, match=message):
        Surface("liver", vertices, triangles, edge)


def test_inside_agrees_with_the_shape():
    rng = np.random.default_rng(0)
    ball = trimesh.creation.icosphere(3)
    p = rng.uniform(-1.2, 1.2, (400, 3))
    r = np.linalg.norm(p, axis=1)
    clear = abs(r - 1) > 0.02
    assert (inside(p, ball.vertices, ball.faces) == (r < 1))[clear].all()


def test_rings_count_outwards_by_shared_corners():
    grid = np.arange(49).reshape(7, 7)
    a, b, c, d = (grid[i : i + 6, k : k + 6].ravel() for i, k in ((0, 0), (0, 1), (1, 1), (1, 0)))
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    level = rings(triangles, 21)
    for k in range(1, level.max() + 1):
        for t in np.flatnonzero(level == k):
            beside = (np.isin(triangles, triangles[t])).any(axis=1)
            assert level[beside].min() == k - 1
    assert level[21] == 0
    assert (level >= 0).all()


# -- the material --------------------------------------------------------------------------------------


@pytest.mark.slow
def test_small_pushes_are_linear_and_the_stiffness_is_that_of_the_material():
    organ = made.block()
    x, F = [], []
    start = (0.0, 0.0, 0.081)
    for organs in made.pushed(organ, made.plate(), start, np.array([1.5, 2.0, 2.5, 3.0]) * MM):
        x.append(0.08 - organs.vertices("block")[:, 2].max())
        F.append(-organs.touches()["block"].force[2])
    k = np.array(F) / x
    assert np.ptp(k) < 0.05 * k.mean()
    # between free faces (uniaxial stress), E A / L, and faces that cannot widen, a bonded incompressible pad,
    # (1 + S^2) E A / L, S = loaded area / free area; A. N. Gent, P. B. Lindley, doi:10.1243/PIME_PROC_1959_173_022_02
    free = 5e3 * 0.12 * 0.1 / 0.08
    shape = 0.12 * 0.1 / (2 * (0.12 + 0.1) * 0.08)
    assert free < k.mean() < free * (1 + 2 * shape**2) * 1.2


@pytest.mark.slow
def test_nodes_and_vertices_are_those_of_mujoco():
    import mujoco

    organ = made.ball(cells=(3, 2, 2))
    *_, organs = made.pushed(organ, made.rod(), (0.02, 0.01, 0.082), [0.01])
    inner = organs._organs["ball"]
    mujoco.mj_forward(organs._model, organs._data)
    assert np.abs(organs._data.flexvert_xpos - organs.vertices("ball")).max() < 1e-12
    content, by_node = inner._volume.at(inner.nodes)
    assert content == pytest.approx(volume(organs.vertices("ball"), organ.surface.triangles), rel=1e-10)
    turned = np.random.default_rng(1).normal(size=by_node.shape)
    more, less = (inner._volume.at(inner.nodes + s * 1e-6 * turned)[0] for s in (1, -1))
    assert (more - less) / 2e-6 == pytest.approx(float(np.vdot(by_node, turned)), rel=1e-6)


@pytest.mark.slow
def test_symmetric_push_gives_a_symmetric_dent_that_decays_with_the_rings():
    organ = made.ball()
    *_, organs = made.pushed(organ, made.rod(), (0.0, 0.0, 0.081), [0.012])
    v, moved = organ.surface.vertices, organs.vertices("ball") - organ.surface.vertices
    for axis in (0, 1):
        mirror = np.where(np.arange(3) == axis, -1.0, 1.0)
        other = [int(np.argmin(np.linalg.norm(v - p, axis=1))) for p in v * mirror]
        assert np.abs(moved[other] - moved * mirror).max() < 0.05 * MM
    touch = organs.touches()["ball"]
    assert np.linalg.norm(touch.force[:2]) < 0.02 * -touch.force[2]
    level = rings(organ.surface.triangles, touch.triangle)
    by_level = [np.linalg.norm(moved[organ.surface.triangles[level == k]], axis=-1).mean() for k in range(7)]
    assert (np.diff(by_level) < 0).all()
    assert by_level[0] > 9 * MM


@pytest.mark.slow
def test_organs_keep_their_volume_and_return_to_rest():
    rods = made.Rods(made.abdomen())
    assert [t.name for t in rods.tissues] == ["liver", "gallbladder", "stomach", "wall"]
    worst = {t.name: 0.0 for t in rods.tissues}
    deepest = dict(worst)
    for k in range(200):
        rods.organs.step(rods.poses(20 * MM * np.sin(np.pi * k / 200) ** 2))
        if k % 5 == 0:
            for t in rods.tissues:
                worst[t.name] = max(worst[t.name], change(rods.organs, t))
                deepest[t.name] = max(deepest[t.name], float(off(rods.organs, t).max()))
        if k == 100:
            assert all(touch.triangle >= 0 for touch in rods.organs.touches().values())
    assert min(deepest.values()) > 8 * MM
    assert max(worst.values()) < 0.02
    for _ in range(125):
        rods.organs.step(rods.poses(0.0))
    assert max(off(rods.organs, t).max() for t in rods.tissues) < 0.1 * MM


def slopes(tissue):
    """Return the change (3, n, k) of the weights of nodes per m along each axis of the grid, at the vertices.

    By finite differences of SciPy's interpolation; the plant differentiates its shares.
    """
    counts = [c + 1 for c in tissue.cells]
    axes = [np.arange(n) * edge for n, edge in zip(counts, tissue.cell_size, strict=True)]
    weights = RegularGridInterpolator(axes, np.eye(len(tissue.nodes)).reshape(*counts, -1), bounds_error=False)
    weights.fill_value = None  # rounding puts vertices outside of the grid
    h = 1e-7
    return np.stack(
        [
            (weights(tissue.vertices_in_grid + h * e) - weights(tissue.vertices_in_grid - h * e)) / (2 * h)
            for e in np.eye(3)
        ]
    )


def compression(organs, tissue, slopes):
    """Return the smallest ratio of the volume of material at the surface to that at rest; below 0: inside out."""
    return float(np.linalg.det(np.moveaxis(slopes @ organs.nodes[tissue.name], 0, 1)).min())


def depth(organs, tissue):
    """Return how deep in m a rod that touches the organ is in it, by points on its axis."""
    axis = np.linspace(0, made.SHORT - 2 * made.RADIUS, 8) + made.RADIUS
    v, out = organs.vertices(tissue.name), 0.0
    for tool, T in zip(organs.tools, organs._poses, strict=True):
        if tool.name not in organs.within[tissue.name]:
            for p in T[:3, 3] + np.outer(axis, T[:3, 2]):
                if inside(p, v, tissue.surface.triangles)[0]:
                    out = max(out, float(np.linalg.norm(nearest(p, v, tissue.surface.triangles)[0] - p)))
    return out


@dataclass
class Wandered:
    """What was found while rods wandered: the worst values, steps with contact, the last nodes, and what is left."""

    touched: int = 0
    change: float = 0.0
    compression: float = 1.0
    inverted: int = 0
    looks: int = 0
    off: float = 0.0
    depth: float = 0.0
    parted: int = 0
    pierced: int = 0
    left: float = 0.0
    nodes: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))

    def __str__(self):
        return (
            f"contact in {self.touched} steps, change of volume {100 * self.change:.4f} %, "
            f"inside out at {self.inverted} of {self.looks} looks (volume at the surface {self.compression:.2f}), "
            f"moved by {self.off / MM:.0f} mm or less, rods {self.depth / MM:.1f} mm deep, "
            f"organs crossed in {self.parted} steps, rods inside in {self.pierced}, "
            f"{self.left / MM:.4f} mm from rest 3 s later"
        )

    def require_sane(self):
        assert self.change < 0.02
        assert self.inverted <= 0.01 * self.looks, "a part of an organ stays inside out"
        assert self.off < 150 * MM, "an organ was flung away"
        assert self.depth < 10 * MM, "a rod is in an organ that it touches"
        assert self.left < 0.1 * MM, "an organ does not return to rest"


def wandered(seed, seconds, period=8e-3):
    """Let rods wander for some time in s, take them away, and judge the organs."""
    tissues = made.abdomen()
    moves = made.wander(seed, seconds, period)
    organs = Organs(tissues, [Tool(f"rod{k}", made.rod(made.SHORT)) for k in range(3)], next(moves), period)
    found, by_axis = Wandered(), {t.name: slopes(t) for t in tissues}
    for k, poses in enumerate(moves):
        organs.step(poses)
        found.nodes = np.concatenate(list(organs.nodes.values()))
        assert np.isfinite(found.nodes).all(), f"seed {seed}: not finite at {k * organs.period:.1f} s"
        found.touched += any(t.triangle >= 0 for t in organs.touches().values())
        found.parted += bool(organs.crossed)
        found.pierced += any(organs.within.values())
        if k % 5 == 0:
            least = min(compression(organs, t, by_axis[t.name]) for t in tissues)
            found.compression, found.looks = min(found.compression, least), found.looks + 1
            found.inverted += least <= 0
            found.change = max(found.change, *(change(organs, t) for t in tissues))
            found.off = max(found.off, *(off(organs, t).max() for t in tissues))
        if k % 60 == 0:
            found.depth = max(found.depth, *(depth(organs, t) for t in tissues))
    away = [made.at(0, 0, 3 + k) for k in range(3)]
    for _ in range(round(3 / period)):
        organs.step(away)
    found.left = max(off(organs, t).max() for t in tissues)
    return found


@pytest.mark.nightly
def test_random_instruments_leave_organs_finite_and_the_same_seed_gives_the_same_bytes():
    found = wandered(0, 1.5)
    assert found.touched > 20
    found.require_sane()
    assert wandered(0, 1.5).nodes.tobytes() == found.nodes.tobytes()


@pytest.mark.nightly
@pytest.mark.parametrize("seed", nightly(range(10), every=5))
def test_random_instruments_for_long(seed):
    """With the longest step that is used, that of a person's session."""
    start = time.process_time()
    found = wandered(seed, LONG, 16e-3)
    print(f"seed {seed}: {LONG:g} s, {(time.process_time() - start) / LONG:.2f} s of processor a second, {found}")
    assert found.touched > 0.1 * LONG / 16e-3
    found.require_sane()


# -- organs against organs -----------------------------------------------------------------------------


def beside(gap):
    """Two blocks side by side, 0.1 m long along x; the second one is called "other"."""
    box = trimesh.creation.box((0.1, 0.06, 0.05))
    box.apply_translation([0, 0, 0.025])
    other = box.copy()
    other.apply_translation([0, 0.06 + gap, 0])
    return [made.tissue(name, mesh, 1e-4, edge=0.012) for name, mesh in (("one", box), ("other", other))]


def leaned(gap, pushes=120, rests=60):
    """Push the first of two blocks at its top towards the second one by 15 mm in steps, and rest; return the organs."""
    organs = Organs(beside(gap), [Tool("tool", made.rod())], [made.at(0, -0.036, 0.042)])
    for y in np.r_[np.linspace(0, 15, pushes), np.full(rests, 15)] * MM:
        organs.step([made.at(0, -0.036 + y, 0.042)])
    return organs


def test_an_organ_that_is_pushed_pushes_the_next_one():
    far, near = leaned(50 * MM), leaned(3 * MM)
    _, other = near.tissues
    assert off(far, far.tissues[1]).max() < 1e-11, "it rests, to rounding"
    assert near.touches()["other"].force[1] > 0.1, "it is pushed away"
    moved = (near.vertices("other") - other.surface.vertices)[:, 1]
    assert moved.max() > 2 * MM
    for a, b in (("one", "other"), ("other", "one")):
        surface = {t.name: t.surface.triangles for t in near.tissues}[b]
        v = near.vertices(a)
        within = v[inside(v, near.vertices(b), surface)]
        deep = [np.linalg.norm(nearest(p, near.vertices(b), surface)[0] - p) for p in within]
        assert max(deep, default=0.0) < 0.5 * MM, "no surface is in the other one"
    assert all(change(near, t) < 0.02 for t in near.tissues)


def test_sparse_factors_give_the_accelerations_of_dense_ones():
    """MuJoCo 4.0.0 factors some sparse matrices wrongly (mended in 4.0.1); those of organs are not among them."""
    organs = leaned(3 * MM, pushes=15, rests=0)
    assert mujoco.mj_isSparse(organs._model)
    accelerations = []
    for jacobian in (mujoco.mjtJacobian.mjJAC_SPARSE, mujoco.mjtJacobian.mjJAC_DENSE):
        data = copy.copy(organs._data)
        organs._model.opt.jacobian = jacobian
        mujoco.mj_forward(organs._model, data)
        accelerations.append(data.qacc.copy())
    sparse, dense = accelerations
    assert np.abs(dense).max() > 1e-4
    np.testing.assert_allclose(sparse, dense, rtol=0, atol=1e-9 * np.abs(dense).max())


def test_organs_that_overlap_or_touch_at_the_start_are_refused():
    said = "'one' and 'other' overlap or are less than 1 mm apart at the start; draw them further apart"
    for gap in (-3, 0.5):
        with pytest.raises(WorldError, match=said):
            Organs(beside(gap * MM), [], [])
    small = made.tissue("small", trimesh.creation.box((0.01, 0.01, 0.01)).apply_translation([0, 0, 0.03]), 0.03)
    with pytest.raises(WorldError, match="'small' is inside 'one' at the start; draw them apart"):
        Organs([beside(0.01)[0], small], [], [])


def crossed(monkeypatch, parts):
    """Put a block into the one beside it, let both go for 2 s, and return the organs; `parts`: with the rule."""
    if not parts:
        monkeypatch.setattr("twin.simulation.plants.tissue.organs._CROSSING_DEPTH", np.inf)
        monkeypatch.setattr("twin.simulation.plants.tissue.organs._LEAST_COMPRESSION", -np.inf)
    organs = Organs(beside(3 * MM), [Tool("tool", made.rod())], [made.at(0, 0, 0.5)])
    organs.step([made.at(0, 0, 0.07)])
    other = organs._organs["other"]
    organs._data.qpos[other.qpos] = np.tile(other._R_world_grid.T @ [0.02, -0.045, 0.004], len(other.qpos) // 3)
    other.read()
    organs._is_at_rest = False
    seen = False
    for k in range(250):
        organs.step([made.at(0, 0, 0.5 - 1e-6 * k)])
        seen |= bool(organs.crossed)
    return organs, seen


@pytest.mark.slow
def test_organs_that_were_pressed_through_each_other_part(monkeypatch):
    organs, seen = crossed(monkeypatch, parts=True)
    assert seen
    assert not organs.crossed
    assert max(off(organs, t).max() for t in organs.tissues) < 0.1 * MM
    held, _ = crossed(monkeypatch, parts=False)
    assert max(off(held, t).max() for t in held.tissues) > 1 * MM, "contact alone holds them in each other"


@pytest.mark.slow
def test_link_that_presses_too_far_goes_into_the_organ():
    """And the organ is not turned inside out; the link touches it again once it has been outside."""
    organ = made.ball()
    organs, by_axis = Organs([organ], [Tool("tool", made.rod())], [made.at(0, 0, 0.081)]), slopes(organ)
    least, inside_at = 1.0, None
    for depth_ in np.linspace(0, 60, 300) * MM:
        organs.step([made.at(0, 0, 0.081 - depth_)])
        least = min(least, compression(organs, organ, by_axis))
        if inside_at is None and organs.within["ball"]:
            inside_at = depth_
    assert inside_at is not None
    assert inside_at > 20 * MM, "a link that dents the organ stays outside"
    assert least > 0
    for z in (*np.linspace(0.02, 0.12, 60), *np.linspace(0.12, 0.07, 60)):
        organs.step([made.at(0, 0, z)])
    assert organs.within == {"ball": ()}
    assert organs.touches()["ball"].force[2] < 0


def test_link_over_which_the_surface_has_jumped_is_inside():
    organ = made.ball()
    organs = Organs([organ], [Tool("tool", made.rod())], [made.at(0, 0, 0.081)])
    for k in range(40):
        organs.step([made.at(0, 0, 0.081 - 0.3 * MM * k)])
    inner = organs._organs["ball"]
    organs._data.qpos[inner.qpos] = np.tile(
        inner._R_world_grid.T @ [0, 0, 0.02], len(inner.qpos) // 3
    )  # the round end is inside
    inner.read()
    organs.step([made.at(0, 0, 0.069)])
    assert organs.within == {"ball": ("tool/rod",)}


def test_state_that_is_not_finite_is_refused():
    """MuJoCo would put the organs to rest and go on."""
    organs = Organs([made.ball()], [Tool("tool", made.rod())], [made.at(0, 0, 0.081)])
    organs.step([made.at(0, 0, 0.079)])
    organs._data.qvel[organs._organ_dofs] = np.nan
    organs._is_at_rest = False
    with pytest.raises(WorldError, match="simulation of the organs 'ball' became unstable in step 2 of 8 ms; move"):
        organs.step([made.at(0, 0, 0.078)])


# -- links ---------------------------------------------------------------------------------------------


def test_link_inside_an_organ_at_the_start_is_refused():
    with pytest.raises(WorldError, match="'tool/rod' is inside 'ball' at the start; start the robot outside"):
        Organs([made.ball()], [Tool("tool", made.rod())], [made.at(0, 0, 0.06)])


def test_flat_link_is_named():
    (rod,) = made.rod().meshes
    flat = replace(made.rod(), meshes=(replace(rod, vertices=rod.vertices * (1, 0, 1)),))
    with pytest.raises(TwinError, match=r"tool/rod: part 'rod' is flat.* Draw it with a thickness"):
        Organs([made.ball()], [Tool("tool", flat)], [made.at(0, 0, 0.2)])


def test_link_that_jumps_into_an_organ_touches_nothing_until_it_is_outside():
    organ = made.ball()
    organs = Organs([organ], [Tool("tool", made.rod())], [made.at(0, 0, 0.2)])
    for _ in range(30):
        organs.step([made.at(0, 0, 0.05)])
    assert organs.within == {"ball": ("tool/rod",)}
    assert off(organs, organ).max() < 1e-12
    for z in np.linspace(0.05, 0.1, 40):
        organs.step([made.at(0, 0, z)])
    for z in np.linspace(0.1, 0.07, 40):
        organs.step([made.at(0, 0, z)])
    assert organs.within == {"ball": ()}
    assert off(organs, organ).max() > 5 * MM


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"young": 0.0}, r"Young's modulus is 0; it must be 100 to 1e\+06 Pa"),
        ({"poisson": 0.5}, "Poisson's ratio is 0.5; it must be 0 to 0.49"),
        ({"friction": -0.1}, "friction is -0.1; it must be 0 to 2"),
        ({"cells": (2, 2, 5)}, "number of cells is 5; it must be 1 to 4 along an axis"),
    ],
)
def test_number_out_of_range_is_refused(more, message):
    with pytest.raises(WorldError, match=f"tissue 'ball': {message}"):
        Organs([made.ball(**more)], [], [])


def test_organ_that_nothing_holds_is_refused():
    with pytest.raises(TwinError, match="pin 'floor' holds none of the 27 nodes"):
        Organs([made.tissue("egg", trimesh.creation.icosphere(2, 0.05), -0.5)], [], [])


def test_organ_whose_pins_hold_all_nodes_is_refused():
    with pytest.raises(WorldError, match="tissue 'ball': its pins hold all 27 nodes of its grid, so that it cannot"):
        Organs([made.tissue("ball", trimesh.creation.icosphere(2, 0.05), 1.0)], [], [])


class Push(Block):
    """A controller: the second link turns down."""

    def __init__(self):
        self.outputs = {"arm.command": np.zeros(2)}

    def step(self, signals, t, dt):
        return {"arm.command": np.array([0.0, -0.6 * t])}


def test_world_moves_the_organs_under_the_joint_values_and_its_frame_has_their_vertices():
    organ = made.block(size=(0.06, 0.05, 0.04), edge=0.01)
    mechanism = two_links()
    links = Links("arm", mechanism, spatial.pose(), [mechanism.bodies[-1].name], np.zeros(2))
    T = links.poses()[0]
    assert T.shape == (4, 4)
    free = np.full(2, np.inf)
    world = World(
        robots=[Placed("arm", mechanism, made.at(0, 0, 1))],
        deformables=[organ.deformable],
        controllers=[Push()],
        plants=[Kinematic("arm", np.zeros(2), JointLimits(-free, free, free)), Tissues([organ], [links])],
    )
    world.step(16)
    frame = world.frame()
    assert frame.fields["block"].shape == organ.surface.vertices.shape
    recorded = world.recording()["block.nodes"][-1].reshape(-1, 3)
    assert np.array_equal(organ.weights @ recorded, frame.fields["block"])


def test_link_that_does_not_exist_is_refused():
    with pytest.raises(WorldError, match="there is no body of arm 'claw'"):
        Links("arm", two_links(), np.eye(4), ["claw"], np.zeros(2))


@pytest.mark.slow
@pytest.mark.parametrize("name", contrasting(designs()))
def test_instrument_of_every_robot_dents_an_organ(name):
    mechanism = twin.load(name).mechanism
    frame = mechanism.frame(mechanism.tool)
    body = next(b for b in mechanism.bodies if b.name == frame.body)
    v = np.concatenate([m.vertices for m in body.meshes])
    # turn the link so that the direction from its middle to the tool points down, onto the organ
    down = spatial.frame_from_axes(frame.T_body_frame[:3, 3] - v.mean(axis=0), np.array([0.3, 0.5, 0.8])).T
    R = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0.0]]) @ np.roll(down, 1, axis=0)
    R = spatial.frame_from_axes(R[2], R[0]).T if np.linalg.det(R) < 0 else R
    lowest = (v @ R.T)[np.argmin((v @ R.T)[:, 2])]
    organ = made.ball()
    start = spatial.pose(R, np.array([0, 0, 0.085]) - lowest)
    organs = Organs([organ], [Tool(name, body)], [start])
    for k in range(100):
        T = start.copy()
        T[2, 3] -= 12 * MM * k / 99
        organs.step([T])
    assert organs.touches()["ball"].force[2] < -0.05
    assert off(organs, organ).max() > 4 * MM
    assert change(organs, organ) < 0.02
