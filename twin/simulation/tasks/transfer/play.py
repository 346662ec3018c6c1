"""How rings are brought to pegs: the simulated surgeon, the referee, and the rings on their pegs after a session."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from twin.core.findings import Finding, disagreement
from twin.core.json_types import JsonObject
from twin.core.result import Part, TextTable
from twin.core.spoken import spoken
from twin.model.task import ConsoleTask, required_goal
from twin.simulation import console_scene, contact_scene
from twin.simulation.contact_scene import Peg
from twin.simulation.devices.surgeon_hands import Seat, SurgeonHands
from twin.simulation.operating_scene import plain
from twin.simulation.session.task_play import ArmPath, Play, TaskOutcome
from twin.simulation.setup import Setup
from twin.simulation.tasks.transfer.ring_referee import BoardMeasures, RingsReferee, measure
from twin.simulation.tasks.transfer.ring_surgeon import Ring, RingSurgeon
from twin.simulation.tasks.transfer.task import Transfers
from twin.simulation.world import Recording


@dataclass(frozen=True)
class BoardOutcome(TaskOutcome):
    """Measures of the peg board, and {name: peg} of its pegs."""

    board: BoardMeasures
    pegs: Mapping[str, Peg]

    success = "All rings are on their pegs"
    failure = "Not all rings are on their pegs"

    def findings(self) -> Iterator[Finding]:
        """Yield a finding on every ring that is not around its peg."""
        for ring in self.board.rings:
            if ring.t is None:
                text = f"at the end, the ring is not around its peg, {spoken(ring.peg)}"
                yield disagreement("task.missed", ring.ring, text)

    def content(self) -> JsonObject:
        """Return the measures of the board and of its rings."""
        board = self.board
        of_rings = []
        for ring in board.rings:
            of_rings.append({"ring": ring.ring, "peg": ring.peg, "t_s": ring.t, "drops": ring.drops})
        measures = {
            "time_s": board.time,
            "rings_transferred": board.transferred,
            "rings_dropped": board.dropped,
            "instrument_collisions": board.collisions,
            "errors": board.errors,
            "rings": of_rings,
        }
        return {"board": measures}

    def text(self) -> Iterator[Part]:
        """Yield a row for every ring, then the measures."""
        rows = []
        for ring in self.board.rings:
            when = "-" if ring.t is None else f"{ring.t:.1f} s"
            rows.append((spoken(ring.ring), spoken(ring.peg), when, str(ring.drops)))
        yield TextTable(("ring", "peg", "transferred at", "dropped"), rows)
        yield ""
        yield TextTable((), self.board.rows())


class _BoardPlay(Play):
    def surgeon(self, setup: Setup, task: ConsoleTask, seat: Seat, mistake: str) -> SurgeonHands:
        pegs = contact_scene.pegs(setup.scene, setup.props, task)
        objects = {item.name: item for item in setup.scene.objects}
        rings = []
        for transfer in required_goal(task, Transfers).transfers:
            size = objects[transfer.ring].size
            peg = pegs[transfer.peg]
            rings.append(Ring(transfer.ring, size[0], size[1], transfer.peg, peg.end, peg.foot))
        return RingSurgeon(seat, rings)

    def referee(self, setup: Setup, task: ConsoleTask, period: float) -> RingsReferee:
        pegs = contact_scene.pegs(setup.scene, setup.props, task)
        called = console_scene.instrument_names(setup.scene)
        goal = required_goal(task, Transfers)
        return RingsReferee(goal, setup.scene.objects, pegs, list(called), period, called)

    def outcome(
        self, setup: Setup, task: ConsoleTask, recording: Recording, arms: Mapping[str, ArmPath]
    ) -> BoardOutcome:
        scene = setup.scene
        pegs = contact_scene.pegs(scene, setup.props, task)
        robots = list(console_scene.hands_of(scene))
        goal = required_goal(task, Transfers)
        return BoardOutcome(measure(recording, goal, scene.objects, pegs, robots), pegs)

    def identity(self, setup: Setup, task: ConsoleTask) -> list[object]:
        about: list[object] = []
        for peg in contact_scene.pegs(setup.scene, setup.props, task).values():
            about.append([peg.name, plain(peg.end), plain(peg.foot), plain(peg.radius)])
        return about


PLAY = _BoardPlay()
