"""The option --machine: connect to machines that are already running, and start the others of a scene."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from twin.core.errors import TwinError

if TYPE_CHECKING:
    from twin.api.robot import Robot
    from twin.simulation.machine.machine_link import Address
    from twin.ui.session.driven_machine import DrivenMachine
    from twin.ui.session.loaded_scene import LoadedScene


def running(options: Sequence[str] | None) -> dict[str, Address]:
    """Return the addresses of machines from options "ROBOT=HOST:PORT:STATEPORT".

    Raises:
        TwinError: an option has another form, or names a robot twice.
    """
    from twin.simulation.machine.machine_link import Address

    addresses: dict[str, Address] = {}
    for text in options or ():
        name, equal, where = text.partition("=")
        if not equal or not name:
            form = "ROBOT=HOST:PORT:STATEPORT, such as raven_left=127.0.0.1:36000:36001"
            raise TwinError(f"--machine {text}: give {form}")
        if name in addresses:
            raise TwinError(f"--machine {text}: {name} is given twice; give each robot once")
        addresses[name] = Address.parse(where)
    return addresses


def driven(robot: Robot, options: Sequence[str] | None) -> DrivenMachine | None:
    """Connect to the machine of a robot that the option --machine names; None: the option is not given.

    Raises:
        TwinError: the option is wrong, the robot has no machine, or the machine does not answer.
    """
    from twin.api.machine import machine_parts
    from twin.ui.session.driven_machine import DrivenMachine

    addresses = running(options)
    if not addresses:
        return None
    if list(addresses) != [robot.name]:
        raise TwinError(
            f"--machine {', '.join(addresses)}: the robot of this page is {robot.name}; name its machine only"
        )
    return DrivenMachine(addresses[robot.name], machine_parts(robot))


def connected(loaded: LoadedScene, options: Sequence[str] | None) -> LoadedScene:
    """Connect a scene to its machines; start the machines that are not in `options`.

    `options` contains the values of the option --machine.

    Raises:
        TwinError: --machine is wrong, or a machine does not answer.
    """
    from twin.api.console_runs import machines_of

    addresses = running(options)
    scene = loaded.scene
    if scene.trainer is None:
        if addresses:
            raise TwinError(f"--machine: scene '{scene.name}' has no machines: add a section [trainer] to its file")
        return loaded
    to_start = [name for name in scene.trainer.robots if name not in addresses]
    if to_start:  # said first: compiling a machine takes some seconds
        print(f"twin: starting the machine of {', '.join(to_start)}", file=sys.stderr, flush=True)
    return replace(loaded, machines=machines_of(scene, loaded.robots, addresses))
