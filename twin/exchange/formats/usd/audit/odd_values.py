"""Find the values that differ from most others: where most of a file is alike, they are probably mistakes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterator, Mapping
from typing import TypeVar

Form = TypeVar("Form", bound=Hashable)

_COMMON_SHARE = 0.7
"""Share of the prims that must have one form for the others to be odd."""

_FEWEST_FORMS = 3
"""Prims from which the common form counts: two that differ say nothing about which of them is meant."""


def differing_from_most(forms: Mapping[str, Form]) -> Iterator[tuple[str, Form, Form, int]]:
    """Yield (key, its form, the common form, its count) of the values that differ from most others."""
    if len(forms) < _FEWEST_FORMS:
        return
    common, count = Counter(forms.values()).most_common(1)[0]
    if count < _COMMON_SHARE * len(forms):
        return
    for key, form in forms.items():
        if form != common:
            yield key, form, common, count
