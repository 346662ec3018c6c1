"""USDZ in lists of formats."""

from __future__ import annotations

from twin.core.foreign.budget import BUDGETS
from twin.exchange.format import Format, FormatVariant, Holds, Places

FORMAT = Format(
    name="usdz",
    title="USDZ",
    places=Places(export=20, use=20, audit=40),
    variants=(FormatVariant("usdz", ".usdz", "USDZ", BUDGETS["USDZ"], rank=50, trust=70),),
    holds=Holds.UNNAMED_MOTION | Holds.REPEATED_MOTION,
    code="usd",
    guard="USD",
    use="- iPhone, iPad, Vision Pro: open the .usdz in AR Quick Look; the motion plays in a loop.",
)
