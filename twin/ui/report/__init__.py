"""Write reports as HTML pages, JSON and plots; matplotlib and jinja2 are imported only when needed."""

from twin.ui.report.html import render_html
from twin.ui.report.report_folder import FORMATS, write_report

__all__ = ["FORMATS", "render_html", "write_report"]
