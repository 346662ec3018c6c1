"""Convert errors of tomllib and pydantic to one line for each mistake, with a correction."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sized
from difflib import get_close_matches
from functools import cache

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from twin.core.json_types import JsonObject
from twin.schema.lines import Key, Keys, nearest_line, spell

UNITS = (
    *("mm", "um", "cm", "m", "in", "deg", "rad", "s", "ms", "min", "kg", "g", "n", "nm", "hz", "percent"),
    *("mm_s", "mm_s2", "m_s", "m_s2", "deg_s", "deg_s2", "rad_s", "rad_s2", "kg_m2", "kg_m3", "g_cm3"),
)
"""Suffixes of key names that are units."""

_SIMILAR = 0.7
"""Smallest similarity, of 1, of an unknown key and the known key that may be meant."""

_SHOWN = 60
"""Maximum length in characters of a value in a message; longer values are cut."""


def explain_syntax(text: str, name: str, error: Exception) -> str:
    """Return the message for invalid TOML: file, line, reason, and the text of the line."""
    message = str(error)
    match = re.search(r"\(at line (\d+), column (\d+)\)", message)
    if match is not None:
        line = int(match[1])
    else:  # tomllib names no line for a mistake at the end of the text
        line = text.count("\n") + 1
    reason = re.sub(r" \(at .*\)$", "", message)
    explanation = f"{name}:{line}: not valid TOML: {reason}"
    rows = text.splitlines()
    row = ""
    if 0 < line <= len(rows):
        row = rows[line - 1].strip()[:_SHOWN]
    if row:
        explanation += f", in: {row}"
    return explanation


def first_mistake(error: ValidationError) -> tuple[str, str]:
    """Return (location, message) of the first mistake; the location is keys joined by dots, "" for the whole input."""
    first = error.errors(include_url=False, include_input=False, include_context=False)[0]
    location = ".".join(str(key) for key in first["loc"])
    return location, first["msg"]


def explain(error: ValidationError, data: JsonObject, lines: dict[Keys, int], model: type[BaseModel], name: str) -> str:
    """Return the message of a validation error: one line for each mistake, in the order of the file."""
    schema = _schema(model)
    mistakes: dict[Keys, tuple[int, str]] = {}  # line and text
    kinds: dict[Keys, str] = {}
    replaced: set[Keys] = set()  # missing keys that a misspelt key explains
    for item in error.errors(include_url=False):
        keys, value = _raw_keys(item, data)
        if keys in mistakes:
            continue  # the same keys in another branch of a union; the message of the first branch covers all branches
        if item["type"] == "extra_forbidden":
            text, meant_key = _unknown_key(keys, _nodes(schema, data, keys[:-1]))
            if meant_key:
                replaced.add((*keys[:-1], meant_key))
        else:
            text = _problem(item, keys, value, _nodes(schema, data, keys))
        kinds[keys] = item["type"]
        mistakes[keys] = (nearest_line(lines, keys), f"{spell(keys)}{_shown(item, value)}: {text}")
    for keys in mistakes:  # the deepest matching branch of a union explains the error best
        for depth in range(len(keys)):
            if kinds.get(keys[:depth]) in _KINDS:
                replaced.add(keys[:depth])
    remaining = []
    for keys, mistake in mistakes.items():
        if keys not in replaced:
            remaining.append(mistake)
    remaining.sort(key=lambda mistake: mistake[0])  # by line; several mistakes of a line keep their order
    messages = [f"{name}:{line}: {text}" for line, text in remaining]
    return "\n".join(messages)


@cache
def _schema(model: type[BaseModel]) -> JsonObject:
    """Return the JSON Schema of a model, cached because building it takes longer than reading a file."""
    return model.model_json_schema()


def _raw_keys(item: ErrorDetails, data: object) -> tuple[Keys, object]:
    """Return (keys of the faulty value in the file, the value); union branches, which pydantic adds, are omitted."""
    location = [*item["loc"], *item.get("ctx", {}).get("keys", ())]
    keys: list[Key] = []
    value = data
    for i, key in enumerate(location):
        if _inside(value, key):
            value = _step(value, key)
        elif i == len(location) - 1 and item["type"] in ("missing", "at_key"):
            value = None
        else:
            continue
        keys.append(key)
    return tuple(keys), value


def _inside(value: object, key: Key) -> bool:
    """Return whether a table has a key, or a list an index."""
    if isinstance(value, list):
        return isinstance(key, int) and key < len(value)
    return isinstance(value, dict) and key in value


def _step(value: object, key: Key) -> object:
    """Return the value at a key of a table or an index of a list; None if there is none."""
    if isinstance(value, list) and isinstance(key, int) and key < len(value):
        return value[key]
    if isinstance(value, dict):
        return value.get(key)
    return None


def _shown(item: ErrorDetails, value: object) -> str:
    """Return " = " and a value as the file states it; "" where the message needs none."""
    if item["type"] in ("missing", "extra_forbidden") or isinstance(value, dict) or value is None:
        return ""
    text = json.dumps(value, ensure_ascii=False)
    if len(text) > _SHOWN:
        text = text[: _SHOWN - 3] + "..."
    return f" = {text}"


def _unknown_key(keys: Keys, nodes: list[JsonObject]) -> tuple[str, str | None]:
    """Return (message for an unknown key, most similar known key or None)."""
    key = str(keys[-1])
    names: set[str] = set()
    for node in nodes:
        names.update(node.get("properties", {}))
    known = sorted(names)
    with_unit: list[str] = []  # known keys that are this key with a unit added
    other_units: list[str] = []
    with_other_unit: list[str] = []  # known keys that are this key with another unit
    for name in known:
        unit = _unit_of(name)
        if unit is None:
            continue
        stem = name.removesuffix(f"_{unit}")
        if key == stem:
            with_unit.append(name)
        elif key.startswith(f"{stem}_") and key.removeprefix(f"{stem}_") in UNITS:
            other_units.append(unit.replace("_", "/"))
            with_other_unit.append(name)
    if with_unit:
        choices = " or ".join(with_unit)
        return f"the unit is missing: write {choices}", with_unit[0]
    if with_other_unit:
        units = " or ".join(other_units)
        choices = " or ".join(with_other_unit)
        return f"the unit is {units} here: write {choices}", with_other_unit[0]
    hint = ""
    similar = None
    close = get_close_matches(key, known, n=1, cutoff=_SIMILAR)
    if close:
        similar = close[0]
        hint = f"; did you mean {similar}?"
    choices = ", ".join(known) or "none"
    return f"unknown key{hint}; known keys: {choices}", similar


def _unit_of(name: str) -> str | None:
    """Return the longest unit that is the suffix of a key's name ("mm_s", not "s"); None if there is none."""
    for unit in sorted(UNITS, key=len, reverse=True):  # mm_s before s
        if name.endswith(f"_{unit}"):
            return unit
    return None


