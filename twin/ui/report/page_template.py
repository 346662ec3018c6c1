"""Templates of the pages, with the styles and scripts that they include."""

from __future__ import annotations

from collections.abc import Callable
from importlib.resources import files
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jinja2 import Template


def template(name: str, **filters: Callable[..., object]) -> Template:
    """Return the page template `name` of this folder; `filters` are added to the filters of jinja2."""
    from jinja2 import DictLoader, Environment, StrictUndefined

    folder = files("twin.ui.report")
    texts = {}
    for file in (name, "report.css", "robot_view.js", "plot_hover.js"):
        texts[file] = folder.joinpath(file).read_text("utf-8")
    environment = Environment(
        loader=DictLoader(texts),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= filters
    return environment.get_template(name)
