"""Setup of a session: a scene with its robots, the task, and the props, organs and condition that the task requires."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from twin.core.spatial import Array
from twin.kinematics import Kinematics
from twin.model.mechanism import Mechanism
from twin.model.movable import Movable
from twin.model.scene import Place, Scene
from twin.model.task import ConsoleTask, goal_of
from twin.model.tissue import Tissue
from twin.simulation.condition import Condition
from twin.simulation.tasks.procedure.task import ProcedureTable


@dataclass(frozen=True)
class Member:
    """A robot of the scene, with its mechanism and its equations; for `links`, see `twin.simulation.world.Placed`."""

    mechanism: Mechanism
    kin: Kinematics
    links: Callable[[Array], Mapping[str, Array]] | None = None


@dataclass(frozen=True)
class Setup:
    """The inputs of a World at a console or of a procedure; a session file contains the hash of these inputs.

    Attributes:
        scene: the scene.
        members: {name of a place: its robot}.
        task: a task; None: no task. If the task has rings, the instruments touch objects and the solid bodies of the
            props. In a procedure, the grippers of the hands close the jaws of tools, and the tools act on the organs.
        props: mechanism of the props; only needed for a task with rings, and for the forces of contacts.
        condition: condition of the session; None: the World has no forces on the hands. With forces on the hands, the
            instruments touch the solid bodies and each other in every task.
        organs: the organs of the scene; only needed for a procedure.
    """

    scene: Scene
    members: Mapping[str, Member]
    task: ConsoleTask | None = None
    props: Mechanism | None = None
    condition: Condition | None = None
    organs: Sequence[Tissue] = ()

    @property
    def places(self) -> dict[str, Place]:
        """{name: place} of all robots of the scene."""
        return {p.name: p for p in self.scene.places}

    @property
    def objects(self) -> Sequence[Movable]:
        """The movable objects of the task."""
        if self.task is None or not self.task.kind.grasps:
            return ()
        return self.scene.objects

    @property
    def label(self) -> str:
        """File of the scene and name of the task, for messages."""
        name = ""
        if self.task is not None:
            name = self.task.name
        return f"{self.scene.file}: task '{name}'"

    @property
    def procedure(self) -> ProcedureTable | None:
        """The procedure; None: the task is not a procedure."""
        return goal_of(self.task, ProcedureTable)

    @property
    def haptics(self) -> bool | None:
        """Whether the forces on the hands are on at the start; None: the World has no forces."""
        if self.condition is None:
            return None
        return self.condition.haptics

    @property
    def felt(self) -> bool:
        """Whether the forces on the hands include contact forces."""
        return self.condition is not None and self.scene.contact is not None and self.props is not None
