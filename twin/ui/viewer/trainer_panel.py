"""The panel of machines and their models: run levels, deviation, and buttons of the trainer."""

from __future__ import annotations

from collections.abc import Callable
from html import escape

import viser

from twin.core.json_types import JsonObject
from twin.core.units import MM
from twin.simulation.controllers.trainer import Mode
from twin.ui.session.pens import Pens
from twin.ui.session.scene_control import LiveConsole
from twin.ui.viewer.deviation import DeviationCurve, largest

_MODES = (
    (Mode.TELEOPERATE, "Engage", "Let the hand move the machine and its model"),
    (Mode.REHEARSE, "Rehearse", "Disengage the machine: the hand moves only the model, and the motion is recorded"),
    (Mode.JUDGE, "Judge", "End the rehearsal, and check speed and reach of the recorded motion"),
    (Mode.REPLAY, "Run", "Engage the machine: it repeats the recorded motion; speed and deviation are checked"),
)
"""(Mode, label, hint) of each button of the trainer; the page of `twin serve` has the same buttons."""

_BAD = "#d62f2f"


class TrainerPanel:
    """Run levels, deviation and buttons; the buttons send the console the same requests as the page of `twin serve`."""

    def __init__(
        self,
        gui: viser.GuiApi,
        console: LiveConsole,
        pens: Pens,
        on_click: Callable[[viser.GuiButtonHandle, str, Callable[[str], object]], None],
    ) -> None:
        """Add the controls; `on_click` connects a button to a request. A request is called with the client's name."""
        self._console, self._pens = console, pens
        table = console.scene.trainer
        assert table is not None
        self._names = table.robots
        with gui.add_folder("Machine and model"):
            self._html = gui.add_html("")
            self._curve = DeviationCurve(gui, self._names, table.cue.tol_mm * MM)
            for mode, label, hint in _MODES:
                on_click(gui.add_button(label, hint=hint), label, lambda client, mode=mode: self._train(client, mode))
            for button, hint in (("start", "the machines move to home"), ("stop", "the machines stop")):
                made = gui.add_button(
                    f"{button.capitalize()} the machines", hint=f"Press the {button} button of each machine: {hint}"
                )
                on_click(made, button, lambda client, button=button: console.press(client, button))

    def show(self, now: float) -> None:
        """Show run levels and deviation at the time `now` in s.

        During a replay, this call keeps the hands active, because silent hands would stop the replay.
        """
        found: JsonObject = self._console.reading["machines"]
        robots = found["robots"]
        if self._pens.client is not None and any(r["phase"] == "replay" for r in robots.values()):
            self._pens.use(self._pens.client)
        if not self._curve.due(now):
            return
        apart = self._console.deviations()
        self._curve.add(now, [apart[n]["tip"] for n in self._names])
        lines = [
            ("", f"Requested mode: {found['mode']}. Drawn solid: {'machine' if found['view'] == 'real' else 'model'}.")
        ]
        for n in self._names:
            r = robots[n]
            lines.append(("", f"{n}: {r['level'] or 'does not answer'}, {r['phase']}"))
            active = self._console.members[n].mechanism.active
            lines.append(
                ("", f"Deviation of the tips: {apart[n]['tip'] / MM:.2f} mm. {largest(apart[n]['joints'], active)}")
            )
            lines += [(f";color:{_BAD}", text) for text in (r["problem"], r["why"]) if text]
        said = "".join(f"<div style='padding:0 1em .4em{tone}'>{escape(text)}</div>" for tone, text in lines)
        self._html.content = said

    def _train(self, client: str, mode: Mode) -> None:
        if mode == Mode.REPLAY:
            self._pens.use(client)
        self._console.train(client, mode)
