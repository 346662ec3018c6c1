"""Read and check the materials of a glTF file."""

from __future__ import annotations

from twin.core.json_types import JsonObject
from twin.exchange.audit.ledger import Measured
from twin.exchange.audit.poses import Array
from twin.exchange.formats.glb.audit.container import Gltf
from twin.exchange.formats.glb.audit.nodes import numbers

_ALPHA_MODES = ("OPAQUE", "MASK", "BLEND")
"""Values of alphaMode in glTF 2.0, 3.9.4."""


def check_materials(file: Gltf) -> None:
    """Report values that glTF does not allow, and materials that viewers show opaque or not at all despite their alpha.

    These are transparent ones with the alphaMode OPAQUE, which is the default, and those with MASK whose alpha is below
    the cutoff. The factors of metal and roughness are from 0 to 1.
    """
    for number, spec in enumerate(file.items("materials")):
        name = str(spec.get("name") or f"material {number}")
        pbr = spec.get("pbrMetallicRoughness", {})
        alpha = 1.0
        if isinstance(pbr, dict):
            alpha = float(base_color(pbr, f"{name}: baseColorFactor")[3])
        if alpha < 1 and spec.get("alphaMode", "OPAQUE") == "OPAQUE":
            mode = "no alphaMode"
            if "alphaMode" in spec:
                mode = "alphaMode OPAQUE"
            text = f"material '{name}' has alpha {alpha:.3g} but {mode}: it is shown opaque."
            file.ledger.wrong("gltf.alpha", text, name, size=Measured(alpha, 1.0), suggestion='write alphaMode "BLEND"')
        for key in ("metallicFactor", "roughnessFactor"):
            factor = factor_of(pbr, key) if isinstance(pbr, dict) else 1.0
            if not 0 <= factor <= 1:
                text = f"material '{name}' has the {key} {factor:.3g}, which is not from 0 to 1."
                file.ledger.wrong("gltf.material", text, name)
        if spec.get("alphaMode", "OPAQUE") not in _ALPHA_MODES:
            text = f"material '{name}' has the alphaMode {spec['alphaMode']!r}; glTF has: {', '.join(_ALPHA_MODES)}."
            file.ledger.wrong("gltf.alpha", text, name)
        cutoff = float(numbers([spec.get("alphaCutoff", 0.5)], 1, f"{name}: alphaCutoff")[0])
        if spec.get("alphaMode") == "MASK" and alpha < cutoff:
            text = f"material '{name}' has alpha {alpha:.3g}, below its alphaCutoff {cutoff:.3g}: it is not shown."
            file.ledger.wrong("gltf.alpha", text, name, size=Measured(alpha, cutoff))


def factor_of(pbr: JsonObject, key: str) -> float:
    """Return how metallic or rough a material is; the default of glTF is 1."""
    return float(numbers([pbr.get(key, 1.0)], 1, key)[0])


def base_color(pbr: JsonObject, name: str) -> Array:
    """Return the linear colour rgba (4,) of a material; the default of glTF is white. `name` is that in an error."""
    return numbers(pbr.get("baseColorFactor", (1, 1, 1, 1)), 4, name)
