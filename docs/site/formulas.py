"""Write the LaTeX formulas of Markdown pages as MathML, which browsers show without a script.

    .venv-site/bin/python docs/site/formulas.py FOLDER

Formulas are those that GitHub shows: between two dollar signs in a line, and fenced blocks of the language math. Code
is left as it is. Every page of the folder is rewritten.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from latex2mathml.converter import convert

_BLOCK = re.compile(r"^```math\n(.*?)\n```$", re.MULTILINE | re.DOTALL)

_CODE = re.compile(r"^(```|~~~).*?^\1[ \t]*$|`[^`\n]+`", re.MULTILINE | re.DOTALL)
"""Code: fenced blocks, and spans in a line."""

_INLINE = re.compile(r"(?<![\\\w$])\$(?=\S)([^$]*?\S)\$(?![\w$])")
"""A formula in a paragraph or in a cell of a table, as GitHub finds it: no space inside of its dollar signs."""

_MARKDOWN = {"|": "&#124;", "*": "&#42;", "_": "&#95;", "[": "&#91;", "]": "&#93;", "\\": "&#92;", "`": "&#96;"}
"""Characters that Markdown would read, although they are inside of a formula."""


def mathml(latex: str, display: str) -> str:
    """Return a formula as MathML in one line; `display`: "inline" or "block"."""
    text = convert(" ".join(latex.split()), display=display)
    parts = re.split(r"(<[^>]*>)", text)
    for k in range(0, len(parts), 2):  # text between tags
        for character, entity in _MARKDOWN.items():
            parts[k] = parts[k].replace(character, entity)
    return "".join(parts)


def with_formulas(page: str) -> str:
    """Return the text of a page with its formulas as MathML."""
    page = _BLOCK.sub(
        lambda found: f'\n<div class="formula" style="overflow-x: auto">{mathml(found[1], "block")}</div>\n', page
    )
    out: list[str] = []
    at = 0
    for code in _CODE.finditer(page):
        out += [_inline(page[at : code.start()]), code[0]]
        at = code.end()
    out.append(_inline(page[at:]))
    return "".join(out)


def _inline(text: str) -> str:
    # Markdown takes a line that begins with <math> for a block
    return _INLINE.sub(lambda found: f'<span class="formula">{mathml(found[1], "inline")}</span>', text)


def main() -> None:
    """Rewrite all pages of a folder.

    Raises:
        SystemExit: a block of formulas has another form.
    """
    for file in sorted(Path(sys.argv[1]).rglob("*.md")):
        text = file.read_text(encoding="utf-8")
        new = with_formulas(text)
        if "```math" in new:
            raise SystemExit(f"{file}: a block of formulas is not at the beginning of a line, or does not end")
        if new != text:
            file.write_text(new, encoding="utf-8")


if __name__ == "__main__":
    main()
