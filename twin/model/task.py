"""A task at a console or a bedside, and the kinds of tasks, each in a folder of its own.

A folder in `twin/simulation/tasks/` has the name of the key of a section [task.NAME], and a module `task` with
`KIND = TaskKind(...)`. Another package names such an object in its metadata, in the group of entry points `twin.tasks`:
`circle = "circle_task.task:KIND"`. The other modules of the folder simulate and judge the task;
`twin.simulation.session.task_play` loads them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Protocol, TypeVar, get_origin

from pydantic import Field, create_model, model_validator

from twin.core.entry_points import entry_points
from twin.core.errors import TwinError
from twin.core.provenance import Parameter
from twin.core.units import MM
from twin.model.contact import ContactTable, ObjectTable
from twin.model.tool import ToolTable
from twin.schema import Row, Sourced, Table, at

GROUP = "twin.tasks"
"""Group of the entry points that name kinds of tasks of other packages."""

FOLDER = "twin.simulation.tasks"
"""Package of the built-in kinds. Only their modules `task` are loaded here, and only by name: those of the simulation
stay above this room."""

G = TypeVar("G")


class SceneNames(Protocol):
    """The tables of a scene file that the goal of a task can name."""

    @property
    def object(self) -> Mapping[str, ObjectTable]: ...  # noqa: D102
    @property
    def contact(self) -> ContactTable | None: ...  # noqa: D102
    @property
    def tissue(self) -> Mapping[str, Table]: ...  # noqa: D102
    @property
    def vessel(self) -> Mapping[str, Table]: ...  # noqa: D102
    @property
    def camera(self) -> Mapping[str, Table]: ...  # noqa: D102
    @property
    def tool(self) -> Mapping[str, ToolTable]: ...  # noqa: D102


def _unchecked(path: Path, name: str, value: object, scene: SceneNames, robots: Sequence[str]) -> None:
    """Accept each value of a key that names nothing of the scene."""


def _no_rows(value: object) -> Iterable[Row]:
    """Return no numbers of a goal."""
    return ()


def _one_step(name: str, goal: object) -> Sequence[str]:
    """Return the task as its only part."""
    return (name,)


def _unchanged(value: object) -> object:
    """Return the value of a key as the goal itself."""
    return value


@dataclass(frozen=True)
class TaskKind:
    """A kind of task: the key of a section [task.NAME] that contains the goal, and what the goal requires.

    Beside `task.py`, its folder contains `play.py` with a `twin.simulation.session.task_play.Play`.

    Attributes:
        name: the key, and the name of the folder.
        title: what there is to do, for help and messages, such as "rings to bring to pegs".
        order: position in lists, smallest first.
        field: type and default of the key in the table of a task; the default is empty.
        package: package of the modules `task` and `play`: `__package__`.
        goal: function from the value of the key to `ConsoleTask.goal`.
        rows: function from the value of the key to (name, value, unit) of its numbers.
        check: function (file, name of the task, value of the key, scene, names of the robots) that raises an error if
            the value names something that the scene does not have.
        steps: function from name and goal of a task to the names of its parts, in the order of `surgeon.target`.
        timed: whether a task of this kind has the keys `tolerance_mm` and `hold_s`.
        console: whether it needs a console; only a procedure has a World of its own and needs none.
        grasps: whether the instruments grasp movable objects.
        props: whether the props are read also for sessions without forces.
        judged: whether a page judges the task while it is performed.
        mistakes: mistakes that the simulated surgeon makes on request.
    """

    name: str
    title: str
    order: int
    field: tuple[object, object]
    package: str | None
    goal: Callable[..., object] = _unchanged
    rows: Callable[..., Iterable[Row]] = _no_rows
    check: Callable[..., None] = _unchecked
    steps: Callable[..., Sequence[str]] = _one_step
    timed: bool = False
    console: bool = True
    grasps: bool = False
    props: bool = False
    judged: bool = False
    mistakes: tuple[str, ...] = ()


@cache
def kinds() -> tuple[TaskKind, ...]:
    """Return all kinds of tasks, in their order.

    Raises:
        TwinError: a kind of another package cannot be imported, or has the name of another kind.
    """
    kind_of_name: dict[str, TaskKind] = {}
    for folder in iter_modules(import_module(FOLDER).__path__):
        kind = import_module(f"{FOLDER}.{folder.name}.task").KIND
        kind_of_name[kind.name] = kind
    for name, kind in entry_points(GROUP).items():
        if not isinstance(kind, TaskKind):
            raise TwinError(f"the entry point '{name}' of {GROUP} is {kind!r}, not a twin.model.task.TaskKind")
        if kind.name in kind_of_name or kind.name in TaskTable.model_fields or hasattr(TaskTable, kind.name):
            text = f"the key '{kind.name}' of a task has a meaning already"
            raise TwinError(f"{text}; the entry point '{name}' of {GROUP} needs another")
        if kind.name != name:
            raise TwinError(
                f"the entry point '{name}' of {GROUP} is the kind of task '{kind.name}': give both one name"
            )
        kind_of_name[kind.name] = kind
    return tuple(sorted(kind_of_name.values(), key=lambda kind: (kind.order, kind.name)))


class TaskTable(Sourced):
    """A task: targets to touch in order, rings to bring to pegs, a ring to guide, a camera to align, or a procedure.

    A target has a point for one hand or for both hands. A target is touched when, for each of these hands, the distance
    between tip and point has been within the tolerance for `hold_s`, without interruption. A ring is transferred when
    it is around its peg and no instrument holds it. `GuideTable` describes `guide`, `AlignTable` describes `align`,
    `ProcedureTable` describes `procedure`. The folder of a kind says in `KIND` whether it needs a console.
    """

    title: str = Field(min_length=1)
    tolerance_mm: float | None = Field(None, gt=0)
    hold_s: float | None = Field(None, ge=0, le=10)

    @model_validator(mode="after")
    def _one_kind(self) -> TaskTable:
        kinds_with_key = [kind for kind in kinds() if getattr(self, kind.name, None)]
        if len(kinds_with_key) != 1:
            keys = " and ".join([f"`{kind.name}`" for kind in kinds_with_key]) or "none of them"
            raise at("title", f"a task needs a goal: {_goals()}; this task has {keys}")
        (kind,) = kinds_with_key
        for key in ("tolerance_mm", "hold_s"):
            has_key = getattr(self, key) is not None
            if kind.timed and not has_key:
                raise at("title", f"a task with `{kind.name}` needs `{key}`")
            if has_key and not kind.timed:
                raise at(key, f"a task with `{kind.name}` takes no `{key}`")
        return self

    @property
    def kind(self) -> TaskKind:
        """The kind of the task: the one whose key it has."""
        for kind in kinds():
            if getattr(self, kind.name, None):
                return kind
        raise AssertionError("the validator requires one kind")

    @property
    def value(self) -> object:
        """Value of the key that makes the task one of its kind."""
        return getattr(self, self.kind.name)


def _goals() -> str:
    """Return the keys of all kinds as text: first those with lists, which need an entry."""
    lists = []
    tables = []
    for kind in kinds():
        if get_origin(kind.field[0]) is list:
            lists.append(f"`{kind.name}`")
        else:
            tables.append(f"`{kind.name}`")
    others = [f"{' or '.join(lists)} with at least one entry", *tables]
    return f"{', '.join(others[:-1])} or {others[-1]}"


@cache
def task_table() -> type[TaskTable]:
    """Return the table of a task with one key for each kind of task."""
    fields = {kind.name: kind.field for kind in kinds()}
    return create_model("TaskTable", __base__=TaskTable, __doc__=TaskTable.__doc__, **fields)  # pyright: ignore[reportCallIssue, reportArgumentType]


@dataclass(frozen=True)
class ConsoleTask:
    """A task of a kind, with its goal in SI units.

    `tolerance` is the maximum distance in m of a tip from its point during a touch; `hold` is the time in s for which
    all tips of a target must be within the tolerance; both are 0 for kinds of tasks without targets.
    """

    name: str
    title: str
    tolerance: float
    hold: float
    kind: TaskKind
    goal: object

    @property
    def steps(self) -> Sequence[str]:
        """Names of the parts of the task, in the order of their numbers in `surgeon.target`."""
        return self.kind.steps(self.name, self.goal)


def goal_of(task: ConsoleTask | None, goal: type[G]) -> G | None:
    """Return the goal of a task if it has this type; None: there is no task, or it is of another kind."""
    if task is not None and isinstance(task.goal, goal):
        return task.goal
    return None


def required_goal(task: ConsoleTask, goal: type[G]) -> G:
    """Return the goal of a task, which must have this type.

    Raises:
        TwinError: the task is of another kind.
    """
    task_goal = goal_of(task, goal)
    if task_goal is None:
        raise TwinError(f"task '{task.name}' with the key `{task.kind.name}` has no {goal.__name__}")
    return task_goal


def task_of(name: str, task: TaskTable) -> ConsoleTask:
    """Return the `ConsoleTask` that a table describes, in SI units."""
    tolerance = (task.tolerance_mm or 0.0) * MM
    kind = task.kind
    return ConsoleTask(name, task.title, tolerance, task.hold_s or 0.0, kind, kind.goal(task.value))


def listed(name: str, task: TaskTable) -> Iterator[Parameter]:
    """Yield the numbers of task `name` as parameters with provenance."""
    rows: list[Row] = [("tolerance", task.tolerance_mm, "mm"), ("hold", task.hold_s, "s")]
    rows += task.kind.rows(task.value)
    return task.parameters(f"task {name}", rows)
