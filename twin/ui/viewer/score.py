"""The scoreboard of a task in the panel, and the window with the result at the end of the task."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape
from typing import Any

import viser

from twin.core.json_types import JsonMapping
from twin.core.spoken import spoken
from twin.ui.session.scene_control import LiveConsole

_TONES = {"good": "#1f8a55", "bad": "#d62f2f", "plain": "inherit"}
_BOX = "padding:0 1em .5em;font-size:.9em"


class ScorePanel:
    """Scoreboard and buttons of a task; all browsers show the same state."""

    def __init__(
        self,
        server: viser.ViserServer,
        console: LiveConsole,
        end: Callable[[str], object],
        restart: Callable[[str], object],
    ) -> None:
        """Add the controls to the panel of the page; `end` and `restart` take the name of the client."""
        self._server, self._console = server, console
        gui = server.gui
        self._html = gui.add_html("")
        self._end, self._again = gui.add_button("End the task"), gui.add_button("Restart")
        self._end_task, self._restart = end, restart
        self._end.on_click(_asking(end))
        self._again.on_click(_asking(restart))
        self._save = gui.add_button(
            "Save the report", visible=False, hint="Download a page with the measures and plots of the session"
        )
        self._save.on_click(self._send)
        self._window: Any = None  # viser names no type of a modal window
        self._result: viser.GuiHtmlHandle | None = None
        self._written, self._closed = "", False

    def show(self, task: JsonMapping) -> None:
        """Show the scoreboard, which is the value "task" of the console's state."""
        said = f"<div style='{_BOX}'><b>{escape(task['title'])}</b>{_rows(task['rows'])}{_rings(task['rings'])}"
        said += f"{_events(task['events'])}</div>"
        self._html.content = said
        if self._end.disabled != bool(task["over"]):
            self._end.disabled = bool(task["over"])
        made = task["report"]
        if self._save.visible != (ready := bool(made and made["ready"])):
            self._save.visible = ready
        self._show_result(task)

    def _show_result(self, task: JsonMapping) -> None:
        if not task["over"]:
            self._close()
            self._window = self._result = None
            return
        made = task["report"]
        if not made or made["attempt"] != task["attempt"]:
            text = "This attempt has no report."
        elif made["problem"]:
            text = f"There is no report: {made['problem']}"
        elif made["ready"]:
            text = "The report is ready: close this window, and press Save the report in the panel."
        else:
            text = "The report is being made: the session is replayed and measured …"
        said = f"<div style='{_BOX}'>{_rows(task['rows'])}<p>{escape(text)}</p></div>"
        if self._window is None:
            window = self._window = self._server.gui.add_modal(task["over"])
            self._closed = False
            with window:
                self._result = self._server.gui.add_html(said)
                self._server.gui.add_button("Restart").on_click(_asking(self._restart))
                self._server.gui.add_button("Close").on_click(lambda _: self._close())
            self._written = said
        elif self._result is not None and said != self._written:
            self._written = self._result.content = said

    def _close(self) -> None:
        if self._window is not None and not self._closed:
            self._closed = True
            self._window.close()

    def _send(self, event: viser.GuiEvent) -> None:
        made = self._console.report()
        if event.client is not None and made is not None and made[1] is not None:
            event.client.send_file_download(f"report-{made[0]}.html", made[1])


def _asking(do: Callable[[str], object]) -> Callable[[viser.GuiEvent], None]:
    """Return a callback for a button that calls `do` with the name of the client."""

    def clicked(event: viser.GuiEvent) -> None:
        if event.client is not None:
            do(f"page {event.client.client_id + 1}")

    return clicked


def _rows(rows: Sequence[Sequence[str]]) -> str:
    cells = (f"<tr><td>{escape(a)}</td><td style='text-align:right'><b>{escape(b)}</b></td></tr>" for a, b in rows)
    return f"<table style='width:100%'>{''.join(cells)}</table>"


def _rings(rings: Sequence[Sequence[str]]) -> str:
    return "".join(
        f"<div><span style='color:{escape(color)}'>◯</span> {escape(spoken(name))}: {escape(state)}</div>"
        for name, state, color in rings
    )


def _events(events: Sequence[Sequence[Any]]) -> str:
    return "".join(
        f"<div style='color:{_TONES[tone]}'>{t:.1f} s  {escape(text)}</div>" for t, tone, text in reversed(events)
    )
