"""Read `--variant`: one name for all equations with this variant, or EQ=NAME pairs."""

from __future__ import annotations

from collections.abc import Sequence

from twin.core.errors import TwinError


def asked(texts: Sequence[str]) -> str | dict[str, str] | None:
    """Return a variant name, or a dictionary of variants by equation; None without the option.

    Raises:
        TwinError: names are mixed with EQ=NAME pairs, several names are given, or an equation is given twice.
    """
    bare = [t for t in texts if "=" not in t]
    if bare and len(texts) > 1:
        raise TwinError("--variant: give either one variant name or EQ=NAME pairs, not both")
    if bare:
        return bare[0]
    pairs = dict(t.split("=", 1) for t in texts)
    if len(pairs) < len(texts):
        raise TwinError("--variant: an equation is given twice; give each equation once")
    return pairs or None
