"""Hands that a test moves at a scene's console, and the distance of each instrument's shaft from its port."""

from __future__ import annotations

import numpy as np

from twin.api.scene_parts import members_of
from twin.core import spatial
from twin.simulation import console_scene
from twin.simulation.console_scene import HANDS
from twin.simulation.devices.received_hands import HandState, ReceivedHands
from twin.simulation.setup import Setup


class ByHand:
    """A World of a scene at its start state, with hands that the test moves."""

    def __init__(self, scene, robots, fulcrum="compensated", scale=0.5):
        self.scene = scene
        self.members = members_of(robots)
        settings = console_scene.settings(scene, fulcrum)
        self.device = ReceivedHands("pedals", HANDS, scale, settings=settings)
        self.world = console_scene.world(Setup(scene, self.members), self.device, records=False)
        self.places = {p.name: p for p in scene.places}
        self.p = {hand: np.zeros(3) for hand in HANDS}
        self.R = {hand: np.eye(3) for hand in HANDS}
        self.camera, self.number = False, 0

    def step(self, ticks=1):
        for k, hand in enumerate(HANDS):
            pose = spatial.pose(self.R[hand], self.p[hand])
            self.device.give(HandState(k, False, self.camera, self.number, pose, 0.0))
        self.number += 1
        self.world.step(ticks)

    def begin(self):
        """Roll both handles, which the arms require before they follow."""
        self.step()
        for hand in HANDS:
            self.R[hand] = spatial.rotation_z(0.1)
        for _ in range(3):
            self.step()

    def move(self, hand, way, ticks=200):
        """Move a hand by `way` (3,) in m in `ticks` ticks, and wait until its tool has followed."""
        start = self.p[hand]
        for k in range(ticks):
            self.p[hand] = start + np.asarray(way) * (k + 1) / ticks
            self.step()
        for _ in range(300):
            self.step()

    def tip(self, robot):
        """Return the position (3,) in m of a robot's tip, in the axes of the endoscope's picture."""
        T = self.places[robot].T_world_base @ self.members[robot].kin.forward(self.world.signals[f"{robot}.q"])
        view = self.world.signals[f"{self.scene.cameras[self.scene.console.camera].robot}.view"].reshape(4, 4)
        return view[:3, :3].T @ T[:3, 3]

    def shaft(self, robot):
        """Return (direction (3,) from the port to the tip in the picture's axes, distance in m from port to tip)."""
        view = self.world.signals[f"{self.scene.cameras[self.scene.console.camera].robot}.view"].reshape(4, 4)
        way = self.tip(robot) - view[:3, :3].T @ next(iter(self.places[robot].p_world_ports.values()))
        return way / np.linalg.norm(way), float(np.linalg.norm(way))

    def off_port(self):
        """Return the distance in m of each shaft from its port, by robot, computed from the mechanisms' link poses."""
        poses, out = self.world.frame().link_poses, {}
        for name, place in self.places.items():
            mechanism = self.members[name].mechanism
            trocar = next(iter(mechanism.trocars), None)
            frame = mechanism.frame(mechanism.tool) if trocar is None else mechanism.shaft_through(trocar)
            T = poses[name][frame.body] @ frame.T_body_frame
            port = next(iter(place.p_world_ports.values()))
            out[name] = float(spatial.point_to_line(port, T[:3, 3], T[:3, 2]))
        return out


class RandomHands:
    """Smooth random motions of both hands, up to `speed` in m/s; during a quarter of the time they move the camera."""

    def __init__(self, hands, seed, speed=0.2):
        self.hands, self.rng, self.speed = hands, np.random.default_rng(seed), speed
        self.v = {hand: np.zeros(3) for hand in HANDS}
        self.w = {hand: np.zeros(3) for hand in HANDS}
        self.at = {hand: np.zeros(3) for hand in HANDS}

    def step(self, seconds):
        """Move for a time in s, one state every 4 ms."""
        for _ in range(round(seconds / 0.004)):
            hands, rng = self.hands, self.rng
            hands.camera = int(hands.world.t) % 4 == 2
            for hand in HANDS:
                v = self.v[hand] + rng.normal(0, 0.02, 3) - 0.01 * self.v[hand]
                self.v[hand] = v * min(1.0, self.speed / np.linalg.norm(v))
                self.w[hand] += rng.normal(0, 0.1, 3) - 0.01 * (self.w[hand] + self.at[hand])
                self.at[hand] = self.at[hand] + 0.004 * self.w[hand]
                hands.p[hand] = 0.9995 * hands.p[hand] + 0.004 * self.v[hand]
                hands.R[hand] = spatial.exp_so3(self.at[hand]) @ spatial.rotation_z(0.1)
            hands.step(4)
