"""Make the links and pictures of the README absolute in the metadata of a package, so that PyPI shows them.

hatchling calls this hook, which pyproject.toml names. The address is `Repository` in project.urls.
"""

from __future__ import annotations

import re
from pathlib import Path

from hatchling.metadata.plugin.interface import MetadataHookInterface  # pyright: ignore[reportMissingImports]

PICTURE = re.compile(r'(!\[[^\]]*\]\(|<img src=")(?!https?:)([^)"]+)')
LINK = re.compile(r"(\]\()(?!https?:|#)([^)]+)")


def absolute(text: str, repository: str, version: str) -> str:
    """Return a page whose relative pictures and links lead to a version of the files in a repository on GitHub."""
    files = repository.replace("https://github.com/", "https://raw.githubusercontent.com/")
    text = PICTURE.sub(rf"\g<1>{files}/v{version}/\g<2>", text)
    return LINK.sub(rf"\g<1>{repository}/blob/v{version}/\g<2>", text)


class ReadmeLinks(MetadataHookInterface):
    """Sets the README of the package."""

    def update(self, metadata: dict) -> None:
        """Add the README with absolute links."""
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        page = absolute(text, metadata["urls"]["Repository"], metadata["version"])
        metadata["readme"] = {"content-type": "text/markdown", "text": page}
