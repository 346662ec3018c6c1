"""Certificates of proofs: their hash, the scripts of docs/ that check them, and what `twin audit` says of them."""

from __future__ import annotations

import hashlib
import json
import random
import sys
from pathlib import Path

from twin.cli import main


def digest(data):
    content = {key: value for key, value in data.items() if key != "sha256"}
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()


def audited(path, data, capsys, *more):
    """Return (exit code, output) of `twin audit`."""
    capsys.readouterr()
    path.write_text(data if isinstance(data, str) else json.dumps(data))
    code = main(["audit", str(path), "--quiet", "--json", *more])
    return code, json.loads(capsys.readouterr().out)


def require_short(checker):
    """Check that a script has at most 300 lines and needs the standard library alone."""
    lines = Path(checker.__file__).read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 300
    modules = {line.split()[1] for line in lines if line.startswith(("import ", "from "))}
    assert modules <= set(sys.stdlib_module_names) | {"__future__"}


def require_refusal(checker, certificate, path, capsys, seed):
    """Check that a script refuses a certificate that is cut (odd seeds), or one character of which is changed."""
    text = json.dumps(certificate)
    generator = random.Random(seed)
    place = generator.randrange(len(text))
    if seed % 2:
        text = text[:place]
    else:
        text = text[:place] + chr(33 + (ord(text[place]) + 7) % 90) + text[place + 1 :]
    path.write_text(text)
    assert checker.main([str(path)]) == 2
    assert "cannot be checked" in capsys.readouterr().err
