"""Create the simulated machine of a robot, in this or in a child process; connect to the machines of a scene."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING

from twin.api.robot import Robot
from twin.api.robot_loading import load
from twin.core import assets
from twin.core.errors import DeviceError, TwinError, unknown
from twin.core.processes import WorkerProcess

if TYPE_CHECKING:
    from twin.simulation.hazards.fault import Fault
    from twin.simulation.machine.machine_link import Address, MachineLink
    from twin.simulation.machine.machine_parts import Parts
    from twin.simulation.machine.settings import Mode, Policy
    from twin.simulation.machine.simulated_machine import Machine


def machine_parts(
    robot: Robot,
    *,
    mode: Mode | None = None,
    overdrive: Policy | None = None,
    master_timeout: float | None = None,
    released: Collection[str] | None = None,
) -> Parts:
    """Return the compiled parts of a robot's machines; several machines can share them.

    Args:
        robot: a robot with machine.toml in its folder, and with an inverse in closed form. Its masses are those of
            inertia.toml or, without this file, those of its parts.
        mode: name of the DAC limits in machine.toml; None: the mode of machine.toml.
        overdrive: action for DAC commands above the DAC limits; None: as in machine.toml.
        master_timeout: time in s without a packet after which the pedal counts as up; None: as in machine.toml.
        released: faults of the released control software to reproduce: names of fields of `settings.Released`. All
            other faults are corrected; with ("none",), every fault is corrected. None: as in machine.toml.

    Raises:
        TwinError: a file is missing or malformed, a body has no mass, the inverse is not in closed form, the gains make
            a joint oscillate, a name in `released` is unknown, or `master_timeout` is not above 0.
    """
    from twin.reference import inertia
    from twin.simulation.dynamics.arm import arm
    from twin.simulation.machine import settings
    from twin.simulation.machine.machine_parts import Parts

    if robot.files is None:
        raise TwinError(
            f"{robot.name} was loaded from {robot.source.kind}: a machine requires a robot folder with {settings.NAME}"
        )
    if not (robot.files.cad / settings.NAME).is_file():
        robots_with_machine = []
        for file in (assets.data_folder() / "cad").glob(f"*/{settings.NAME}"):
            robots_with_machine.append(file.parent.name)
        raise TwinError(
            f"{robot.name} has no machine: beside its TOML file there is no {settings.NAME} (motors, gains and "
            f"limits). Robots of twin with a machine: {', '.join(sorted(robots_with_machine))}"
        )
    kin = robot.kinematics()
    if not kin.closed_inverse:
        raise TwinError(f"{robot.name} has no inverse in closed form, which a machine evaluates in each tick")
    if (robot.files.cad / inertia.NAME).is_file():
        model = arm(robot.mechanism, inertia.of_robot(robot.files.cad))
    else:
        model = arm(robot.weighed().mechanism)
    table = settings.load(robot.files.cad / settings.NAME, model.mechanism)
    # tables are frozen: arguments replace the values of the file in copies
    table = table.model_copy(update={"mode": mode or table.mode, "overdrive": overdrive or table.overdrive})
    if released is not None:
        fault_names = list(settings.Released.model_fields)
        for name in set(released) - {"none"}:
            if name not in fault_names:
                raise TwinError(unknown("fault of the released software", name, fault_names))
        faults = {name: name in released for name in fault_names}
        table = table.model_copy(update={"released": settings.Released(**faults)})
    if master_timeout is not None:
        if not master_timeout > 0:
            raise TwinError(f"the time-out of the master is {master_timeout:g} s; it must be above 0")
        # the number keeps its unit and provenance
        stated = table.number.master_timeout.model_copy(update={"value": master_timeout})
        numbers = table.number.model_copy(update={"master_timeout": stated})
        table = table.model_copy(update={"number": numbers})
    return Parts.of(model, kin, table, robot.gaps)


def machine(
    parts: Parts, *, mass: float = 1.0, friction: float = 1.0, tilt: float = 0.0, faults: Sequence[Fault] = ()
) -> Machine:
    """Return a machine in its home posture and in the state E_STOP.

    All masses are multiplied by `mass`, and all friction by `friction`; the base is rotated by `tilt` in rad about x.
    The model in the control software keeps the nominal values. `faults` change signals of
    `twin.simulation.machine.machine_faults.LOCATIONS`.

    Raises:
        TwinError: `mass` is not above 0, `friction` is negative, or a fault has an unknown signal.
    """
    from twin.simulation.machine.simulated_machine import Machine

    # only the plant changes, so that the machine deviates from the model in its software
    physics = parts.plant.physics.changed(mass, friction, tilt)
    return Machine(parts, physics=physics, faults=faults)


class ChildMachine:
    """A machine in a child process. The process ends at `close` or with the parent process.

    Attributes:
        address: network address of the machine.
    """

    def __init__(self, robot: str, *, faults: Sequence[Fault] = ()) -> None:
        """Start the machine of `robot` (name or folder), and press its start button; for `faults`, see `machine`.

        Raises:
            DeviceError: the machine cannot be created (see `machine_parts` and `machine`), or its process has ended.
        """
        from twin.simulation.machine.machine_link import Address
        from twin.simulation.machine.machine_server import HOST

        self._process = WorkerProcess(_run, robot, tuple(faults))
        try:
            answer = self._process.line.recv()  # see `_run`
        except EOFError:
            raise DeviceError(f"the process of the machine of {robot} ended before the machine was ready") from None
        if isinstance(answer, str):
            raise DeviceError(f"the machine of {robot} cannot start: {answer}")
        self.address = Address(HOST, *answer)

    @property
    def alive(self) -> bool:
        """Whether the process is running."""
        return self._process.alive

    def close(self) -> None:
        """End the process."""
        self._process.close()
        self._process.line.close()


def _run(line: Connection, name: str, faults: Sequence[Fault]) -> None:
    """Run a machine in the child process until the parent process closes the connection.

    The first message on the connection is the two ports of the machine; if it cannot start, the error as text.
    """
    from twin.simulation.machine.machine_server import Server

    try:
        simulated = machine(machine_parts(load(name)), faults=faults)
        server = Server(simulated)
    except TwinError as error:
        line.send(str(error))
        return
    simulated.start()
    line.send((server.port, server.state_port))
    try:
        server.run(ends=lambda: _is_parent_gone(line))
    finally:
        server.close()


def _is_parent_gone(line: Connection) -> bool:
    """Return whether the parent process has closed the connection, or has asked for the end by sending None."""
    try:
        return line.poll() and line.recv() is None
    except (EOFError, OSError):
        return True


class Machines:
    """The machines of a scene, each in a child process or already running; a context manager.

    Attributes:
        parts: {name of a place: compiled parts of its machine}.
        links: {name of a place: connection to its machine}.
    """

    def __init__(
        self,
        robots: Mapping[str, Robot],
        sources: Mapping[str, str],
        running: Mapping[str, Address] | None = None,
        start: Callable[[str], ChildMachine] = ChildMachine,
    ) -> None:
        """Connect to the machines, and start those that are not running.

        Args:
            robots: {name of a place: robot} of the robots that are simulated as machines.
            sources: {name of a place: name or folder of the robot}.
            running: {name of a place: address} of the machines that are already running.
            start: function that starts the machine of a robot; its argument is the robot's name or folder.

        Raises:
            TwinError: the machine of a robot cannot be created (see `machine_parts`), a name in `running` is unknown,
                or a machine does not answer.
        """
        from twin.simulation.machine.machine_link import MachineLink

        running = running or {}
        for name in running:
            if name not in robots:
                raise TwinError(unknown("machine", name, robots))
        # before any process starts: a malformed machine.toml is reported without one
        self.parts = {name: machine_parts(robot) for name, robot in robots.items()}
        self.links: dict[str, MachineLink] = {}
        self._children: list[ChildMachine] = []
        try:
            for name in robots:
                address = running.get(name)
                if address is None:
                    child = start(sources[name])
                    self._children.append(child)
                    address = child.address
                self.links[name] = MachineLink(address, len(self.parts[name].home))
        except TwinError:
            self.close()
            raise

    def __enter__(self) -> Machines:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections, and end the machines that this object has started."""
        for link in self.links.values():
            link.close()
        for child in self._children:
            child.close()
