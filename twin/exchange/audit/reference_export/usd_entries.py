"""Read layers of USD as entries: the specifications of prims and properties, with all their fields."""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf

from twin.exchange.audit.reference_export.entries import Entry
from twin.exchange.audit.reference_export.text_entries import read_bytes

_READ_AS_ENTRIES = {"primChildren", "properties", "variantSetChildren", "variantChildren", "timeSamples"}
_READ_AS_ENTRIES |= {"connectionPaths", "targetPaths", "subLayerOffsets"}
"""Fields that are read in another way than by name."""


def read_layer(path: Path) -> Entry:
    """Return the content of one layer, without that of the layers below it.

    Raises:
        pxr.Tf.ErrorException: the file is not a layer of USD.
    """
    layer = Sdf.Layer.OpenAsAnonymous(str(path))
    entry = Entry("layer", values=_fields(layer.pseudoRoot))
    # A sublayer's time offsets are no part of its path.
    entry.values["subLayerOffsets"] = np.array([(o.offset, o.scale) for o in layer.subLayerOffsets]).reshape(-1, 2)
    for prim in layer.rootPrims:
        entry.entries.append(_prim_entry(layer, prim, prim.name))
    return entry


def read_package(path: Path) -> Entry:
    """Return the layers and the other files in a USDZ package.

    Raises:
        zipfile.BadZipFile: the file is not a package.
        pxr.Tf.ErrorException: a file in it is not a layer of USD.
    """
    root = Entry("file")
    with zipfile.ZipFile(path) as package, tempfile.TemporaryDirectory() as folder:
        for number, name in enumerate(package.namelist()):
            file = Path(folder) / f"{number}{Path(name).suffix}"
            file.write_bytes(package.read(name))
            if Sdf.FileFormat.FindByExtension(str(file)) is not None:
                content = read_layer(file)
            else:
                content = read_bytes(file)
            root.entries.append(Entry("file in the package", name, content.values, content.entries))
    return root


def _prim_entry(layer: Sdf.Layer, prim: Sdf.PrimSpec, name: str) -> Entry:
    entry = Entry(prim.typeName or "prim", name, _fields(prim))
    for attribute in prim.attributes:
        entry.entries.append(_attribute_entry(layer, attribute))
    for relationship in prim.relationships:
        relationship_entry = Entry("relationship", relationship.name, _fields(relationship))
        relationship_entry.values["targets"] = _texts(relationship.targetPathList.GetAddedOrExplicitItems())
        entry.entries.append(relationship_entry)
    for child in prim.nameChildren:
        entry.entries.append(_prim_entry(layer, child, child.name))
    for variant_set in prim.variantSets.values():
        for variant in variant_set.variants.values():
            entry.entries.append(_prim_entry(layer, variant.primSpec, f"{variant_set.name}={variant.name}"))
    return entry


def _attribute_entry(layer: Sdf.Layer, attribute: Sdf.AttributeSpec) -> Entry:
    entry = Entry("attribute", attribute.name, _fields(attribute))
    connections = attribute.connectionPathList.GetAddedOrExplicitItems()
    if connections:
        entry.values["connections"] = _texts(connections)
    times = layer.ListTimeSamplesForPath(attribute.path)
    if times:
        samples = []
        for time in times:
            samples.append(_plain(layer.QueryTimeSample(attribute.path, time)))
        entry.values["times"] = np.array(times)
        shapes = {np.shape(sample) for sample in samples}
        if len(shapes) == 1 and isinstance(samples[0], np.ndarray):
            entry.values["samples"] = np.array(samples)
        else:
            entry.values["samples"] = tuple(map(str, samples))
    return entry


def _fields(spec: Any) -> dict[str, Any]:
    """Return the fields of a specification; those of a dictionary have a key each."""
    fields: dict[str, Any] = {}
    for key in spec.ListInfoKeys():
        if key not in _READ_AS_ENTRIES:
            _add(fields, key, spec.GetInfo(key))
    return fields


def _add(fields: dict[str, Any], key: str, value: Any) -> None:
    if isinstance(value, Mapping):
        for sub_key, sub_value in value.items():
            _add(fields, f"{key}:{sub_key}", sub_value)
    else:
        fields[key] = _plain(value)


def _plain(value: Any) -> Any:
    """Return a value of USD as `Entry.values` has it."""
    if isinstance(value, bool) or value is None or isinstance(value, str):
        return value
    if isinstance(value, Gf.Quatf | Gf.Quatd | Gf.Quath):
        return np.array([value.real, *value.imaginary])
    try:
        array = np.array(value, float)
    except (TypeError, ValueError):
        return str(value)  # texts, asset paths and edits of lists
    return array


def _texts(values: Any) -> tuple[str, ...]:
    return tuple(map(str, values))
