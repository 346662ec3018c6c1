"""Check the layers of which a stage consists: its default prim, layers that are missing, and layers that none uses."""

from __future__ import annotations

from pathlib import Path

from pxr import Sdf, Usd

from twin.exchange.audit.ledger import Ledger


def check_default_prim(stage: Usd.Stage, ledger: Ledger) -> None:
    """Report a default prim that is not shown, and a layer that completes others but is read as a stage."""
    layer = stage.GetRootLayer()
    if _completes_others(layer):
        listed = ", ".join(str(prim.path) for prim in layer.rootPrims)
        text = (
            f"{layer.GetDisplayName()} defines no prim: it only states values for {listed}, which another layer must "
            "define."
        )
        advice = "add it to the sublayers of its stage, such as <robot>_<motion>.usda of a motion, or delete it"
        ledger.wrong("usd.unused_layer", text, "subLayers", suggestion=advice)
        return
    fault = _default_prim_fault(stage)
    if fault:
        ledger.wrong("usd.default_prim", fault, "defaultPrim", suggestion="name a prim that is shown")


def _completes_others(layer: Sdf.Layer) -> bool:
    """Return whether a layer has values for prims but defines none, and names no layers that do."""
    if layer.subLayerPaths or not layer.rootPrims:
        return False
    defining: list[Sdf.Path] = []

    def visit(path: Sdf.Path) -> None:
        prim = layer.GetPrimAtPath(path) if path.IsPrimPath() else None
        if prim is not None and (prim.specifier != Sdf.SpecifierOver or prim.hasReferences or prim.hasPayloads):
            defining.append(path)

    layer.Traverse(Sdf.Path.absoluteRootPath, visit)
    return not defining


def _default_prim_fault(stage: Usd.Stage) -> str:
    """Return the fault of the default prim of a stage as a sentence; "" if it is shown."""
    name = stage.GetRootLayer().defaultPrim
    if not name:
        return ""
    prim = None
    if Sdf.Path.IsValidPathString(name):  # a name, or since OpenUSD 23.11 a path
        prim = stage.GetPrimAtPath(Sdf.Path(name).MakeAbsolutePath(Sdf.Path.absoluteRootPath))
    if not prim:
        return f"the default prim '{name}' does not exist."
    if not prim.IsActive():
        return f"the default prim '{name}' is inactive: nothing of it is shown."
    if prim.IsAbstract():
        return f"the default prim '{name}' is a class: nothing of it is shown."
    if not prim.IsDefined():
        return f"the default prim '{name}' is not defined by any layer: nothing of it is shown."
    return ""


def missing_physics(stage: Usd.Stage) -> str:
    """Return why a stage of this project has no bodies, as a sentence; "" if it is none of this project.

    A layer with the physics of its robot lies beside it and is none of its layers, or one of its layers is empty.
    """
    root = stage.GetRootLayer()
    if not root.subLayerPaths:
        return ""
    unused = _unused_physics(stage, root)
    if unused:
        return f"the stage has no physics; {unused} beside it holds that of its robot, but is none of its layers."
    marked = any(prim.GetAttribute("twin:kind") for prim in stage.TraverseAll())
    if marked:
        empty = [layer.GetDisplayName() for layer in stage.GetUsedLayers() if not layer.rootPrims and layer != root]
        # The anonymous session layer of an opened stage is empty as well, and belongs to no file.
        named = [name for name in empty if not name.startswith("session")]
        cause = f": layer {named[0]} is empty" if named else ""
        return f"the stage has frames and points of a robot, but no link with physics{cause}."
    return ""


def _unused_physics(stage: Usd.Stage, root: Sdf.Layer) -> str:
    used_layers = {layer.realPath for layer in stage.GetUsedLayers()}
    for file in sorted(Path(root.realPath).parent.glob("*.usda")):
        if str(file) in used_layers:
            continue
        layer = Sdf.Layer.FindOrOpen(str(file))
        prim = layer.GetPrimAtPath(f"/{root.defaultPrim}") if layer and root.defaultPrim else None
        if (
            prim
            and layer.defaultPrim == root.defaultPrim
            and "twin:base" in prim.attributes
            and not layer.subLayerPaths
        ):
            return file.name
    return ""
