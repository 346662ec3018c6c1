"""The signals of Worlds: one definition of each kind, with its shape, its unit and what it means.

A kind belongs to an owner, such as a robot; `ROBOT_GOAL.of("psm1")` is the name "psm1.goal". Poses are (4, 4), row by
row. Lengths are in m, angles in rad, times in s. In shapes, "n" is the number of joints of the robot, or of parts of an
organ or vessel. A flag is 0 or 1; an index and a count are whole numbers.
"""

from __future__ import annotations

from dataclasses import dataclass

PEDALS = "pedals"
"""Name of the input device in Worlds with a console."""

JOINTS = "m or rad"
"""Unit of joint values: m for slides, rad for rotations."""


@dataclass(frozen=True)
class SignalKind:
    """A kind of signals.

    Attributes:
        owner: what the signal belongs to, such as "robot".
        what: second part of the signal's name.
        shape: of the value; () for a number.
        unit: in SI; "1" for a number without unit.
        meaning: what the value is.
    """

    owner: str
    what: str
    shape: tuple[int | str, ...]
    unit: str
    meaning: str

    def of(self, owner: str) -> str:
        """Return the name of the signal of an owner, such as "psm1.goal"."""
        return f"{owner}.{self.what}"

    @property
    def name(self) -> str:
        """Name of the signal in a World with one owner that is called what it is, such as "console.mode"."""
        return self.of(self.owner)

    def owner_of(self, name: str) -> str | None:
        """Return the owner of the signal with this name; None if the signal is of another kind."""
        owner, _, what = name.rpartition(".")
        if what != self.what:
            return None
        return owner

    @property
    def size(self) -> int | None:
        """Number of values; None if it depends on the owner."""
        size = 1
        for length in self.shape:
            if not isinstance(length, int):
                return None
            size *= length
        return size


# -- the console: a World has one of each, and its name begins with the owner's word ---------------------------

CONSOLE_MODE = SignalKind("console", "mode", (), "1", "what the hands control: nothing, tools or the camera")
CONSOLE_TAPS = SignalKind("console", "taps", (), "1", "count of quick taps of the clutch")
CONSOLE_VIEW = SignalKind("console", "view", (), "1", "index of the view that the page shows")
HAPTICS_ON = SignalKind("haptics", "on", (), "1", "flag: forces act on the hands")
SURGEON_TARGET = SignalKind("surgeon", "target", (), "1", "index of the target of a simulated surgeon; -1: none yet")
SURGEON_STAGE = SignalKind("surgeon", "stage", (), "1", "index of the step of a simulated surgeon")

# -- the input device: pedals and settings for both hands -----------------------------------------------------

DEVICE_CLUTCH = SignalKind("device", "clutch", (), "1", "flag: the clutch pedal is pressed")
DEVICE_CAMERA = SignalKind("device", "camera", (), "1", "flag: the camera pedal is pressed")
DEVICE_TRAINING = SignalKind("device", "training", (), "1", "index of the requested phase of the training")
DEVICE_SILENT = SignalKind("device", "silent", (), "1", "flag: a hand that moves a robot sends no states")
DEVICE_HAPTICS = SignalKind("device", "haptics", (), "1", "flag: forces on the hands are switched on")
DEVICE_SCALE = SignalKind("device", "scale", (), "1", "motion of a tool, relative to that of the hand")
DEVICE_FULCRUM = SignalKind("device", "fulcrum", (), "1", "index of the end of the instrument that a hand controls")
DEVICE_IGNORED = SignalKind("device", "ignored", (), "1", "count of hand states and motion scales that were ignored")

# -- a hand, or its pen ---------------------------------------------------------------------------------------

HAND_POSE = SignalKind("hand", "pose", (4, 4), "m", "pose in {H}, the axes of the picture")
HAND_GRIP = SignalKind("hand", "grip", (), "rad", "angle between thumb and finger")
HAND_FORCE = SignalKind("hand", "force", (3,), "N", "force on the hand in {H}")
HAND_ENERGY = SignalKind("hand", "energy", (), "J", "energy that the observer of passivity counts; never negative")
HAND_LOST = SignalKind("hand", "lost", (), "1", "count of states of the hand that did not arrive")
HAND_HANDLE = SignalKind("hand", "handle", ("n",), JOINTS, "coordinates of the handle in the form of the equations")
HAND_PEDAL = SignalKind("hand", "pedal", (), "1", "flag: the pedal of the hand is pressed")
HAND_GOAL = SignalKind("hand", "goal", (), "1", "index of the goal of a simulated operator; -1 at first")
HAND_JUMPS = SignalKind("hand", "jumps", (), "1", "count of jumps of the hand")

# -- a robot --------------------------------------------------------------------------------------------------

ROBOT_Q = SignalKind("robot", "q", ("n",), JOINTS, "values of the active joints")
ROBOT_ENCODER = SignalKind("robot", "encoder", ("n",), JOINTS, "joint values that controllers read")
ROBOT_COMMAND = SignalKind("robot", "command", ("n",), JOINTS, "joint values to which the robot moves")
ROBOT_RATE = SignalKind("robot", "rate", ("n",), "m/s or rad/s", "rate of the tool's coordinates")
ROBOT_GOAL = SignalKind("robot", "goal", (4, 4), "m", "tool pose in base to which the robot moves")
ROBOT_FOLLOWS = SignalKind("robot", "follows", (), "1", "flag: the robot follows a hand")
ROBOT_JUMPS = SignalKind("robot", "jumps", (), "1", "count of jumps of the hand that the robot did not follow")
ROBOT_JAW = SignalKind("robot", "jaw", (), "rad", "angle of the jaws")
ROBOT_TARGET = SignalKind("robot", "target", (17,), "m", "flag: the hand moves the target of a plan; its pose in base")
ROBOT_TIP_TARGET = SignalKind("robot", "target", (3,), "m", "position in the World to which the tip moves")
ROBOT_PLANNED = SignalKind("robot", "planned", (17,), "m", "state of a planned motion; its present pose in base")
ROBOT_TOUCHES = SignalKind("robot", "touches", (), "1", "flag: the instrument touches a fixed part")
ROBOT_MEETS = SignalKind("robot", "meets", (), "1", "flag: the instrument touches another instrument")
ROBOT_PLANES = SignalKind("robot", "planes", ("n",), "m", "local planes of the parts that the instrument touches")

