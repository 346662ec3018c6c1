"""Check what a stage shows and collides: materials of its shapes, shapes that belong to no link, and colliders."""

from __future__ import annotations

from collections.abc import Set

from pxr import Sdf, Usd, UsdGeom, UsdPhysics, UsdShade

from twin.exchange.audit.ledger import Ledger
from twin.exchange.formats.usd.audit.link_shapes import is_for_display, owner_of


def check_materials(prims: list[Usd.Prim], ledger: Ledger) -> None:
    """Report shapes that bind no material or cannot bind it, and materials without their shader."""
    bound: dict[Sdf.Path, UsdShade.Material] = {}
    for prim in prims:
        binding = prim.GetRelationship("material:binding")
        if not binding or not binding.HasAuthoredTargets():
            continue
        path = str(prim.GetPath())
        if not prim.HasAPI(UsdShade.MaterialBindingAPI):
            text = f"{path} binds a material without MaterialBindingAPI: strict readers show it grey."
            ledger.wrong("usd.material_api", text, path, suggestion="apply MaterialBindingAPI")
        for target in binding.GetTargets():
            material = prim.GetStage().GetPrimAtPath(target)
            if not material or not material.IsA(UsdShade.Material):
                text = f"{path} binds {target}, which is not a material."
                ledger.wrong("usd.material", text, path, suggestion="bind an existing material")
            else:
                bound.setdefault(target, UsdShade.Material(material))
    for target, material in bound.items():
        if _has_lost_shader(material):
            text = f"the material {target} has no shader: its surface is connected to nothing that the stage shows."
            ledger.wrong("usd.material", text, str(target), suggestion="define and activate the shader again")


def _has_lost_shader(material: UsdShade.Material) -> bool:
    """Return whether a material has shaders that its surface is not connected to, or is connected to a lost one.

    Lost are shaders that are not there, are inactive, or are classes. A material without shaders may be one of physics.
    """
    outputs = [*material.GetSurfaceOutputs(), *material.GetVolumeOutputs()]
    if not any(output.GetAttr().HasAuthoredConnections() for output in outputs):
        return any(child.IsA(UsdShade.Shader) for child in material.GetPrim().GetChildren())
    output = material.GetSurfaceOutput()
    if not output or not output.GetAttr().HasAuthoredConnections():
        return False
    shader, *_ = material.ComputeSurfaceSource()
    if not shader:
        return True
    prim = shader.GetPrim()
    return not prim.IsActive() or prim.IsAbstract()


def check_stray(prims: list[Usd.Prim], bodies: Set[Sdf.Path], ledger: Ledger) -> None:
    """Report visible shapes that belong to no link, and shapes without a material if others have one."""
    shown = [prim for prim in prims if prim.IsA(UsdGeom.Gprim) and is_for_display(prim)]
    colored = {prim.GetPath() for prim in shown if _has_material(prim)}
    for prim in shown:
        path = str(prim.GetPath())
        if bodies.isdisjoint(prim.GetPath().GetAncestorsRange()):
            text = f"the shape {path} belongs to no link: it stays in place while the robot moves."
            ledger.add("usd.stray", "warning", text, path, suggestion="move the shape below its link, or delete it")
        elif colored and prim.GetPath() not in colored:
            text = f"the shape {path} has no material, but {len(colored)} other shapes have one."
            ledger.add("usd.no_material", "warning", text, path, suggestion="bind the material again")


def check_colliders(prims: list[Usd.Prim], ledger: Ledger) -> None:
    """Report colliders that are disabled while others of the stage are enabled."""
    enabled_count = 0
    disabled = []
    for prim in prims:
        if not prim.HasAPI(UsdPhysics.CollisionAPI):
            continue
        if UsdPhysics.CollisionAPI(prim).GetCollisionEnabledAttr().Get() is False:
            disabled.append(prim)
        else:
            enabled_count += 1
    if not enabled_count:  # a stage to look at, without contacts
        return
    for prim in disabled:
        path = str(prim.GetPath())
        text = f"the collider {path} is disabled, but {enabled_count} others are enabled."
        ledger.add("usd.collider", "warning", text, path, suggestion="enable the collider, or remove its CollisionAPI")


def colliding_links(prims: list[Usd.Prim], links: Set[Sdf.Path]) -> dict[str, bool]:
    """Return {link: False} of the links that show a mesh whose collider is disabled, True of others that collide.

    Links whose shown meshes have disabled colliders may collide by simpler shapes, which are guides: such are True. A
    stage all of whose colliders are disabled states nothing: it is one to look at.
    """
    collides: dict[str, bool] = {}
    by_guides: set[str] = set()
    for prim in prims:
        if not prim.HasAPI(UsdPhysics.CollisionAPI):
            continue
        owner = owner_of(prim, links)
        if owner is None:
            continue
        link = owner.GetName()
        is_enabled = UsdPhysics.CollisionAPI(prim).GetCollisionEnabledAttr().Get() is not False
        if is_enabled and not is_for_display(prim):
            by_guides.add(link)
        collides[link] = collides.get(link, True) and is_enabled
    collides |= dict.fromkeys(by_guides, True)
    if not any(collides.values()):
        return {}
    return collides


def has_shape(body: Usd.Prim, bodies: Set[Sdf.Path]) -> bool:
    """Return whether viewers show any shape of a body; shapes of bodies below it do not count."""
    prims = iter(Usd.PrimRange(body, Usd.TraverseInstanceProxies()))
    for prim in prims:
        if prim != body and prim.GetPath() in bodies:
            prims.PruneChildren()
            continue
        invisible = UsdGeom.Imageable(prim).ComputeVisibility() == UsdGeom.Tokens.invisible
        if prim.IsA(UsdGeom.Gprim) and is_for_display(prim) and not invisible:
            return True
    return False


def _has_material(prim: Usd.Prim) -> bool:
    """Return whether a material is bound to a shape, or to some of its faces."""
    if UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]:
        return True
    return prim.IsA(UsdGeom.Mesh) and bool(UsdGeom.Subset.GetAllGeomSubsets(UsdGeom.Mesh(prim)))
