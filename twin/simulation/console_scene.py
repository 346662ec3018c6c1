"""A World with the robots of a scene, controlled from a surgeon's console: two hands, pedals, a movable camera."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple
from typing import Any

import numpy as np

from twin.core import spatial
from twin.core.errors import TwinError, unknown
from twin.core.spatial import Array
from twin.core.units import DEG, MM, display_unit
from twin.kinematics import Kinematics
from twin.model.console import CameraTable, ConsoleTable
from twin.model.deformable import Deformable
from twin.model.mechanism import Mechanism
from twin.model.scene import Place, Scene
from twin.model.task import ConsoleTask, goal_of
from twin.simulation import blocks, contact_scene, machine_scene, operating_scene, rate_console
from twin.simulation.controllers.camera import CameraDrag, CameraDragging, HandsToCamera, at_of_view
from twin.simulation.controllers.hand_force import ForceParameters
from twin.simulation.controllers.haptics import FeltArm, HapticHand, HapticSwitch
from twin.simulation.controllers.instrument_pivot import FULCRUMS, Fulcrum, InstrumentPivot
from twin.simulation.controllers.jaw import GripToJaw, Jaw
from twin.simulation.controllers.pedals import Pedals
from twin.simulation.controllers.pose_to_joints import PoseToJoints
from twin.simulation.controllers.through_port import ThroughPort
from twin.simulation.controllers.tool_following import FollowingArm, HandToPose
from twin.simulation.controllers.tool_grip import GripToTool
from twin.simulation.limits import JointLimits
from twin.simulation.machine.machine_parts import Parts
from twin.simulation.plants.contact.contact_planes import PLANES_SIGNAL as PLANES
from twin.simulation.plants.kinematic import Kinematic
from twin.simulation.rate_console import PICTURE
from twin.simulation.session.task_play import play_of
from twin.simulation.setup import Setup
from twin.simulation.tasks.procedure.task import ProcedureTable
from twin.simulation.world import Block, Placed, World
from twin.simulation.world.signal_kinds import DEVICE_FULCRUM, PEDALS, ROBOT_PLANNED, ROBOT_TOOL

TICK = 1e-3
"""Usual duration of a tick in s."""

HANDS = ("right", "left")
"""Names of the hands; the device of the pedals is named `pedals`."""

FULCRUM = DEVICE_FULCRUM.of(PEDALS)

ORGANS = 16e-3
"""Time in s between two steps of the organs in a World shown live; with shorter steps, it lags behind real time."""


def start(place: Place, mechanism: Mechanism) -> Array:
    """Return the joint values (n,) of a robot at the start of a console session.

    Raises:
        TwinError: a joint of `place` is not in the robot, or its value is outside the limits.
    """
    active = mechanism.active
    names = [joint.name for joint in active]
    q = np.array(mechanism.posture("home"), float)
    for name, stated in place.start.items():
        if name not in names:
            raise TwinError(f"{place.name}: start: {unknown('active joint', name, names)}")
        k = names.index(name)
        joint = active[k]
        text, unit = display_unit(joint.is_angle)
        low, high = joint.limits or (-np.inf, np.inf)
        if not low <= stated * unit <= high:
            allowed = f"{low / unit:g} .. {high / unit:g} {text}"
            raise TwinError(f"{place.name}: start: {name} is {stated:g} {text}, outside {allowed}")
        q[k] = stated * unit
    return q


def world(
    setup: Setup,
    device: Block,
    dt: float = TICK,
    records: bool = True,
    watch: Sequence[Block] = (),
    parts: Mapping[str, Parts] | None = None,
) -> World:
    """Return a World in which a console controls the robots of a scene.

    The camera's arm rotates about its port. The axis of tilt is the horizontal direction that points to the right in
    the picture at the start; the axis of pan is the horizontal direction perpendicular to the tilt axis. The frame {H}
    of the hands is parallel to the frame of the picture: x right, y up, z out of the picture.

    Args:
        setup: a scene with a console, its robots and its task.
        device: block that writes the poses and gripper angles of `HANDS`, and the states of the pedals; it may also
            write planned motions of the arms, see `devices.plans`.
        dt: duration of one tick in s.
        records: whether every tick is recorded; see `World`.
        watch: blocks without outputs that read all signals at the end of a tick.
        parts: {name of a place: compiled parts of its machine}; `device` then also writes the states of the machines
            (`devices.machine_states`). None: machines move like other robots, without dynamics and states.

    Raises:
        TwinError: the scene has no console, the camera is not on its robot's tool, a start value is wrong, or a solid
            body is not in the props; or a robot or an organ of the procedure is missing.
        WorldError: a link is inside an organ at the start.
    """
    scene = setup.scene
    members = setup.members
    table = console_of(scene)
    q = _starts(setup)
    limits: dict[str, JointLimits] = {}
    robots = []
    for place in led_by(scene):
        member = members[place.name]
        limits[place.name] = JointLimits.of(member.mechanism)
        robots.append(Placed(place.name, member.mechanism, place.T_world_base, member.links))
    # With teleoperation, one hand moves one robot by rates; otherwise, two hands lead poses.
    if table.teleoperation is not None:
        controllers = rate_console.controllers(setup, table, device, q[table.right[0]], dt)
    else:
        controllers = _pose_controllers(setup, device, q, limits, dt)
    machines = machine_scene.MachineBlocks(scene, parts or {})
    kins = {name: member.kin for name, member in members.items()}
    controllers += machines.controllers(PEDALS, kins, dt)
    plants: list[Block] = []
    for name, x in q.items():
        if name in machines.parts:
            continue  # a machine moves itself
        if table.teleoperation is None:
            controllers.append(_joint_controller(setup, name, x, limits[name]))
        plants.append(Kinematic(name, x, limits[name]))
    plants += machines.plants(q)
    robots += machines.placed_models(members)
    if setup.objects or setup.felt:
        plants.append(contact_scene.contact(setup, list(hands_of(scene)), q))
    deformables: Sequence[Deformable] = ()
    objects = setup.objects
    if setup.procedure is not None:
        operated, grips = _operated(setup, q)
        controllers += grips
        plants.append(operated.plant)
        deformables = operated.deformables
        objects = operated.objects
    if setup.haptics is not None:
        controllers.append(HapticSwitch(PEDALS, setup.haptics))
        if parts:
            # the hands feel the deviation of a machine from its model instead of contacts
            plants += machines.cues(HANDS)
        else:
            plants += _forces(setup, limits, dt)
    return World(
        robots=robots,
        deformables=deformables,
        objects=objects,
        devices=[device, *blocks.blocks(setup, "devices")],
        controllers=[*controllers, *blocks.blocks(setup, "controllers")],
        plants=[*plants, *blocks.blocks(setup, "plants"), *watch],
        hazards=blocks.hazards(setup),
        dt=dt,
        records=records,
    )


def _starts(setup: Setup) -> dict[str, Array]:
    """Return {robot: joint values (n,) at the start}: those of the task, otherwise those of the scene."""
    of_task: Mapping[str, Array] = {}
    if setup.task is not None:
        of_task = play_of(setup.task).start(setup, setup.task)
    q: dict[str, Array] = {}
    for place in led_by(setup.scene):
        if place.name in of_task:
            q[place.name] = of_task[place.name]
        else:
            q[place.name] = start(place, setup.members[place.name].mechanism)
    return q


def _pose_controllers(
    setup: Setup, device: Block, q: Mapping[str, Array], limits: Mapping[str, JointLimits], dt: float
) -> list[Block]:
    """Return the controllers of pedals, camera and hands by which two hands lead the poses of tools."""
    camera = _camera(setup, q, dt)
    planned = _planned(device)
    controllers: list[Block] = [Pedals(PEDALS, planned=planned), camera]
    for hand in HANDS:
        controllers += _hand_controllers(setup, hand, q, limits, camera, planned=bool(planned), dt=dt)
    return controllers


def _joint_controller(setup: Setup, name: str, q: Array, limits: JointLimits) -> Block:
    """Return the controller that moves the joints of a robot to the pose of its tool, or through its port."""
    kin = setup.members[name].kin
    port = port_in_base(setup.places[name])
    if name in console_of(setup.scene).through:
        return ThroughPort(name, kin, q, limits, port)
    return PoseToJoints(name, kin, q, limits)


def _hand_controllers(
    setup: Setup,
    hand: str,
    q: Mapping[str, Array],
    limits: Mapping[str, JointLimits],
    camera: HandsToCamera,
    *,
    planned: bool,
    dt: float,
) -> list[Block]:
    """Return the controllers that move tools and jaws by one hand."""
    arms = _following(setup, hand, q)
    at = [q[arm.robot] for arm in arms]
    follower = HandToPose(hand, PEDALS, arms, at, np.eye(4), view=camera.camera, dt=dt, plans=planned)
    return [follower, *_jaws(hand, arms, limits, q, dt)]


def _following(setup: Setup, hand: str, q: Mapping[str, Array]) -> list[FollowingArm]:
    """Return the arms that a hand can move, with joint values q (n,) of each robot at the start."""
    table = console_of(setup.scene)
    arms = []
    for name in getattr(table, hand):
        kin = setup.members[name].kin
        place = setup.places[name]
        arms.append(FollowingArm(name, kin, place.T_world_base, pivot(table, place, kin, q[name])))
    return arms


def _planned(device: Block) -> list[str]:
    """Return the arms whose planned motions a device writes."""
    arms = []
    for name in device.outputs:
        arm = ROBOT_PLANNED.owner_of(name)
        if arm is not None:
            arms.append(arm)
    return arms


def _jaws(
    hand: str, arms: Sequence[FollowingArm], limits: Mapping[str, JointLimits], q: Mapping[str, Array], dt: float
) -> Iterator[Block]:
    """Yield a block for each arm that has a jaw: a hand moves the jaw, the first auxiliary joint of the arm.

    Raises:
        TwinError: the jaw has no upper limit, to which an open gripper opens it.
    """
    for arm in arms:
        auxiliary = np.flatnonzero(arm.kin.auxiliary)
        if not len(auxiliary):
            continue
        k = auxiliary[0]
        joint_limits = limits[arm.robot]
        low = max(float(joint_limits.lower[k]), 0.0)  # some limits let the jaws cross; closed jaws are at 0
        high = float(joint_limits.upper[k])
        if not low < high < np.inf:
            joint = arm.kin.joints[k]
            raise TwinError(
                f"{arm.robot}: the upper limit of the jaw's joint '{joint}' is {high:g} rad; an open gripper opens the "
                f"jaw to it, so that it must be finite and above {low:g} rad: change the limits of '{joint}'"
            )
        jaw = Jaw(low, high, float(q[arm.robot][k]), dt)
        yield GripToJaw(hand, arm.robot, jaw)


def _operated(setup: Setup, q: Mapping[str, Array]) -> tuple[operating_scene.OperatingField, list[Block]]:
    """Return the operating field of a procedure, and for each robot with a tool, the block that closes its jaws."""
    procedure = operating_scene.procedure_of(setup.scene, setup.task)
    hands = hands_of(setup.scene)
    grips: list[Block] = []
    without = []
    for name in procedure.start:
        if name in hands:
            grips.append(GripToTool(hands[name], name))
        else:
            without.append(name)
    if without:
        raise TwinError(f"{setup.label}: no hand of [console] moves {', '.join(without)}")
    return operating_scene.field(setup, q, ORGANS), grips


def console_of(scene: Scene) -> ConsoleTable:
    """Return the console of a scene.

    Raises:
        TwinError: the scene has no console.
    """
    if scene.console is None:
        raise TwinError(f"scene '{scene.name}' has no console: add a section [console] to {scene.file.name}")
    return scene.console


def hands_of(scene: Scene) -> dict[str, str]:
    """Return {robot: hand that moves it} for a console; the robots of the right hand come first.

    Raises:
        TwinError: the scene has no console.
    """
    table = console_of(scene)
    hands = {}
    for hand in table.hands:
        for name in getattr(table, hand):
            hands[name] = hand
    return hands


def instrument_names(scene: Scene) -> dict[str, str]:
    """Return {robot: what people call its instrument} for a console, such as "the left instrument".

    If a hand moves several robots in turn, the name of the robot follows in brackets.

    Raises:
        TwinError: the scene has no console.
    """
    table = console_of(scene)
    called = {}
    for robot, hand in hands_of(scene).items():
        words = f"the {hand} instrument"
        if len(table.hands) == 1:
            words = "the instrument"
        if len(getattr(table, hand)) > 1:
            words += f" ({robot})"
        called[robot] = words
    return called


def port_in_base(place: Place) -> Array:
    """Return the position (3,) in m of a robot's first port, in the frame of its base."""
    return (spatial.inverse(place.T_world_base) @ np.append(operating_scene.port_of(place), 1.0))[:3]


