"""GLB in lists of formats."""

from __future__ import annotations

from twin.core.foreign.budget import BUDGETS
from twin.exchange.format import Format, FormatVariant, Holds, Places

FORMAT = Format(
    name="glb",
    title="GLB",
    places=Places(export=30, use=10, audit=20),
    variants=(
        FormatVariant("glb", ".glb", "GLTF", BUDGETS["GLTF"], rank=30, trust=60),
        FormatVariant("gltf", ".gltf", "GLTF", BUDGETS["GLTF"], rank=30, trust=61),
    ),
    holds=Holds.LINKS | Holds.REST | Holds.MASSES | Holds.ALL_MOTIONS,
    code="gltf",
    use="- Quest browser, three.js, Blender: open the .glb; each protocol is an animation of its name.",
)
