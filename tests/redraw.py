"""Redraw the committed STEP files from their dimensions and compare: `make cad-check`.

Equal bytes are expected. Another processor may round the last digit of a coordinate; then the text must be
equal but for numbers, and these within a nanometre.
"""

from __future__ import annotations

import re
import sys
import tempfile
from pathlib import Path

from made.drawing import draw

ROOT = Path(__file__).parents[1]
NUMBER = re.compile(r"-?\d+\.\d*(?:E[-+]?\d+)?")


def same(a: bytes, b: bytes) -> bool:
    """Return whether two STEP files hold the same drawing."""
    if a == b:
        return True
    texts = [x.decode("latin-1") for x in (a, b)]
    if NUMBER.sub("#", texts[0]) != NUMBER.sub("#", texts[1]):
        return False
    first, second = ([float(n) for n in NUMBER.findall(t)] for t in texts)
    return all(abs(x - y) <= 1e-6 for x, y in zip(first, second, strict=True))


def main() -> int:
    """Redraw every robot that has a model.py; return 1 if one differs."""
    failed = 0
    for model in sorted([*ROOT.glob("cad/*/model.py"), *ROOT.glob("docs/examples/*/cad/model.py")]):
        name = model.parent.name if model.parent.name != "cad" else model.parents[1].name
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / f"{name}.step"
            draw(model, "--out", out)
            current = same(out.read_bytes(), (model.parent / f"{name}.step").read_bytes())
        print(f"{name}.step {'is what model.py draws' if current else f'DIFFERS: python {model.relative_to(ROOT)}'}")
        failed |= not current
    return failed


if __name__ == "__main__":
    sys.exit(main())
