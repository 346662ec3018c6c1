"""What is to be exported: the weighed mechanism, its clips, and where all of it comes from."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from twin.cad.build import inputs
from twin.core.errors import ProtocolError, TwinError
from twin.core.findings import Finding
from twin.core.provenance import Parameter
from twin.exchange.write.clip import Budget, Clip, make_clip
from twin.model.mechanism import Mechanism
from twin.planning.trajectory import Trajectory

_DRAWN = "drawing."
"""How names of lengths begin that only the drawing needs."""

Progress = Callable[[str, float], None]
Plan = Callable[..., Trajectory]
"""(robot, protocol, progress) -> its trajectory."""


class Robot(Protocol):
    """What is asked of a robot here; `twin.api.Robot` answers."""

    name: str
    files: Any

    @property
    def unwritten(self) -> bool: ...  # noqa: D102
    @property
    def cad(self) -> Any: ...  # noqa: D102
    @property
    def mechanism(self) -> Any: ...  # noqa: D102
    def weighed(self) -> Robot: ...  # noqa: D102
    def protocol(self, name: str | Path) -> Any: ...  # noqa: D102
    def bound(self, protocol: Any) -> Robot: ...  # noqa: D102
    def kinematics(self) -> Any: ...  # noqa: D102


@dataclass(frozen=True)
class Scene:
    """One clip with the mechanism as the protocol binds it (its trocar may be elsewhere)."""

    clip: Clip
    mechanism: Mechanism


@dataclass(frozen=True)
class Order:
    """Everything that the writers need, and what the readers of the bundle must be told.

    Attributes:
        mechanism: as drawn, weighed.
        scenes: one for each protocol.
        quick_looks: names of the clips that get a .usdz of their own name; the first also has the plain name.
        inputs: (shown path, sha256) of every file that it was made from.
        assumed: "name: reason" of every number that nobody has published, the protocols' aside.
        title, source: of the robot.
        findings: what was found on the way.
    """

    mechanism: Mechanism
    scenes: tuple[Scene, ...]
    quick_looks: tuple[str, ...]
    inputs: tuple[tuple[str, str], ...]
    assumed: tuple[str, ...]
    title: str
    source: str
    findings: tuple[Finding, ...]

    @property
    def clips(self) -> tuple[Clip, ...]:
        """The clips of all scenes."""
        return tuple(s.clip for s in self.scenes)

    @property
    def elsewhere(self) -> tuple[Scene, ...]:
        """Scenes that have a trocar elsewhere than drawn: a loop with a fixed place needs a file for each."""
        drawn = self.mechanism.trocar_places
        return tuple(
            s for s in self.scenes if any(not np.array_equal(s.mechanism.trocar_at(n), p) for n, p in drawn.items())
        )


def order(
    robot: Robot,
    trajectory: Trajectory | None,
    protocols: Sequence[str | Path] | None,
    budget: Budget | None,
    plan: Plan,
    progress: Progress,
) -> Order:
    """Read the robot, weigh it, plan its protocols and choose key rates.

    Args:
        robot: of CAD, or of a USD stage; a stage has no protocols, but may have motion of its own.
        trajectory: the only motion, as planned (of the first of `protocols` if they are given); None: plan them.
        protocols: names or paths; None: every one of the robot.
        budget: of each clip; None: `Budget()`. The keys of a stage are its own samples.
        plan: how a protocol becomes a trajectory.
        progress: see `twin.api.Progress`.

    Raises:
        TwinError: something is missing or wrong, or a protocol cannot be planned.
    """
    if robot.files is None:
        if protocols or trajectory is not None:
            raise TwinError(f"{robot.name} is a USD stage: it has no protocols, only the motion that is baked in it")
        return _of_stage(robot, progress)
    progress("read CAD, weigh parts", 0.0)
    files, robot = robot.files, robot.weighed()
    cad = robot.cad
    findings = [f for f in cad.findings if f.severity != "info"]
    chosen: list[str | Path] = list(files.protocols()) if protocols is None else list(protocols)
    if trajectory is not None:
        chosen = list(protocols or [trajectory.protocol])[:1]
    has_equations, optional = files.has_equations, protocols is None and robot.unwritten
    if protocols is None and trajectory is None and not has_equations and not robot.unwritten:
        if chosen:
            text = f"{robot.name} has no equations to plan with: {', '.join(map(str, chosen))} left out, no motion"
            findings.append(Finding("export.no_equations", "warning", text, suggestion="write formula.py"))
        chosen = []
    loaded = [robot.protocol(name) for name in chosen]
    scenes = []
    for i, protocol in enumerate(loaded):
        progress(f"plan {protocol.name}", i / len(loaded))
        try:
            planned = trajectory if trajectory is not None else plan(robot, protocol)
        except ProtocolError as error:
            if not optional:
                raise
            text = f"protocol {protocol.name} is left out, the mechanism cannot follow it: {error}"
            findings.append(Finding("export.not_planned", "warning", text, where=protocol.name))
            continue
        bound = robot.bound(protocol).mechanism
        progress(f"keys of {protocol.name}", (i + 0.5) / len(loaded))
        clip = make_clip(bound, planned, protocol.title, budget, _assumed(protocol.parameters()))
        scenes.append(Scene(clip, bound))
    made_from = inputs(files.description)
    made_from += [p for p in (files.cad / "dimensions.toml", files.formula) if p.is_file()]
    shown = [(_shown(p, files.cad), p) for p in made_from]
    for name, protocol in zip(chosen, loaded, strict=True):
        own = Path(name) if Path(name).suffix == ".toml" else files.protocols().get(protocol.name)
        if own is not None:
            shown.append((f"trajectories/{own.name}", own))
    numbers = [*cad.mechanism.parameters, *cad.dimensions]
    if has_equations:
        numbers += robot.kinematics().formula.parameters
    return Order(
        cad.mechanism,
        tuple(scenes),
        _quick_looks(cad.description.default_protocol, [s.clip.name for s in scenes], protocols is not None),
        tuple((name, _sha256(path)) for name, path in dict(shown).items()),
        _assumed(numbers),
        cad.description.title,
        cad.description.source,
        tuple(findings),
    )


def _of_stage(robot: Robot, progress: Progress) -> Order:
    from pxr import Usd

    from twin.exchange.write.sampled import sampled_clip

    progress("read stage", 0.0)
    mechanism = robot.mechanism
    stage = Path(mechanism.source)
    clip = sampled_clip(mechanism, stage)
    opened = Usd.Stage.Open(str(stage))  # its layers live as long as it does
    layers = sorted({Path(x.realPath) for x in opened.GetUsedLayers() if x.realPath})
    return Order(
        mechanism,
        () if clip is None else (Scene(clip, mechanism),),
        () if clip is None else (clip.name,),
        tuple((p.name, _sha256(p)) for p in layers if p.is_file()),
        _assumed(mechanism.parameters),
        mechanism.name,
        stage.name,
        (),
    )


def _quick_looks(default: str, names: list[str], asked: bool) -> tuple[str, ...]:
    """Return the clip that the plain .usdz plays, and behind it those that were asked for by name."""
    if not names:
        return ()
    first = default if default in names else names[0]
    return (first, *(n for n in names if asked and n != first))


def _assumed(parameters: Sequence[Parameter]) -> tuple[str, ...]:
    """Return "name = value: reason" of the assumed ones, each once, on one line; what was only drawn is counted."""
    assumed = [p for p in parameters if p.provenance == "ASSUMED"]
    lines = [f"{p.name} = {p.shown:g} {p.unit}: {p.note}" for p in assumed if not p.name.startswith(_DRAWN)]
    if drawn := sum(p.name.startswith(_DRAWN) for p in assumed):
        lines.append(f"{_DRAWN}*: {drawn} lengths of parts that were drawn to look right (`twin info` lists them)")
    return tuple(dict.fromkeys(" ".join(line.split()) for line in lines))


def _shown(path: Path, folder: Path) -> str:
    """Return a path that tells the file and not the machine."""
    return f"cad/{path.relative_to(folder).as_posix()}" if path.is_relative_to(folder) else path.name


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
