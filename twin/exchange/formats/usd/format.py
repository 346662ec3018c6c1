"""USD in lists of formats."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from twin.core.foreign.budget import BUDGETS, STAGE_SUFFIXES
from twin.exchange.format import Format, FormatVariant, Holds, Places

_SUBLAYER = re.compile(r"@([^@\0]+\.usd[ac]?)@")

_SEARCHED = 200_000
"""Number of characters at the start of a layer in which names of sublayers are searched."""


def without_sublayers(stages: Sequence[Path]) -> list[Path]:
    """Return the stages that are not sublayers of another stage, or that have sublayers of their own."""
    named: set[Path] = set()
    naming: set[Path] = set()
    for stage in stages:
        # Only text is searched: binary layers are compressed, and USD's parser runs later, guarded in another
        # process.
        if stage.suffix != ".usda":
            continue
        try:
            text = stage.read_text(encoding="utf-8", errors="replace")[:_SEARCHED]
        except OSError:
            continue
        for target in _SUBLAYER.findall(text):
            named.add((stage.parent / target).resolve())
            naming.add(stage.resolve())
    # <robot>.usda is a sublayer of the stages of its motions, and with its own sublayers a stage for users too.
    return [s for s in stages if s.resolve() not in named or s.resolve() in naming]


FORMAT = Format(
    name="usd",
    title="USD",
    places=Places(export=10, use=30, audit=30, new=40),
    variants=(
        FormatVariant("usda", ".usda", "USD", BUDGETS["USD"], rank=20, trust=10),
        FormatVariant("usd", ".usd", "USD", BUDGETS["USD"], rank=20, trust=11),
        FormatVariant("usdc", ".usdc", "USD", BUDGETS["USD"], rank=20, trust=12),
    ),
    outermost=without_sublayers,
    holds=Holds.LINKS | Holds.REST | Holds.MASSES | Holds.ONE_MOTION | Holds.UNNAMED_MOTION | Holds.ALL_NAMES,
    code="usd",
    guard="USD",
    sources=STAGE_SUFFIXES,
    takes=("root",),
    use="- Isaac Sim, Omniverse, Newton, PhysX: open usd/<robot>_sim.usda to simulate (joint state is authored, loops "
    "are outside of the articulation, self collision is off); usd/<robot>_<protocol>.usda to watch a motion. "
    "Newton starts at home by its default importer, but its MuJoCo solver closes loops with its own soft springs: "
    "set solver.mj_model.eq_solref to (0.001, 1) and eq_solimp to (0.9999, 0.9999, 0.001, 0.5, 2), or load the "
    "MJCF, whose springs it reads.",
)