def pivot(table: ConsoleTable, place: Place, kin: Kinematics, q: Array) -> InstrumentPivot | None:
    """Return the pivot of an instrument at the start, with joint values q (n,); None if `table` lacks its length.

    Raises:
        TwinError: the tip is less than 1 mm from the port.
    """
    if place.name not in table.instrument_mm:
        return None
    port = port_in_base(place)
    inwards = kin.forward(q)[:3, 3] - port
    depth = float(np.linalg.norm(inwards))
    if depth < MM:  # the direction of the shaft is that of `inwards`
        beyond = f"the tip is {depth / MM:.3g} mm from its port; it must be beyond the port"
        raise TwinError(f"{place.name}: start: {beyond}")
    length = table.instrument_mm[place.name] * MM
    return InstrumentPivot(port, inwards / depth, length, place.name in table.through)


def drag(table: ConsoleTable) -> CameraDrag:
    """Return the parameters of the camera motion of a console."""
    ranges = table.camera_range
    if ranges is None:
        return CameraDrag()
    lower = []
    upper = []
    for (low, high), unit in (
        (ranges.pan_deg, DEG),
        (ranges.tilt_deg, DEG),
        (ranges.depth_mm, MM),
        (ranges.roll_deg, DEG),
    ):
        lower.append(low * unit)
        upper.append(high * unit)
    return CameraDrag(lower=tuple(lower), upper=tuple(upper))


