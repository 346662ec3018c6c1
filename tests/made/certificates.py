"""Certificates of proofs: their hash, and what `twin audit` says of them."""

from __future__ import annotations

import hashlib
import json

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
