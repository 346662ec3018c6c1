"""Controls that save results: a recorded session, a posture in the robot's TOML file, a last phase of a protocol."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import viser

from twin.core.atomic import Scratch
from twin.core.errors import TwinError
from twin.ui.session.recorded_session import MAX_MOMENTS, RecordedSession
from twin.ui.session.robot_file_edits import append_phase, identifier, save_posture
from twin.ui.viewer.front import Front, ShownRobot


class RecordPanel:
    """Controls below the joint sliders: record, replay, save and load a session; save a posture or a phase."""

    def __init__(self, front: Front, robot: ShownRobot, tab: viser.GuiTabHandle, handles: list) -> None:
        self.front = front
        self.robot = robot
        self.session: RecordedSession | None = None
        self._start_time = 0.0
        self._replay_time: float | None = None
        gui = front.server.gui
        with tab:
            folder = gui.add_folder("Session")
            with folder:
                self._record = gui.add_button("● Record")
                self._replay = gui.add_button("↻ Replay", disabled=True)
                if front.local:
                    save = gui.add_button("Save the session")
                    save.on_click(lambda _: front.ask("save", self._save))
                load = gui.add_upload_button("Load a session", mime_type="application/json")
            handles.append(folder)
            if front.local and robot.movable.robot.files is not None:
                file_folder = gui.add_folder("Write into the robot's files", expand_by_default=False)
                handles.append(file_folder)
                with file_folder:
                    self._add_file_buttons()
        self._record.on_click(lambda _: front.ask("record", self._toggle_recording))
        self._replay.on_click(lambda _: front.ask("replay", self._start_replay))
        load.on_upload(lambda _: front.ask("open", lambda: self._load(load.value.content)))
        front.after_frame.append(self._update)

    def _add_file_buttons(self) -> None:
        """Add controls that write files. Each write must be confirmed on the terminal; page users are not trusted."""
        gui, front = self.front.server.gui, self.front
        if front.terminal is None:
            gui.add_markdown("Start `twin view` in a terminal; it asks there before it writes files.")
            return
        self._name = gui.add_text("name", "reached")
        gui.add_button("as a posture").on_click(lambda _: front.ask("save", self._save_posture))
        gui.add_button("as the protocol's last phase").on_click(lambda _: front.ask("save", self._save_phase))

    def close(self) -> None:
        """End recording and replay; the owner of the list `handles` removes the controls."""
        self.front.after_frame.remove(self._update)

    def _toggle_recording(self) -> None:
        if self._record.label == "● Record":
            self.session = RecordedSession.of(self.robot.movable.mechanism)
            self._start_time = time.perf_counter()
            self._record.label = "■ Stop recording"
            self._replay.disabled = True
        else:
            self._record.label = "● Record"
            self._replay.disabled = False

    def _start_replay(self) -> None:
        self.front.clock.playing = False
        self._replay_time = time.perf_counter()

    def _update(self) -> None:
        movable = self.robot.movable
        if self.session is None:
            return
        if self._record.label != "● Record":
            elapsed = time.perf_counter() - self._start_time
            if len(self.session.moments) >= MAX_MOMENTS:
                self._toggle_recording()
                self.front.say(f"{MAX_MOMENTS} states are recorded, the maximum of a session", bad=True)
            elif not self.session.moments or not np.array_equal(self.session.moments[-1].q, movable.assembly.q):
                self.session.add(elapsed, movable.assembly.q, movable.assembly.T_base_tool)
        elif self._replay_time is not None and self.session.moments:
            elapsed = time.perf_counter() - self._replay_time
            if elapsed >= self.session.duration:
                self._replay_time = None
            session = self.session
            self.front.ask("replay", lambda: movable.move_joints(session.at(session.moments[0].time + elapsed)))

    def _load(self, content: bytes) -> None:
        with Scratch() as folder:
            path = Path(folder) / "session.json"
            path.write_bytes(content)
            self.session = RecordedSession.load(path, self.robot.movable.mechanism)
        self._replay.disabled = False
        self.front.say(f"{len(self.session.moments)} states, {self.session.duration:.1f} s: press Replay")

    def _save(self) -> None:
        if self.session is None or not self.session.moments:
            raise TwinError("the recording is empty: press Record, move the robot, press Stop")
        path = Path("twin-out") / self.robot.name / "session.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        self.session.save(path)
        self.front.say(f"written: {path}")

    def _save_posture(self) -> None:
        files = self.robot.movable.robot.files
        assert files is not None
        name, path = self._name.value, files.description
        values = dict(zip([j.name for j in self.robot.movable.joints], self.robot.movable.assembly.q, strict=True))
        self._when_confirmed(f"posture '{identifier(name)}'", path, lambda: save_posture(path, name, values))

    def _save_phase(self) -> None:
        robot, a = self.robot.movable.robot, self.robot
        assert robot.files is not None
        protocol = robot.protocol(a.protocol)
        T_tool_frame = a.movable.mechanism.frame_in_tool(protocol.frame)
        name, T = self._name.value, a.movable.assembly.T_base_tool.copy()
        protocol_name = a.protocol or protocol.name
        path = Path(protocol_name) if protocol_name.endswith(".toml") else robot.files.protocol(protocol_name)
        self._when_confirmed(f"phase '{identifier(name)}'", path, lambda: append_phase(path, name, T, T_tool_frame))

    def _when_confirmed(self, what: str, path: Path, write: Callable[[], None]) -> None:
        """Write a file after confirmation on the terminal."""
        front = self.front
        assert front.terminal is not None

        def then(yes: bool) -> None:
            def do() -> None:
                write()
                front.say(f"{what} written into {path.name}; reload the robot to use it")

            front.ask(
                "write", do if yes else lambda: front.say(f"{what}: declined in the terminal; the file is unchanged")
            )

        front.terminal.ask(f"The page wants to write {what} into {path}. Write it?", then)
        front.say(f"{what}: confirm or decline in the terminal")