# -- a robot with tools, which operates on organs -------------------------------------------------------------

ROBOT_OPENING = SignalKind("robot", "opening", (), "1", "opening of the jaws, 0 (closed) to 1")
ROBOT_PEDAL = SignalKind("robot", "pedal", (), "1", "flag: cautery is on")
ROBOT_TOOL = SignalKind("robot", "tool", (), "1", "index of the requested tool, in the order of the scene")
ROBOT_CARRIES = SignalKind("robot", "carries", (), "1", "index of the tool that the robot carries")
ROBOT_HOLDS = SignalKind("robot", "holds", (), "1", "what the jaws hold: -1 nothing, 0 the organ, k the k-th vessel")
ROBOT_TIP = SignalKind("robot", "tip", (3,), "m", "position of the tip in the World")
ROBOT_PULL = SignalKind("robot", "pull", (3,), "N", "force on what the jaws hold")
ROBOT_SLIPPED = SignalKind("robot", "slipped", (), "m", "slip of the held point")
ROBOT_LIFTED = SignalKind("robot", "lifted", (3,), "m", "displacement of the held point from its rest position")

# -- a machine, and the model of it that trains an operator ---------------------------------------------------

ROBOT_RUN = SignalKind("robot", "run", (4,), "1", "flag: the machine answers; run level; last packet; last tick")
ROBOT_MEASURED = SignalKind("robot", "measured", ("n",), JOINTS, "joint values that the machine measured")
ROBOT_DESIRED = SignalKind("robot", "desired", ("n",), JOINTS, "joint values to which the machine moves")
ROBOT_PACKET = SignalKind("robot", "packet", (9,), "m", "packet for the machine")
ROBOT_GIVEN = SignalKind(
    "robot", "given", (10,), "m", "packet for the model; flag: it takes the machine's joint values"
)
ROBOT_PHASE = SignalKind("robot", "phase", (3,), "1", "phase of the training; why it was refused or ended; a value")
ROBOT_MODEL = SignalKind(
    "robot", "model", (3,), "m/s", "run level of the model; speed of its tip; targets out of reach"
)
ROBOT_DEVIATION = SignalKind("robot", "deviation", (2,), "m, m/s", "distance of both tips; speed of the machine's tip")
ROBOT_APART = SignalKind("robot", "apart", ("n",), JOINTS, "joint values of the model minus those of the machine")
ROBOT_CUE = SignalKind("robot", "cue", (3,), "N", "force in base that leads the hand")

# -- a camera -------------------------------------------------------------------------------------------------

CAMERA_VIEW = SignalKind("camera", "view", (4, 4), "m", "pose of the picture in the World")
CAMERA_AT = SignalKind("camera", "at", (4,), "m and rad", "pan, tilt, depth and roll")

# -- a movable object -----------------------------------------------------------------------------------------

OBJECT_POSE = SignalKind("object", "pose", (4, 4), "m", "pose in the World")
OBJECT_HOLDER = SignalKind("object", "holder", (), "1", "index of the gripper that holds the object; -1: none")
OBJECT_RUBS = SignalKind("object", "rubs", (), "1", "flag: the object touches a part that it must not touch")
CLIP_ON = SignalKind("clip", "on", (), "1", "index of the clip's vessel; -1: on none; -2: not used yet")
CLIP_AT = SignalKind("clip", "at", (), "m", "position of the clip along its vessel")
CLIP_COVER = SignalKind("clip", "cover", (), "1", "fraction of the vessel's width between the legs of the clip")

# -- an organ, a vessel, another deformable -------------------------------------------------------------------

ORGAN_NODES = SignalKind("organ", "nodes", ("n", 3), "m", "nodes of the organ's grid in the World")
ORGAN_TOUCHED = SignalKind("organ", "touched", (), "1", "index of the triangle that is pressed deepest; -1: none")
ORGAN_FORCE = SignalKind("organ", "force", (3,), "N", "contact force on the organ in the World")
ORGAN_ENERGY = SignalKind("organ", "energy", ("n",), "J", "energy applied to each cell of the bed")
ORGAN_FREED = SignalKind("organ", "freed", ("n",), "1", "flags: the cell of the bed is free")
ORGAN_DEPTH = SignalKind("organ", "depth", (), "m", "depth of the deepest tip below the rest surface of a spared organ")
VESSEL_NODES = SignalKind("vessel", "nodes", ("n", 3), "m", "nodes of the vessel's deformable in the World")
VESSEL_CUT = SignalKind("vessel", "cut", ("n",), "1", "flags: the segment is cut away")
VESSEL_SEEN = SignalKind("vessel", "seen", (), "1", "fraction of the vessel that the camera sees")
DEFORMABLE_VERTICES = SignalKind("deformable", "vertices", ("n", 3), "m", "vertices in the frame of the body")