_SIGNS = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}
"""{key of JSON Schema: sign of the bound}."""

_KINDS = {"float_type": "a number", "int_type": "a whole number", "string_type": "text in quotes"}
_KINDS |= {"bool_type": "true or false", "tuple_type": "a list", "list_type": "a list", "dict_type": "a table"}
_KINDS |= {"model_type": "a table", "model_attributes_type": "a table", "int_from_float": "a whole number"}
"""{type of an error of pydantic: what is expected}."""

_PATTERNS = {
    "^[a-z][a-z0-9_]*$": "must begin with a lower-case letter and contain only lower-case letters, digits and _",
    "^[a-z][a-z0-9_]*_(deg|mm)$": "the key must be the name of a joint and its unit: NAME_deg or NAME_mm",
    "^#[0-9a-f]{6}$": "must be # and six digits or letters from a to f, as #1a80c0",
    r"^([a-z][a-z0-9_]*|.+\.toml)$": "must be the name of a protocol, or a file whose name ends with .toml",
    r"^[^/\\]+\.csv$": "must be the name of a file that ends with .csv, without a folder",
}
"""{pattern of a text in a file that people write: what is expected}."""


def _problem(item: ErrorDetails, keys: Keys, value: object, nodes: list[JsonObject]) -> str:
    """Return the message about a value that does not match the JSON Schema nodes of its place."""
    kind = item["type"]
    context = item.get("ctx", {})
    allowed = _allowed(nodes)
    also = ""
    if allowed:
        also = f"; allowed: {allowed}"
    if kind == "missing":
        if isinstance(keys[-1], int):
            return f"the list is too short: value {keys[-1] + 1} is missing{also}"
        if not allowed:
            return "this key is missing"
        one_of = "one of " if "," in allowed else ""
        return f"this key is missing; its value must be {one_of}{allowed}"
    if kind == "union_tag_not_found":
        tag = context["discriminator"].strip("'")
        known = []
        for node in nodes:
            known += _choices(node.get("properties", {}).get(tag, {}))
        return f"the key {tag} is missing; its value must be one of {', '.join(known)}"
    if kind == "union_tag_invalid":
        tag = context["discriminator"].strip("'")
        stated = context["tag"]
        known = re.findall(r"'([^']*)'", context["expected_tags"])
        return f"unknown {tag} '{stated}'{_close(stated, known)}; allowed: {', '.join(known)}"
    if kind in ("literal_error", "enum"):
        known = []
        for node in nodes:
            known += _choices(node)
        choices = ", ".join(known) or context.get("expected", "")
        return f"not known{_close(value, known)}; allowed: {choices}"
    if kind.startswith(("greater_than", "less_than")):
        return f"out of range{also}"
    if kind in ("finite_number", "json_invalid"):
        return f"must be a finite number{also}"
    if kind in _KINDS:
        expected = _KINDS[kind]
        if allowed == expected:
            also = ""
        return f"{expected} is expected, not {_kind_of(value)}{also}{_as_number(value, kind)}"
    if kind in ("too_long", "too_short") and isinstance(value, Sized):
        return f"the list has {len(value)} values{also}"
    if kind == "string_pattern_mismatch":
        pattern = context["pattern"]
        return _PATTERNS.get(pattern, f"must match the regular expression {pattern}")
    if kind in ("at_key", "swapped"):
        return context["text"]
    return item["msg"].removeprefix("Value error, ") + also