def settings(scene: Scene, fulcrum: Fulcrum = "compensated", task: ConsoleTask | None = None) -> dict[str, float]:
    """Return {setting: initial value} of the device of a scene's console.

    `pedals.fulcrum` selects the end of an instrument that follows the hand (tip or outer end, see `instrument_pivot`).
    `<robot>.tool` is the index of the chosen tool, in the order of the scene file; in a procedure, its initial value is
    the tool at the start of the task. A scene without instruments in ports has no `pedals.fulcrum`, and a scene without
    tools has no `<robot>.tool`.
    """
    values: dict[str, float] = {}
    if console_of(scene).instrument_mm:
        values[FULCRUM] = float(FULCRUMS.index(fulcrum))
    tools = list(scene.tools)
    if tools:
        for k, name in enumerate(hands_of(scene)):
            values[ROBOT_TOOL.of(name)] = float(k % len(tools))
    if scene.trainer is not None:
        values |= machine_scene.SETTINGS
    procedure = goal_of(task, ProcedureTable)
    if procedure is not None:
        for name, tool in procedure.start.items():
            values[ROBOT_TOOL.of(name)] = float(tools.index(tool))
    return values


def led_by(scene: Scene) -> list[Place]:
    """Return the robots that a scene's console moves: the right hand's, then the left hand's, then the camera's."""
    table = console_of(scene)
    by_name = {place.name: place for place in scene.places}
    names = [*table.right, *table.left]
    camera = scene.cameras[table.camera].robot
    if camera not in names:  # a fixed camera may be on the base of the robot that a hand moves
        names.append(camera)
    return [by_name[name] for name in names]


