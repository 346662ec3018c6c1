"""Evaluate the options --protocol, --all-protocols, --variant and --device."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

from twin.core import compute_device
from twin.core.compute_device import Choice
from twin.core.errors import TwinError, unknown

if TYPE_CHECKING:
    from twin.api.robot import Robot


def protocols(robot: Robot, args: argparse.Namespace) -> tuple[str, ...]:
    """Return the chosen protocols, by default the robot's default protocol.

    Raises:
        TwinError: the robot has no protocols, or one of the chosen protocols is invalid.
    """
    if robot.files is None:
        raise TwinError(
            f"{robot.name} was loaded from {robot.source.kind}, which has neither equations nor protocols to validate; "
            "`twin new` makes a robot folder for them"
        )
    if getattr(args, "all_protocols", False):
        chosen = tuple(robot.files.protocols())
        if not chosen:
            raise TwinError(f"{robot.name}: there is no protocol in {robot.files.trajectories}")
    else:
        chosen = (args.protocol or robot.source.description.default_protocol,)
    for name in chosen:
        robot.protocol(name)  # report invalid values before computing and writing
    return chosen


def device(args: argparse.Namespace) -> Choice:
    """Return what computes: the value of --device, else that of the environment variable TWIN_DEVICE, else "auto".

    Raises:
        TwinError: the variable has another value.
    """
    if args.device is not None:
        return args.device
    return compute_device.of_environment("auto")


def stated_variants(texts: Sequence[str]) -> str | dict[str, str] | None:
    """Return the variants of `--variant`: one name for all equations, or {equation: name}; None without the option.

    Raises:
        TwinError: names are mixed with EQ=NAME pairs, several names are given, or an equation is given twice.
    """
    names: list[str] = []
    pairs: dict[str, str] = {}
    for text in texts:
        equation, equals, variant = text.partition("=")
        if equals:
            pairs[equation] = variant
        else:
            names.append(text)
    if names and len(texts) > 1:
        raise TwinError("--variant: give one variant name alone, or only EQ=NAME pairs")
    if names:
        return names[0]
    if len(pairs) < len(texts):
        raise TwinError("--variant: an equation is given twice; give each equation once")
    return pairs or None


def variants_of_each(robot: Robot, texts: Sequence[str]) -> list[dict[str, str] | None]:
    """Return one entry for each report to write: the variant of each equation, or None for the default variants.

    If n > 1 equations have a variant of the given name, there are n + 1 reports: in each of the first n, one equation
    uses this variant; in the last one, all n equations use it.

    Raises:
        TwinError: no equation has a variant of a given name.
    """
    chosen = stated_variants(texts)
    if chosen is None:
        return [None]
    choices = robot.variants
    if isinstance(chosen, str):
        existing: set[str] = set()
        alone: list[dict[str, str] | None] = []
        together: dict[str, str] = {}
        for equation, names in choices.items():
            existing.update(names)
            if chosen in names:
                alone.append({equation: chosen})
                together[equation] = chosen
        if not alone:
            raise TwinError(f"--variant: {unknown('variant', chosen, existing)}")
        if len(alone) == 1:
            return alone
        # each equation alone first: together, errors of printed equations can cancel or hide each other
        return [*alone, together]
    for equation, name in chosen.items():
        if equation not in choices:
            raise TwinError(f"--variant: {unknown('equation', equation, choices)}")
        if name not in choices[equation]:
            raise TwinError(f"--variant {equation}: {unknown('variant', name, choices[equation])}")
    return [chosen]
