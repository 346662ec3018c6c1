"""The formats, each in a folder of its own here, or in another package that names it by an entry point.

A folder has a module `format` with `FORMAT = Format(...)`, and the modules that `twin.exchange.format.Format` names.
Another package names the object in its metadata, in the group `twin.formats`: `toy = "toy_format.format:FORMAT"`.

Only the modules `format` are imported here. Every list of formats is made from these functions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from importlib import import_module
from pkgutil import iter_modules

from twin.core.entry_points import entry_points
from twin.core.errors import TwinError
from twin.exchange.format import Format, FormatVariant, Holds, Places

GROUP = "twin.formats"
"""Group of the entry points that name formats of other packages."""

_LAST_RANK = 99
_LAST_TRUST = 999
"""Rank and trust of an unknown kind of file: after those of all formats."""


@cache
def formats() -> tuple[Format, ...]:
    """Return all formats, by name.

    Raises:
        TwinError: a format of another package cannot be imported, or has the name of another format.
    """
    by_name: dict[str, Format] = {}
    for folder in iter_modules(__path__):
        format = import_module(f"{__name__}.{folder.name}.format").FORMAT
        by_name[format.name] = replace(format, package=f"{__name__}.{folder.name}")
    for name, format in entry_points(GROUP).items():
        if not isinstance(format, Format):
            raise TwinError(f"the entry point '{name}' of {GROUP} is {format!r}, not a twin.exchange.format.Format")
        if format.name in by_name:
            raise TwinError(f"two formats have the name '{format.name}'; the second is the entry point '{name}'")
        if not format.package:
            raise TwinError(f"format '{format.name}' of another package needs package=__package__ in Format(...)")
        by_name[format.name] = format
    return tuple(by_name[name] for name in sorted(by_name))


def export_formats() -> tuple[Format, ...]:
    """Return the formats that `twin export` writes, in the order of an export."""
    return _sorted(lambda places: places.export)


def formats_with_use() -> tuple[Format, ...]:
    """Return the formats whose use README.txt describes, in the order of the descriptions."""
    return _sorted(lambda places: places.use)


def audit_formats() -> tuple[Format, ...]:
    """Return the formats that `twin audit` reads, in the order of reading."""
    return _sorted(lambda places: places.audit)


def import_formats() -> tuple[Format, ...]:
    """Return the formats that `twin new` reads."""
    return _sorted(lambda places: places.new)


def _sorted(place: Callable[[Places], int | None]) -> tuple[Format, ...]:
    """Return the formats that have a position in a list, in the order of positions, then of names."""
    rows = []
    for format in formats():
        position = place(format.places)
        if position is not None:
            rows.append((position, format.name, format))
    rows.sort(key=lambda row: row[:2])  # formats themselves have no order
    return tuple(format for _, _, format in rows)


@cache
def _variants_by_kind() -> dict[str, tuple[Format, FormatVariant]]:
    """Return {kind of file: (its format, its variant)} of all files that an audit reads."""
    variants = {}
    for format in audit_formats():
        for variant in format.variants:
            variants[variant.name] = (format, variant)
    return variants


def family(kind: str) -> str:
    """Return the format of a kind of file, such as "usd" of "usda": its files are written from the same data."""
    return _variants_by_kind()[kind][0].name if kind in _variants_by_kind() else kind


def kind_holds(kind: str, what: Holds) -> bool:
    """Return whether the files of a kind contain something; False for an unknown kind."""
    return kind in _variants_by_kind() and what in _variants_by_kind()[kind][0].holds


def motion_groups() -> Iterator[tuple[str, ...]]:
    """Yield groups of kinds of file with one motion in each file; the files of a group contain all motions."""
    for format in audit_formats():
        if Holds.ONE_MOTION in format.holds:
            # Files of another rank repeat the motions, as CSV tracks those of the JSON tracks.
            by_rank: dict[int, list[str]] = {}
            for variant in format.variants:
                by_rank.setdefault(variant.rank, []).append(variant.name)
            yield from map(tuple, by_rank.values())


def rank(kind: str) -> int:
    """Return the rank of a kind of file as a reference, see `FormatVariant`; an unknown kind is last."""
    return _variants_by_kind()[kind][1].rank if kind in _variants_by_kind() else _LAST_RANK


def family_rank(kind: str) -> int:
    """Return the smallest rank of the kinds of file in the format of a kind; an unknown kind comes last."""
    if kind not in _variants_by_kind():
        return _LAST_RANK
    format, _ = _variants_by_kind()[kind]
    return min(variant.rank for variant in format.variants)


def is_leading_kind(kind: str) -> bool:
    """Return whether a kind of file has the smallest rank in its format: the other kinds repeat its data."""
    return rank(kind) == family_rank(kind)


def trust(kind: str) -> int:
    """Return the number of a kind of file that decides whom to trust, see `FormatVariant`; an unknown kind is last."""
    return _variants_by_kind()[kind][1].trust if kind in _variants_by_kind() else _LAST_TRUST


def format_named(name: str) -> Format:
    """Return the format with a name.

    Raises:
        TwinError: there is no such format.
    """
    for format in formats():
        if format.name == name:
            return format
    names = [format.name for format in formats()]
    raise TwinError(f"there is no format '{name}'; the formats are {', '.join(names)}")
