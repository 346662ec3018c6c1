"""How a page judges a procedure. The simulated surgeon works in a World of its own, see `procedure_run`."""

from __future__ import annotations

from twin.model.task import ConsoleTask
from twin.simulation import console_scene, operating_scene
from twin.simulation.plants.tissue import clips_of
from twin.simulation.session.task_play import Play
from twin.simulation.setup import Setup
from twin.simulation.tasks.procedure.procedure_guide import ProcedureGuide
from twin.simulation.world.signal_kinds import CLIP_ON


class _ProcedurePlay(Play):
    def referee(self, setup: Setup, task: ConsoleTask, period: float) -> ProcedureGuide:
        switches = [CLIP_ON.of(clip.name) for clip in clips_of(setup.scene.tools)]
        return ProcedureGuide(setup, switches, console_scene.ORGANS)

    def identity(self, setup: Setup, task: ConsoleTask) -> list[object]:
        return operating_scene.about(setup)


PLAY = _ProcedurePlay()
