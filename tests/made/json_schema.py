"""As much of JSON Schema as pydantic writes for the models of twin."""

from __future__ import annotations

import re


def misfits(value, node: dict, schema: dict, where: str):
    """Yield where a value does not fit `node` of a schema; `where` is the path of the value."""
    if "$ref" in node:
        node = schema["$defs"][node["$ref"].rsplit("/", 1)[1]]
    branches = node.get("anyOf") or node.get("oneOf")
    if branches:
        if not any(not list(misfits(value, b, schema, where)) for b in branches):
            yield f"{where}: fits no branch"
        return
    kinds = {"object": dict, "array": list, "string": str, "boolean": bool, "null": type(None)}
    kind = node.get("type")
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if (kind in ("number", "integer") and not number) or (kind in kinds and not isinstance(value, kinds[kind])):
        yield f"{where}: {value!r} is no {kind}"
        return
    if ("enum" in node and value not in node["enum"]) or ("const" in node and value != node["const"]):
        yield f"{where}: {value!r}"
    if "pattern" in node and not re.search(node["pattern"], value):
        yield f"{where}: {value!r}"
    if kind == "object":
        yield from (f"{where}: {k} is missing" for k in node.get("required", ()) if k not in value)
        for key, child in value.items():
            if "properties" in node and key in node["properties"]:
                yield from misfits(child, node["properties"][key], schema, f"{where}.{key}")
                continue
            patterns = [v for p, v in node.get("patternProperties", {}).items() if re.search(p, key)]
            other = patterns[0] if patterns else node.get("additionalProperties", True)
            if other is False:
                yield f"{where}.{key}: unknown"
            elif isinstance(other, dict):
                yield from misfits(child, other, schema, f"{where}.{key}")
    if kind == "array":
        prefix = node.get("prefixItems", [])
        for i, child in enumerate(value):
            item = prefix[i] if i < len(prefix) else node.get("items", {})
            yield from misfits(child, item, schema, f"{where}.{i}")
