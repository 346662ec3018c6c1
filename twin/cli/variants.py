"""What `--variant` asks for: one bare name for every equation that has it, or EQ=NAME pairs."""

from __future__ import annotations

from collections.abc import Sequence

from twin.core.errors import TwinError


def asked(texts: Sequence[str]) -> str | dict[str, str] | None:
    """Return a bare name, or variants by equation; None if nothing is asked.

    Raises:
        TwinError: bare names beside pairs, several bare names, or an equation given twice.
    """
    bare = [t for t in texts if "=" not in t]
    if bare and len(texts) > 1:
        raise TwinError("--variant: give either one bare name or EQ=NAME pairs, not both")
    if bare:
        return bare[0]
    pairs = dict(t.split("=", 1) for t in texts)
    if len(pairs) < len(texts):
        raise TwinError("--variant: an equation is given twice; give each once")
    return pairs or None
