"""Every declared field of the stages of an export, and one change of each; see `audit_fields`.

A field is a number of an attribute (of an array, that of one element), a time sample, a target of a relationship, an
entry of a prim's or layer's metadata or customData, a prim as a whole, or a property that the prim's schemas know and
the layer does not state.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, Vt

from made.audit_fields import MILLIMETRES, FieldChange

LENGTHS = ("localPos", "centerOfMass", "xformOp:translate", "points", "extent")
ANGLES = ("Limit", "targetPosition", "state:angular")

Edit = Callable[[Sdf.Layer], None]


def usd_change(file: str, kind: str, path: Sdf.Path, words: set[str], change: Edit) -> FieldChange:
    """Return a change of a layer; its subjects are the names of the prims at and above a path, and words."""

    def edit(folder: Path) -> None:
        layer = Sdf.Layer.OpenAsAnonymous(str(folder / file))
        change(layer)
        (folder / file).unlink()
        assert layer.Export(str(folder / file))

    names = {prefix.name for prefix in path.GetPrimPath().GetPrefixes()[1:]}
    names -= {"joints", "materials", ""}
    if path.pathElementCount == 1:
        names |= {"default prim", "layer", "articulation root"}
    elif not names or path.name == "joints":
        names.add("joint")
    return FieldChange(file, kind, str(path), frozenset({*names, *words}), edit)


UNREADABLE = {"subLayers", "subLayerOffsets", "primChildren", "properties", "targetPaths", "connectionPaths"}
"""Fields of specs that are read in another way."""


def numbers_in(value: Any) -> np.ndarray | None:
    """Return the numbers of a value as floats; None if it has none."""
    if isinstance(value, bool | str) or value is None:
        return None
    if isinstance(value, int | float):
        return np.array([float(value)])
    if isinstance(value, Gf.Quatf | Gf.Quatd | Gf.Quath):
        return np.array([value.GetReal(), *value.GetImaginary()], float)
    try:
        found = np.array(value, float)
    except (TypeError, ValueError):
        return None
    return found.ravel() if found.size else None


def rebuilt(value: Any, numbers: np.ndarray) -> Any:
    """Return a value of the same type with other numbers."""
    kind = type(value)
    if isinstance(value, int):
        rounded = round(float(numbers[0]))
        return rounded if rounded != value else value + 1
    if isinstance(value, float):
        return float(numbers[0])
    if isinstance(value, Gf.Quatf | Gf.Quatd | Gf.Quath):
        real, *imaginary = numbers.tolist()
        return kind(real, *imaginary)
    shaped = numbers.reshape(np.array(value).shape)
    if kind.__name__.endswith("Array"):
        return kind.FromNumpy(shaped.astype(np.array(value).dtype))
    if shaped.ndim == 2:  # a matrix
        return kind(shaped.tolist())
    return kind(*shaped.tolist())


def number_changes(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield (change, changed value) of the numbers of a value; of an array, of one element in the middle."""
    numbers = numbers_in(value)
    if numbers is None:
        return
    array = type(value).__name__.endswith("Array")
    shape = np.array(value).shape
    width = 1 if len(shape) < 2 or not array else shape[1]
    if not array and len(numbers) <= 16:
        width = len(numbers)
    first = (len(numbers) // width // 2) * width if array else 0
    for k in range(width):
        at = first + k
        x = numbers[at]
        step = 0.01 * x if x else MILLIMETRES
        if any(part in name for part in LENGTHS):
            step = MILLIMETRES
        elif any(part in name for part in ANGLES):
            step = 0.5
        index = f"[{k}]" if width > 1 else ""
        small = numbers.copy()
        small[at] += step
        yield f"{index}: small", rebuilt(value, small)
        if x:
            negated = numbers.copy()
            negated[at] = -x
            yield f"{index}: sign", rebuilt(value, negated)
        if k + 1 < width and abs(x - numbers[at + 1]) > 1e-7:
            swapped = numbers.copy()
            swapped[[at, at + 1]] = numbers[[at + 1, at]]
            yield f"{index}: exchanged with the next", rebuilt(value, swapped)
    if array and len(value) > 1:
        kind = type(value)
        yield ": without its last", kind(list(value)[:-1])
        yield ": reversed", kind(list(value)[::-1])


def value_changes(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield (change, changed value) of a value of any type."""
    if isinstance(value, bool):
        yield ": not", not value
    elif isinstance(value, str):
        yield ": unknown", f"{value}_x"
    elif isinstance(value, Vt.TokenArray | Vt.StringArray):
        words = list(value)
        yield ": reversed", type(value)(words[::-1])
        yield ": without its last", type(value)(words[:-1])
    else:
        yield from number_changes(name, value)


TOKENS = {
    "physics:axis": ("X", "Y", "Z"),
    "drive": ("force", "acceleration"),
    "purpose": ("default", "render", "proxy", "guide"),
    "visibility": ("inherited", "invisible"),
    "orientation": ("rightHanded", "leftHanded"),
    "physics:approximation": ("convexHull", "none", "boundingCube", "sdf"),
    "interpolation": ("faceVarying", "vertex", "constant", "uniform"),
    "subdivisionScheme": ("none", "catmullClark", "loop"),
}
"""Other words of tokens, by a part of the attribute's name."""


def leaves(data: dict[str, Any], path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    for key, value in data.items():
        if isinstance(value, dict):
            yield from leaves(value, (*path, key))
        else:
            yield (*path, key), value


def with_leaf(data: dict[str, Any], path: tuple[str, ...], value: Any) -> dict[str, Any]:
    """Return a nested dictionary in which one leaf has another value; None removes it."""
    key, *rest = path
    out = dict(data)
    if rest:
        out[key] = with_leaf(out[key], tuple(rest), value)
    elif value is None:
        del out[key]
    else:
        out[key] = value
    return out


def declared_changes(folder: Path, file: str) -> Iterator[FieldChange]:
    """Yield one change of each kind for each field of a layer."""
    layer = Sdf.Layer.OpenAsAnonymous(str(folder / file))
    label = Path(file).name.replace(folder.name, "ROBOT")
    root = layer.pseudoRoot
    for key in sorted(set(root.ListInfoKeys()) - UNREADABLE):
        yield from metadata_changes(file, f"{label} {key}", Sdf.Path("/"), key, root.GetInfo(key))
    if len(layer.subLayerPaths):

        def first_lost(own: Sdf.Layer) -> None:
            del own.subLayerPaths[0]

        yield usd_change(file, f"{label} subLayers: without its first", Sdf.Path("/"), {"layer"}, first_lost)
    paths: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path("/"), paths.append)
    for path in paths:
        if path.IsPrimPath():
            yield from prim_changes(file, label, layer, path)
        elif path.IsPropertyPath():
            prop = layer.GetPropertyAtPath(path)
            kind = f"{label} {typed(layer, path)}.{path.name}"
            if isinstance(prop, Sdf.AttributeSpec):
                yield from attribute_changes(file, kind, prop)
            else:
                yield from relationship_changes(file, kind, layer, prop)


def typed(layer: Sdf.Layer, path: Sdf.Path) -> str:
    """Return the type of the prim of a path; of an over, that of its depth."""
    prim = layer.GetPrimAtPath(path.GetPrimPath())
    return prim.typeName or f"over{path.GetPrimPath().pathElementCount}"


def metadata_changes(
    file: str, kind: str, path: Sdf.Path, key: str, value: Any, named: Iterable[str] = ()
) -> Iterator[FieldChange]:
    words = {key, "up" if key == "upAxis" else key, *named}

    def setter(new: Any) -> Edit:
        def change(own: Sdf.Layer) -> None:
            spec = own.pseudoRoot if path == Sdf.Path("/") else own.GetObjectAtPath(path)
            if new is None:
                spec.ClearInfo(key)
            else:
                spec.SetInfo(key, new)

        return change

    if key in ("primChildren", "properties", "subLayers", "subLayerOffsets", "variability", "typeName"):
        return
    if isinstance(value, dict):
        for leaf, old in leaves(value):
            named = "/".join(part if k in (0, 1) or k == len(leaf) - 1 else "*" for k, part in enumerate(leaf))
            changes = [*value_changes(leaf[-1], old), (": removed", None)]
            for name, new in changes:
                words_ = {*words, *leaf}
                yield usd_change(file, f"{kind}/{named}{name}", path, words_, setter(with_leaf(value, leaf, new)))
        return
    if isinstance(value, Sdf.TokenListOp):
        for k, item in enumerate(value.prependedItems):
            fewer = Sdf.TokenListOp()
            fewer.prependedItems = [t for i, t in enumerate(value.prependedItems) if i != k]
            yield usd_change(file, f"{kind}: without {item}", path, {*words, item}, setter(fewer))
        return
    yield usd_change(file, f"{kind}: removed", path, words, setter(None))
    others = {"upAxis": ["Y", "X"], "specifier": [Sdf.SpecifierOver, Sdf.SpecifierClass]}.get(key)
    for token_key, tokens in TOKENS.items():
        if token_key == key:
            others = [t for t in tokens if t != value]
    if others is not None:
        for other in others:
            if other != value:
                yield usd_change(file, f"{kind}: {other}", path, words, setter(other))
        return
    for name, new in value_changes(key, value):
        yield usd_change(file, f"{kind}{name}", path, words, setter(new))


def prim_changes(file: str, label: str, layer: Sdf.Layer, path: Sdf.Path) -> Iterator[FieldChange]:
    prim = layer.GetPrimAtPath(path)
    kind = f"{label} {typed(layer, path)}"
    own = {str(prim.typeName), path.name} - {""}
    for key in sorted(set(prim.ListInfoKeys()) - UNREADABLE):
        yield from metadata_changes(file, f"{kind} ({key})", path, key, prim.GetInfo(key), own)

    def removed(own: Sdf.Layer) -> None:
        p = own.GetPrimAtPath(path)
        del (p.nameParent or own.pseudoRoot).nameChildren[p.name]

    def renamed(own: Sdf.Layer) -> None:
        own.GetPrimAtPath(path).name = f"{path.name}_x"

    def duplicated(own: Sdf.Layer) -> None:
        Sdf.CopySpec(own, path, own, path.ReplaceName(f"{path.name}_x"))

    def flag(key: str, value: Any) -> Edit:
        return lambda own: own.GetPrimAtPath(path).SetInfo(key, value)

    yield usd_change(file, f"{kind}: removed", path, own, removed)
    yield usd_change(file, f"{kind}: renamed", path, {f"{path.name}_x", *own}, renamed)
    yield usd_change(file, f"{kind}: duplicated", path, {f"{path.name}_x"}, duplicated)
    yield usd_change(file, f"{kind}: inactive", path, own, flag("active", False))
    yield usd_change(file, f"{kind}: instanceable", path, own, flag("instanceable", True))
    if prim.typeName:
        yield usd_change(file, f"{kind}: without a type", path, own, flag("typeName", ""))
        for mine, other in (("Revolute", "Prismatic"), ("Prismatic", "Revolute"), ("Spherical", "Fixed")):
            if mine in prim.typeName:
                word = prim.typeName.replace(mine, other)
                yield usd_change(file, f"{kind}: {word}", path, own, flag("typeName", word))
    siblings = list(layer.GetPrimAtPath(path.GetParentPath()).nameChildren) if path.pathElementCount > 1 else []
    other = next((p.path for p in siblings if p.path != path and p.name not in ("joints", "materials")), None)
    if other is not None:

        def moved(own: Sdf.Layer) -> None:
            Sdf.CopySpec(own, path, own, other.AppendChild(path.name))
            removed(own)

        yield usd_change(file, f"{kind}: below a sibling", path, {other.name}, moved)


def attribute_changes(file: str, kind: str, prop: Sdf.AttributeSpec) -> Iterator[FieldChange]:
    path, name = prop.path, prop.name
    words = {part for part in name.split(":") if len(part) > 3} | {name}

    def removed(own: Sdf.Layer) -> None:
        p = own.GetPrimAtPath(path.GetPrimPath())
        del p.properties[name]

    def blocked(own: Sdf.Layer) -> None:
        own.GetAttributeAtPath(path).default = Sdf.ValueBlock()

    def setter(new: Any) -> Edit:
        def change(own: Sdf.Layer) -> None:
            own.GetAttributeAtPath(path).default = new

        return change

    yield usd_change(file, f"{kind}: removed", path, words, removed)
    if prop.HasDefaultValue():
        yield usd_change(file, f"{kind}: blocked", path, words, blocked)
        others = next((t for part, t in TOKENS.items() if part in name and prop.default in t), None)
        if others is not None:
            for other in others:
                if other != prop.default:
                    yield usd_change(file, f"{kind}: {other}", path, words, setter(other))
        else:
            for change, new in value_changes(name, prop.default):
                yield usd_change(file, f"{kind}{change}", path, words, setter(new))
    for key in prop.ListInfoKeys():
        if key in ("interpolation", "elementSize", "unauthoredValuesIndex"):
            yield from metadata_changes(file, f"{kind} ({key})", path, key, prop.GetInfo(key))
    if list(prop.connectionPathList.GetAddedOrExplicitItems()):

        def cut(own: Sdf.Layer) -> None:
            own.GetAttributeAtPath(path).connectionPathList.ClearEdits()

        yield usd_change(file, f"{kind}: without its connection", path, words, cut)
    times = prop.layer.ListTimeSamplesForPath(path)
    if times:
        middle = times[len(times) // 2]
        old = prop.layer.QueryTimeSample(path, middle)
        for change, new in value_changes(name, old):

            def sampled(own: Sdf.Layer, new: Any = new) -> None:
                own.SetTimeSample(path, middle, new)

            yield usd_change(file, f"{kind} sample{change}", path, words, sampled)

        def lost(own: Sdf.Layer) -> None:
            own.EraseTimeSample(path, middle)

        def last_lost(own: Sdf.Layer) -> None:
            own.EraseTimeSample(path, times[-1])

        def shifted(own: Sdf.Layer) -> None:
            own.EraseTimeSample(path, middle)
            own.SetTimeSample(path, middle + 0.3, old)

        yield usd_change(file, f"{kind} sample: lost", path, words, lost)
        yield usd_change(file, f"{kind} last sample: lost", path, words, last_lost)
        yield usd_change(file, f"{kind} sample: later", path, words, shifted)


def relationship_changes(file: str, kind: str, layer: Sdf.Layer, prop: Sdf.RelationshipSpec) -> Iterator[FieldChange]:
    path, name = prop.path, prop.name
    targets = list(prop.targetPathList.GetAddedOrExplicitItems())
    words = {name, name.rpartition(":")[2], *(t.name for t in targets)}

    def setter(new: list[Sdf.Path]) -> Edit:
        def change(own: Sdf.Layer) -> None:
            items = own.GetRelationshipAtPath(path).targetPathList
            items.ClearEditsAndMakeExplicit()
            items.explicitItems = new

        return change

    yield usd_change(file, f"{kind}: without targets", path, words, setter([]))
    if not targets:
        return
    unknown = targets[0].ReplaceName(f"{targets[0].name}_x")
    yield usd_change(file, f"{kind}: unknown target", path, {*words, unknown.name}, setter([unknown]))
    above = layer.GetPrimAtPath(targets[0].GetParentPath())
    near = list(above.nameChildren) if above else []
    others = [p.path for p in near if p.path not in targets and p.name not in ("joints", "materials")]
    if others:
        other = others[0]
        yield usd_change(file, f"{kind}: another target", path, {*words, other.name}, setter([other]))
        yield usd_change(file, f"{kind}: one more target", path, {*words, other.name}, setter([*targets, other]))


def undeclared_changes(folder: Path, stage_file: str, file: str) -> Iterator[FieldChange]:
    """Yield properties that the schemas of the prims know and no layer states, with another value than the fallback.

    They are written into the layer `file`, over the prims of the stage `stage_file`.
    """
    stage = Usd.Stage.Open(str(folder / stage_file))
    label = Path(file).name.replace(folder.name, "ROBOT")
    for prim in stage.Traverse():
        if not stage.GetRootLayer() or prim.GetPath().pathElementCount < 1:
            continue
        for attribute in prim.GetAttributes():
            if attribute.HasAuthoredValue() or attribute.IsCustom():
                continue
            kind = prim.GetTypeName() or "untyped"
            for name, value in other_values(attribute):
                path, type_name, variability = attribute.GetPath(), attribute.GetTypeName(), attribute.GetVariability()

                def added(own, path=path, type_name=type_name, variability=variability, value=value) -> None:
                    p = Sdf.CreatePrimInLayer(own, path.GetPrimPath())
                    Sdf.AttributeSpec(p, path.name, type_name, variability).default = value

                words = {part for part in path.name.split(":") if len(part) > 3} | {path.name}
                yield usd_change(file, f"{label} {kind}.{path.name} added: {name}", path, words, added)


def other_values(attribute: Usd.Attribute) -> Iterator[tuple[str, Any]]:
    """Yield (text, value) of values of an attribute that differ from its fallback."""
    fallback = attribute.Get()
    if isinstance(fallback, bool):
        yield f"{not fallback}", not fallback
    elif isinstance(fallback, str):
        allowed = attribute.GetMetadata("allowedTokens") or ()
        for token in list(allowed)[:4]:
            if token != fallback:
                yield token, token
    elif isinstance(fallback, int | float):
        for value in (0, 1) if isinstance(fallback, int) else (0.0, 0.5):
            if value != fallback:
                yield f"{value}", value
    elif fallback is not None:
        numbers = numbers_in(fallback)
        if numbers is not None and len(numbers) <= 4:
            yield "0.3 each", rebuilt(fallback, np.full(len(numbers), 0.3))
