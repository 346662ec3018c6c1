"""The report room: a judgement as one HTML page, as JSON and as plots.

matplotlib and jinja2 are imported when something is drawn or rendered, not before.
"""

from twin.ui.report.files import FORMATS, write_report
from twin.ui.report.html import render_html

__all__ = ["FORMATS", "render_html", "write_report"]
