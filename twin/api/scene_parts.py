"""The parts of a scene that a simulation needs: robots of its places, props and organs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from twin.api.robot import Robot
from twin.api.robot_loading import load

if TYPE_CHECKING:
    from twin.model.mechanism import Mechanism
    from twin.model.scene import Place, Scene
    from twin.simulation.setup import Member


def robots_at(places: Iterable[Place]) -> dict[str, Robot]:
    """Return {name of a place: its robot}; for places with the same robot, the files are read only once."""
    by_robot: dict[str, Robot] = {}
    robots: dict[str, Robot] = {}
    for place in places:
        if place.robot not in by_robot:
            by_robot[place.robot] = load(place.robot)
        robots[place.name] = by_robot[place.robot]
    return robots


def members_of(robots: Mapping[str, Robot]) -> dict[str, Member]:
    """Return {name of a place: mechanism and equations of its robot}; `robots` is {name of a place: robot}."""
    from twin.simulation.setup import Member

    members = {}
    for name, robot in robots.items():
        members[name] = Member(robot.mechanism, robot.kinematics())
    return members


def props_of(scene: Scene) -> Mechanism | None:
    """Return the mechanism of the props of a scene; None without props."""
    from twin.cad.build import read_props

    if scene.props is None:
        return None
    return read_props(scene.props)


def anatomy_of(scene: Scene) -> Mechanism | None:
    """Return the mechanism whose bodies are the soft organs of a scene; None without organs."""
    from twin.cad.build import read_props

    if scene.anatomy is None:
        return None
    return read_props(scene.file.parent / scene.anatomy.file)
