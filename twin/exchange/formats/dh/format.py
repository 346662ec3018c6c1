"""Tables of Denavit-Hartenberg parameters in lists of formats."""

from __future__ import annotations

from twin.exchange.format import Format, Places

FORMAT = Format(
    name="dh",
    title="DH table",
    places=Places(new=60),
    sources=(".csv", ".toml", ".md", ".tex"),
    takes=("table",),
)