def _close(value: object, known: list[str]) -> str:
    """Return a question for the known text that is most like a value; "" if none is like it."""
    close = get_close_matches(str(value).lower(), known, n=1)
    if not close:
        return ""
    return f"; did you mean '{close[0]}'?"


def _kind_of(value: object) -> str:
    """Return what a value of a file is, as in `_KINDS`."""
    names = {bool: "true or false", str: "text", list: "a list", dict: "a table"}
    return names.get(type(value), "a number")


def _as_number(value: object, kind: str) -> str:
    """Return how to write a text as a number; "" if no number is expected."""
    if isinstance(value, str) and kind in ("float_type", "int_type"):
        try:
            return f"; write {float(value):g} without quotes"
        except ValueError:
            return "; write a number without quotes"
    return ""


def _nodes(schema: JsonObject, data: object, keys: Keys) -> list[JsonObject]:
    """Return the JSON Schema nodes of the value at `keys`; union branches are chosen by their tag."""

    def expand(node: JsonObject, value: object) -> Iterator[JsonObject]:
        if "$ref" in node:
            _, definition = node["$ref"].rsplit("/", 1)
            yield from expand(schema["$defs"][definition], value)
            return
        branches = node.get("anyOf") or node.get("oneOf")
        if not branches:
            yield node
            return
        tag = node.get("discriminator")
        if tag and isinstance(value, dict) and str(value.get(tag["propertyName"])) in tag["mapping"]:
            branches = [{"$ref": tag["mapping"][value[tag["propertyName"]]]}]
        for branch in branches:
            yield from expand(branch, value)

    nodes = list(expand(schema, data))
    value = data
    for key in keys:
        value = _step(value, key)
        children: list[JsonObject] = []
        for node in nodes:
            child = _child(node, key)
            if isinstance(child, dict):
                children += expand(child, value)
        nodes = children
    return nodes


def _child(node: JsonObject, key: Key) -> object:
    """Return the JSON Schema of the value at a key or an index; no dict: any value is allowed, or none."""
    if isinstance(key, int):
        prefix = node.get("prefixItems", [])
        if key < len(prefix):
            return prefix[key]
        return node.get("items")
    properties = node.get("properties", {})
    if key in properties:
        return properties[key]
    for pattern, child in node.get("patternProperties", {}).items():
        if re.search(pattern, key):
            return child
    return node.get("additionalProperties")


def _allowed(nodes: list[JsonObject]) -> str:
    """Return the values that JSON Schema nodes allow, as text; "" if they restrict nothing."""
    texts: list[str] = []
    for node in nodes:
        text = _allowed_one(node)
        if text and text not in texts:
            texts.append(text)
    return " or ".join(texts)


def _choices(node: JsonObject) -> list[str]:
    """Return the values that a JSON Schema node lists; [] if it lists none."""
    values = node.get("enum", [node.get("const")])
    return [str(value) for value in values if value is not None]


def _allowed_one(node: JsonObject) -> str:
    """Return the values that one JSON Schema node allows, as text."""
    choices = _choices(node)
    if choices:
        return ", ".join(choices)
    kind = node.get("type")
    if kind in ("number", "integer"):
        text = "a number" if kind == "number" else "a whole number"
        bounds = []
        for key, sign in _SIGNS.items():
            if key in node:
                bounds.append(f"{sign} {node[key]:g}")
        if bounds:
            text += " " + " and ".join(bounds)
        return text
    if kind == "array":
        shortest = node.get("minItems")
        if shortest is not None and shortest == node.get("maxItems"):
            return f"a list of {shortest} values"
        return "a list"
    return {"string": "text", "boolean": "true or false", "object": "a table"}.get(str(kind), "")