def identity(setup: Setup, dt: float = TICK) -> str:
    """Return the hash "sha256:..." of the inputs of `world`: console, camera, places, start values, limits and frames.

    The duration `dt` of a tick in s is included if it is not `TICK`. The equations and the version of the program are
    not included. Numbers are rounded to 1e-9, so that the hash does not depend on the processor.
    """
    plain = operating_scene.plain
    scene = setup.scene
    task = setup.task
    table = console_of(scene)
    # Parts that a scene does not use are left out: its hash does not change when the program gets more of them.
    about: list[Any] = [scene.name, table.model_dump(include={"right", "left", "camera"})]
    if table.through or table.instrument_mm or table.camera_range or scene.tools:
        about.append(table.model_dump(include={"through", "instrument_mm", "camera_range"}))
        about.append(list(scene.tools))
    if table.teleoperation is not None:
        about.append([table.scale, table.teleoperation.model_dump(exclude={"provenance", "note"})])
    camera = scene.cameras[table.camera]
    about.append([camera.robot, camera.frame, plain(camera.in_frame)])
    for place in led_by(scene):
        mechanism = setup.members[place.name].mechanism
        names = []
        speeds = []
        for joint in mechanism.active:
            names.append(joint.name)
            speeds.append(plain(joint.max_speed or 0.0))
        about.append([place.name, place.robot, plain(place.T_world_base), plain(start(place, mechanism))])
        about.append([plain(operating_scene.port_of(place)), names])
        about.append([plain(np.nan_to_num(mechanism.limits)), speeds])
        frames = []
        for frame in mechanism.frames:
            frames.append([frame.name, frame.body, plain(frame.T_body_frame)])
        about.append(frames)
    if scene.trainer is not None:
        about.append(scene.trainer.model_dump(exclude={"provenance", "note"}))
    if setup.haptics is not None:
        about.append([plain(value) for value in astuple(surface(scene))])
    grasps = task is not None and task.kind.grasps
    if (setup.felt or grasps) and scene.contact is not None:
        about.append(scene.contact.model_dump(include={"solid", "friction", "jaw_effort_n_mm"}))
    if grasps and scene.contact is not None:
        for item in scene.objects:
            shape = [item.name, item.shape, plain(item.size), plain(item.mass)]
            about.append([*shape, plain(item.friction), plain(item.T_world_object)])
    if task is not None:
        about += play_of(task).identity(setup, task)
    for folder, tables in scene.blocks.items():
        for name, block in tables.items():
            about.append([folder, name, block.model_dump()])
    if dt != TICK:
        about.append(["tick", dt])
    return "sha256:" + hashlib.sha256(json.dumps(about).encode()).hexdigest()


