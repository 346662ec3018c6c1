"""The kinds of signals: one definition each, used for every name, and true of the signals of Worlds."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import twin
from twin.api.scene_parts import anatomy_of, members_of, props_of, robots_at
from twin.simulation import console_scene, operating_scene, procedure_scene, tissue_scene
from twin.simulation.condition import Condition
from twin.simulation.session import session_run
from twin.simulation.setup import Setup
from twin.simulation.tasks.procedure.procedure_surgeon import ProcedureSurgeon
from twin.simulation.world import World, signal_kinds

ROOT = Path(__file__).parents[2] / "twin"
KINDS = [value for value in vars(signal_kinds).values() if isinstance(value, signal_kinds.SignalKind)]


def of_signal(name: str) -> list[signal_kinds.SignalKind]:
    """Return the kinds that a signal may be, by the second part of its name."""
    return [kind for kind in KINDS if kind.owner_of(name) is not None]


def test_each_kind_is_called_what_it_is_and_defined_once():
    for name, kind in vars(signal_kinds).items():
        if isinstance(kind, signal_kinds.SignalKind) and name != "ROBOT_TIP_TARGET":
            assert name == f"{kind.owner}_{kind.what}".upper()
    # a robot has the target of a plan at a console, that of its tip in a procedure without one
    pairs = [(kind.owner, kind.what, kind.shape) for kind in KINDS]
    assert len(pairs) == len(set(pairs))
    assert all(kind.unit and kind.meaning for kind in KINDS)


def test_name_owner_and_size_of_a_kind():
    goal = signal_kinds.ROBOT_GOAL
    assert goal.of("psm1") == "psm1.goal"
    assert goal.owner_of("psm1.goal") == "psm1"
    assert goal.owner_of("psm1.goal.written") is None
    assert goal.owner_of("psm1.q") is None
    assert signal_kinds.CONSOLE_MODE.name == "console.mode"
    assert (goal.size, signal_kinds.ROBOT_JAW.size, signal_kinds.ROBOT_Q.size) == (16, 1, None)


def test_no_name_of_a_known_signal_is_put_together_elsewhere():
    """Not by an f-string of an owner and `.goal`, nor as a literal such as "console.mode"."""
    endings = {f".{kind.what}" for kind in KINDS}
    literals = {kind.name for kind in KINDS}
    suspects = [*(f'}}{end}"' for end in endings), *(f'"{name}"' for name in literals)]
    rooms = ("simulation", "ui/session", "ui/headset", "ui/report", "api")
    wrong = []
    for room in rooms:
        for file in sorted((ROOT / room).rglob("*.py")):
            text = file.read_text(encoding="utf-8")
            if file == Path(signal_kinds.__file__) or not any(suspect in text for suspect in suspects):
                continue
            for node in ast.walk(ast.parse(text)):
                if isinstance(node, ast.JoinedStr) and len(node.values) == 2:
                    owner, end = node.values
                    if isinstance(owner, ast.FormattedValue) and isinstance(end, ast.Constant) and end.value in endings:
                        wrong.append(f"{file.name}:{node.lineno}")
                if isinstance(node, ast.Constant) and node.value in literals:
                    wrong.append(f"{file.name}:{node.lineno}")
    assert not wrong


@pytest.mark.parametrize("scene", ["davinci", "sher_phantom", pytest.param("raven_dome", marks=pytest.mark.slow)])
def test_every_signal_of_a_world_has_a_kind_of_its_size(scene):
    scene = twin.load_scene(scene)
    task = next(iter(scene.tasks.values()))
    members = members_of(robots_at(console_scene.led_by(scene)))
    props = props_of(scene) if task.kind.props else None
    condition = Condition(haptics=True) if task.kind.props else None
    setup = Setup(scene, members, task, props, condition)
    require_kinds(console_scene.world(setup, session_run.surgeon(setup, seed=0)))


@pytest.mark.slow
def test_every_signal_of_an_operation_has_a_kind_of_its_size():
    scene = twin.load_scene("vsrs")
    task = next(task for task in scene.tasks.values() if not task.kind.console)
    robots = robots_at(operating_scene.robots_of(Setup(scene, {}, task)))
    organs = tissue_scene.tissues(scene, anatomy_of(scene))
    setup = Setup(scene, members_of(robots), task, organs=organs)
    require_kinds(procedure_scene.world(setup, ProcedureSurgeon(setup, 0, "")))


def require_kinds(world: World) -> None:
    names = [name for name in world.signals.sizes if not name.endswith(".written")]
    assert len(names) > 10
    for name in names:
        kinds = of_signal(name)
        assert kinds, f"{name} has no definition in signal_kinds"
        sizes = [kind.size for kind in kinds]
        assert None in sizes or world.signals.sizes[name] in sizes, (name, world.signals.sizes[name], sizes)
