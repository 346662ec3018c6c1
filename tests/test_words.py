"""Phrases that readers stumbled over stay out of messages, docstrings and pages."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[1]
PLAIN = {
    "tell the same story": "agree",
    "do not hand this folder over": "the exported files disagree; see the findings",
    "least distance": "minimum clearance",
    "least clearance": "minimum clearance",
    "least mass": "minimum mass",
    "least motion": "smallest motion",
    "mm to keep": "required ... mm",
    "clearance to keep": "required clearance",
    "mend ": "fix",
    "follows nothing": "mimic multiplier is 0; use a fixed joint",
    "is nothing without": "requires",
    "what became of": "result of",
    "robot in hand": "active robot",
    "error drawn": "error magnification",
    "do it again": "reproduce",
    "freedoms to spare": "redundant",
    "freedom to spare": "redundant",
    "behind the hand": "cannot follow",
    "gives way no further": "cannot move further",
    "hangs up": "closes",
    "own word is not taken": "is computed again",
    "say nothing, and which": "redundant equations",
    "upside down": "inverted",
    "whoever opens": "a person who opens",
    "accused": "a false alarm on",
    "accuses": "gives a false alarm on",
    "seed value": "published value",
}
"""What is not written, and what is."""


def test_phrases_that_need_a_second_reading_are_not_used():
    pages = [*(ROOT / "twin").rglob("*.py"), *(ROOT / "twin").rglob("*.j2"), *(ROOT / "docs").glob("*.md")]
    pages += [*(ROOT / "twin/ui/headset/web/src").glob("*.ts"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
    found = [
        f"{page.relative_to(ROOT)}:{k}: '{phrase}' -> '{plain}'"
        for page in pages
        for k, line in enumerate(page.read_text(encoding="utf-8").lower().splitlines(), 1)
        for phrase, plain in PLAIN.items()
        if phrase in line
    ]
    assert not found, "\n".join(found)