def _forces(setup: Setup, limits: Mapping[str, JointLimits], dt: float) -> list[Block]:
    """Return the blocks that compute the forces on both hands."""
    scene = setup.scene
    table = console_of(scene)
    names = list(hands_of(scene))  # in the order of the grippers in contact
    camera = scene.cameras[table.camera].robot
    objects = [item.name for item in setup.objects]
    sources = (PLANES,) if setup.felt else ()
    force = surface(scene)
    hands: list[Block] = []
    for hand in table.hands:
        arms = []
        for name in getattr(table, hand):
            kin = setup.members[name].kin
            T_world_base = setup.places[name].T_world_base
            arms.append(FeltArm(name, kin, limits[name], T_world_base, names.index(name)))
        hands.append(HapticHand(hand, PEDALS, camera, arms, sources=sources, objects=objects, surface=force, dt=dt))
    return hands


def surface(scene: Scene) -> ForceParameters:
    """Return the parameters of the forces on the hands in a scene."""
    table = scene.haptics
    if table is None:
        return ForceParameters()
    return ForceParameters(table.stiffness_n_m, table.damping_ns_m, table.largest_n, table.device_damping_ns_m)


def _camera(setup: Setup, q: Mapping[str, Array], dt: float) -> HandsToCamera:
    scene = setup.scene
    table = console_of(scene)
    camera = scene.cameras[table.camera]
    place = setup.places[camera.robot]
    member = setup.members[camera.robot]
    tool = member.mechanism.frame(member.mechanism.tool)
    frame = member.mechanism.frame(camera.frame)
    if tool.body != frame.body:
        raise TwinError(
            f"{scene.file}: camera '{table.camera}' is on {frame.body}; a console can move only a camera on "
            f"{tool.body}, the body of the tool of {place.name}"
        )
    T_tool_view = picture_in_tool(camera, member.mechanism)
    T_world_view = place.T_world_base @ member.kin.forward(q[place.name]) @ T_tool_view
    right = T_world_view[:2, 0]
    R_world_centre = spatial.rotation_z(np.arctan2(right[1], right[0]))
    T_world_centre = spatial.pose(R_world_centre, operating_scene.port_of(place))
    law = CameraDragging(at_of_view(spatial.inverse(T_world_centre) @ T_world_view), dt, drag(table))
    T_view_tool = spatial.inverse(T_tool_view)
    return HandsToCamera(
        place.name, *HANDS, law, np.eye(4), T_world_centre, place.T_world_base, T_view_tool=T_view_tool
    )


def picture_in_tool(camera: CameraTable, mechanism: Mechanism) -> Array:
    """Return the pose (4, 4) of the picture's frame in the tool frame of its robot; both frames are on one body."""
    tool = mechanism.frame(mechanism.tool)
    frame = mechanism.frame(camera.frame)
    return spatial.inverse(tool.T_body_frame) @ frame.T_body_frame @ camera.in_frame @ PICTURE
