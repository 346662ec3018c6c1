"""Force on one hand whose tool touches planes, and an energy observer that shares no code with that of `twin`."""

from __future__ import annotations

import numpy as np

from twin.core import spatial
from twin.formula.evaluator import attach
from twin.simulation.controllers.console_equations import console
from twin.simulation.controllers.hand_force import FORCE, STATE_SIZE, ForceParameters, hand_force
from twin.simulation.limits import JointLimits
from twin.simulation.local_plane import PLANE_COUNT, PLANE_SIZE, LocalPlane, rows

DT = 1e-3
FREE = JointLimits(np.array([-np.inf]), np.array([np.inf]), np.array([np.inf]))


def plane(normal, offset=0.0):
    """Return the plane normal . p = offset of the tool's origin."""
    n = np.asarray(normal, float)
    return LocalPlane(n, n, np.zeros(3), offset)


class Touch:
    """Force on a hand; the tool's displacement is the hand's displacement times `scale`."""

    def __init__(self, surface=None, *, bounds=True, scale=1.0, dt=DT):
        law = hand_force(console(), surface or ForceParameters(), FREE, np.array([True]), 1, dt, bounds)
        self.state, self.pulse = np.zeros(STATE_SIZE), np.zeros(3)
        self.on, self.follows, self.scale = np.ones(1), np.ones(1), np.array([scale])
        self.hand, self.tool, self.goal, self.planes = (np.eye(4).ravel() for _ in range(4))
        self.planes = np.zeros(PLANE_COUNT * PLANE_SIZE)
        eye, q = np.eye(4).ravel(), np.zeros(1)
        given = (self.pulse, self.on, self.follows, self.scale, self.hand, eye, eye, self.tool, self.goal, q)
        self.out, self._compute = attach(law, self.state, *given, self.planes)

    def among(self, *planes):
        """Set the planes that the tool can touch; return self."""
        self.planes[:] = rows(planes, np.eye(4))
        return self

    def start(self, p):
        """Set the hand at rest at p (3,) in m."""
        self.state[3:6] = p

    def at(self, p):
        """Make one tick with the hand at p (3,) in m; return the force (3,) in N."""
        self.hand[3:12:4] = p
        self.tool[3:12:4] = self.scale[0] * np.asarray(p)
        self.goal[:] = self.tool
        self._compute()
        self.state[:] = self.out
        return self.out[FORCE].copy()

    def play(self, hands):
        """Return the forces (k, 3) for positions (k, 3) of the hand."""
        self.start(hands[0])
        return np.array([self.at(p) for p in hands])


def observed(hands, forces, device_damping, dt=DT):
    """Return the energy (k,) in J that hand and device have put in.

    It is the work of the hand against the forces (k, 3) in N, each constant during its tick, plus the loss of the
    device's damping in N s/m.
    """
    way = np.diff(hands, axis=0)
    given = device_damping / dt * np.sum(way * way, axis=1) - np.sum(forces[:-1] * way, axis=1)
    return np.concatenate([[0.0], np.cumsum(given)])


def random_hand(rng, ticks, cut_hz, size, dt=DT):
    """Return random positions (ticks, 3) in m of a hand, up to `cut_hz`; their standard deviation is `size` in m."""
    spectrum = np.fft.rfft(rng.standard_normal((ticks, 3)), axis=0)
    spectrum[np.fft.rfftfreq(ticks, dt) > cut_hz] = 0
    p = np.fft.irfft(spectrum, ticks, axis=0)
    return p * (size / p.std())


def turned(rng):
    """Return a random rotation (3, 3)."""
    return spatial.exp_so3(rng.standard_normal(3))
