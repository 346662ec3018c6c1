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


@cache
def formats() -> tuple[Format, ...]:
    """Return all formats, by name.

    Raises:
        TwinError: a format of another package cannot be imported, or has the name of another format.
    """
    found: dict[str, Format] = {}
    for folder in iter_modules(__path__):
        format = import_module(f"{__name__}.{folder.name}.format").FORMAT
        found[format.name] = replace(format, package=f"{__name__}.{folder.name}")
    for name, format in entry_points(GROUP).items():
        if not isinstance(format, Format):
            raise TwinError(f"the entry point '{name}' of {GROUP} is {format!r}, not a twin.exchange.format.Format")
        if format.name in found:
            raise TwinError(f"two formats have the name '{format.name}'; the second is the entry point '{name}'")
        if not format.package:
            raise TwinError(f"format '{format.name}' of another package needs package=__package__ in Format(...)")
        found[format.name] = format
    return tuple(found[name] for name in sorted(found))


def exported() -> tuple[Format, ...]:
    """Return the formats that `twin export` writes, in the order of an export."""
    return _sorted(lambda places: places.export)


def used() -> tuple[Format, ...]:
    """Return the formats whose use README.txt describes, in the order of the descriptions."""
    return _sorted(lambda places: places.use)


def audited() -> tuple[Format, ...]:
    """Return the formats that `twin audit` reads, in the order of reading."""
    return _sorted(lambda places: places.audit)


def imported() -> tuple[Format, ...]:
    """Return the formats that `twin new` reads."""
    return _sorted(lambda places: places.new)


def _sorted(place: Callable[[Places], int | None]) -> tuple[Format, ...]:
    having = []
    for format in formats():
        position = place(format.places)
        if position is not None:
            having.append((position, format.name, format))
    having.sort(key=lambda row: row[:2])
    return tuple(format for _, _, format in having)


@cache
def _kinds() -> dict[str, tuple[Format, FormatVariant]]:
    kinds = {}
    for format in audited():
        for variant in format.variants:
            kinds[variant.name] = (format, variant)
    return kinds


def family(kind: str) -> str:
    """Return the format of a kind of file, such as "usd" of "usda": its files are written from the same data."""
    return _kinds()[kind][0].name if kind in _kinds() else kind


def holding(kind: str, what: Holds) -> bool:
    """Return whether the files of a kind contain something; False for an unknown kind."""
    return kind in _kinds() and what in _kinds()[kind][0].holds


def motion_groups() -> Iterator[tuple[str, ...]]:
    """Yield groups of kinds of file with one motion in each file; the files of a group contain all motions."""
    for format in audited():
        if Holds.ONE_MOTION in format.holds:
            by_rank: dict[int, list[str]] = {}
            for variant in format.variants:
                by_rank.setdefault(variant.rank, []).append(variant.name)
            yield from (tuple(kinds) for kinds in by_rank.values())


def rank(kind: str) -> int:
    """Return the rank of a kind of file as a reference, see `FormatVariant`; an unknown kind is last."""
    return _kinds()[kind][1].rank if kind in _kinds() else 99


def family_rank(kind: str) -> int:
    """Return the smallest rank of the kinds of file in the format of a kind; an unknown kind comes last."""
    if kind not in _kinds():
        return 99
    format, _ = _kinds()[kind]
    return min(variant.rank for variant in format.variants)


def leading(kind: str) -> bool:
    """Return whether a kind of file has the smallest rank in its format: the other kinds repeat its data."""
    return rank(kind) == family_rank(kind)


def trust(kind: str) -> int:
    """Return the number of a kind of file that decides whom to trust, see `FormatVariant`; an unknown kind is last."""
    return _kinds()[kind][1].trust if kind in _kinds() else 999


def named(name: str) -> Format:
    """Return the format with a name.

    Raises:
        TwinError: there is no such format.
    """
    for format in formats():
        if format.name == name:
            return format
    raise TwinError(f"there is no format '{name}'; the formats are {', '.join(f.name for f in formats())}")
