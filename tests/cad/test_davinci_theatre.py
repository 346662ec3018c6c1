"""What stands around the arms of the da Vinci: the surgeon's cart has the lengths of the paper and touches nothing."""

from __future__ import annotations

import numpy as np
import pytest

import twin
from twin.cad.build import read_mechanism
from twin.core.units import MM
from twin.model.mechanism import Mechanism
from twin.reference import ReferenceModel
from twin.reference.clearance import Shape, between, distance_between

FREE = 50 * MM
"""Clearance from everything that is asked for: nobody gets stuck between cart and arms."""


@pytest.fixture(scope="module")
def scene():
    return twin.load_scene("davinci")


@pytest.fixture(scope="module")
def props(scene):
    return read_mechanism(scene.props, with_mass=False).mechanism


@pytest.fixture(scope="module")
def cart(props):
    """Vertices (n, 3) of each part of the cart, in m in the World."""
    T = ReferenceModel(props).home().link_poses["cart"]
    return {m.name.removeprefix("cart_"): m.vertices @ T[:3, :3].T + T[:3, 3] for m in props.body("cart").meshes}


@pytest.mark.slow
def test_the_cart_has_what_the_paper_lists(cart):
    for part in ("right_handle", "left_handle", "clutch_plate", "camera_plate", "visor", "pad", "stool_seat"):
        assert any(name.startswith(part) for name in cart), part


def test_the_cart_has_the_lengths_of_the_paper(cart):
    pad = cart["pad"]
    assert pad[:, 2].max() == pytest.approx(740 * MM, abs=20 * MM), "height of the arm support"
    support = cart["support"]
    assert 100 * MM <= np.ptp(support[:, 1]) <= 200 * MM, "depth of the arm support"
    for side in ("right", "left"):
        handle = cart[f"{side}_handle"]
        axis = np.linalg.svd(handle - handle.mean(axis=0))[2][0]
        along = handle @ (axis if axis[2] < 0 else -axis)
        lowest = handle[along > along.max() - 0.1 * MM].mean(axis=0)  # its lower end face
        assert lowest[1] - support[:, 1].max() == pytest.approx(150 * MM, abs=5 * MM), "gripper from the arm support"
        assert lowest[2] > pad[:, 2].max(), "the wrist is free"


def test_the_hands_are_before_the_surgeon_and_the_visor_before_the_eyes(cart):
    right, left, visor, seat = (cart[n].mean(axis=0) for n in ("right_handle", "left_handle", "visor", "stool_seat"))
    assert right[0] > left[0]
    assert abs(visor[0] - 0.5 * (right[0] + left[0])) < 1 * MM
    assert visor[2] > right[2] > seat[2]
    assert seat[1] < min(p[:, 1].min() for n, p in cart.items() if not n.startswith("stool"))
    assert min(p[:, 2].min() for p in cart.values()) == pytest.approx(0, abs=0.1 * MM), "it stands on the floor"


@pytest.mark.nightly
def test_the_cart_touches_neither_table_nor_patient_nor_an_arm_wherever_it_is(scene, props):
    home = ReferenceModel(props).home().link_poses
    shapes = {n: Shape(n, n, props.body(n).meshes) for n in ("cart", "table", "patient")}
    for other in ("table", "patient"):
        assert distance_between(shapes["cart"], shapes[other], home["cart"], home[other]) > FREE
    alone = Mechanism("cart", "cart", (props.body("cart"),), (), ())
    rng, count = np.random.default_rng(5), 8
    still = {"cart": np.tile(home["cart"], (count, 1, 1))}
    for place in scene.places:
        robot = twin.load(place.robot)
        low, high = robot.mechanism.limits.T
        model = robot.reference()
        links = [model.solve(q).link_poses for q in rng.uniform(low, high, (count, len(low)))]
        poses = {b: place.T_world_base @ np.array([one[b] for one in links]) for b in links[0]}
        found = between({"cart": alone, place.name: robot.mechanism}, {"cart": still, place.name: poses})
        gap = found["cart", place.name]
        k = int(gap.distance.argmin())
        assert gap.distance[k] > FREE, (gap.distance[k] / MM, gap.pair[k])
