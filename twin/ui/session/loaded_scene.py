"""A scene with the robots, props, deformables and machines that a page shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from twin.api.machine import Machines
    from twin.api.robot import Robot
    from twin.model.mechanism import Mechanism
    from twin.model.scene import Scene
    from twin.model.tissue import Tissue
    from twin.ui.session.deformable_feed import Feed


@dataclass(frozen=True)
class LoadedScene:
    """A scene with its robots, props, deformables and machines.

    Attributes:
        scene: the scene.
        robots: the robots, by name of the robot's place.
        props: mechanism of the props; None: no props. Props are required for a task with rings and for contact forces.
        feed: source of deformables that are shown but not simulated by the World; None: no deformables.
        organs: the organs of the scene; only needed for a procedure, in which the World simulates the organs.
        machines: connections to the machines of the scene, ended by the console; None: the scene has no machines.
    """

    scene: Scene
    robots: Mapping[str, Robot]
    props: Mechanism | None = None
    feed: Feed | None = None
    organs: Sequence[Tissue] = ()
    machines: Machines | None = None
