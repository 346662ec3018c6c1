"""Mechanism data of a file (links, joints, frames, gravity) in a common form for all formats."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from twin.exchange.audit.file_drives import FileMotor
from twin.exchange.audit.file_joints import WORLD, FileJoint
from twin.exchange.audit.joint_merging import joints_of, merged_joints
from twin.exchange.audit.new_names import renamed, with_new_keys
from twin.exchange.audit.poses import Array

VACUUM = (0.0, 0.0, 0.0, 0.0, 0.0)
"""`FileMechanism.medium` where nothing slows the robot down."""

_HELPER_SHARE = 1e-4
"""Largest mass of a link that a format needs only to split a joint or to close a loop, as a part of the mass of all."""

TOOL = "(tool)"
"""Name of the tool frame for all formats, because tracks do not state its name."""


@dataclass(frozen=True)
class FileMass:
    """Mass properties of a link, in the frame of the link.

    Attributes:
        mass: in kg.
        center: centre of mass (3,) in m; None if not stated.
        inertia: inertia (3, 3) in kg m2 about the centre of mass; None if not stated.
    """

    mass: float
    center: Array | None = None
    inertia: Array | None = None


@dataclass(frozen=True)
class FileFrame:
    """A named frame: the name of its link, and its pose T_link_frame (4, 4)."""

    link: str
    T: Array

    def renamed(self, links: Mapping[str, str]) -> FileFrame:
        """Return the frame after renaming links by {old: new}; its own name stays."""
        return FileFrame(links.get(self.link, self.link), self.T)


def _with_renamed_links(frames: Mapping[str, FileFrame], links: Mapping[str, str]) -> dict[str, FileFrame]:
    """Return frames by name after renaming their links by {old: new}; the names of the frames stay."""
    renamed_frames = {}
    for name, frame in frames.items():
        renamed_frames[name] = frame.renamed(links)
    return renamed_frames


@dataclass
class FileMechanism:
    """Mechanism data of a file.

    Attributes:
        links: names of all links.
        masses: {link: mass properties}.
        shown: {link: whether it has a mesh}, for formats that show a link by meshes alone.
        collides: {link: whether its meshes collide}: True where a file has a shape of the link that collides, False
            where it shows a mesh whose collider is disabled, and nothing else of the link collides.
        assumed: links whose mass is unknown: the file states an assumed mass, because the format requires a mass.
        partly_shown: links whose shapes do not show the whole link, as the file states or because they are for display
            only or not all read: their masses are not judged by them.
        joints: joints, with the parts into which a format divides a joint one by one.
        frames: {name: named frame}.
        points: {name: named point}, as frames with the axes of the link. A frame may have the name of a point.
        fully_listed: "frame", "point": those of which `frames` or `points` contains all that the robot has.
        gravity: (3,) in m/s2 in a world with z up; None if not stated.
        medium: (density in kg/m3, viscosity in Pa s, wind x, y, z in m/s) of what the robot moves in; zeros where no
            force acts on it, as in formats that cannot hold a medium; None if not stated.
        self_collision: whether links of the robot may collide with each other; None if not stated.
        fixed_to_world: links that a joint fixes directly to the world; None if the format cannot state that a link is
            fixed.
        tool: name of the frame that protocols move; "" if not stated.
        trocars: names of the trocar joints; the protocol determines their positions.
        couplings: {name: ({joint: factor}, constant)}; the sum of factor times joint coordinate is the constant. None
            if the format cannot state couplings.
        couples_pairs: whether the file can state couplings of two joints only: others are not missing in it.
        motors: {name: motor with a transmission}; None if not stated.
        reductions: {joint: motor coordinate / joint coordinate} of the transmissions of one joint; None if a file has
            no transmissions.
        all_motors: whether `motors` contains all motors with transmissions.
        weight_shares: {link: share of its weight that is compensated}, 0 without compensation; None if not stated.
        opening: length in m (angle in rad) by which the loops open if gravity pulls at them; None if not stated.
        robot: name of the robot; "" if not stated.
        postures: {name: {driven joint: coordinate in m or rad}}; None if not stated.
        home_posture: the coordinates of the posture "home" in a table of a file without other postures; None without.
        home: {joint: coordinate in m or rad} of the assembled pose that a file names home, also of passive joints; None
            if not stated. The posture "home" may be another pose.
        motion_declarations: {object: {field: value as text}} of what a file declares of the motion beside all of the
            above, with another value than where nothing is written; {} without such declarations, None if not known.
        contact_declarations: the same for contacts and look.
        program_settings: the same for what a single program reads, such as the calibration of a joint, or gravity in
            Gazebo.
        complete: whether `joints` contains all joints, each with its links; without this, a missing joint is not found.
    """

    links: tuple[str, ...] = ()
    masses: dict[str, FileMass] = field(default_factory=dict)
    shown: Mapping[str, bool] = field(default_factory=dict)
    collides: Mapping[str, bool] = field(default_factory=dict)
    assumed: frozenset[str] = frozenset()
    partly_shown: frozenset[str] = frozenset()
    joints: list[FileJoint] = field(default_factory=list)
    frames: dict[str, FileFrame] = field(default_factory=dict)
    points: dict[str, FileFrame] = field(default_factory=dict)
    fully_listed: frozenset[str] = frozenset()
    gravity: Array | None = None
    medium: tuple[float, ...] | None = None
    self_collision: bool | None = None
    fixed_to_world: frozenset[str] | None = None
    tool: str = ""
    trocars: frozenset[str] = frozenset()
    couplings: Mapping[str, tuple[Mapping[str, float], float]] | None = None
    couples_pairs: bool = False
    motors: Mapping[str, FileMotor] | None = None
    all_motors: bool = False
    reductions: Mapping[str, float] | None = None
    weight_shares: Mapping[str, float] | None = None
    opening: float | None = None
    robot: str = ""
    postures: Mapping[str, Mapping[str, float]] | None = None
    home_posture: Mapping[str, float] | None = None
    home: Mapping[str, float] | None = None
    motion_declarations: Mapping[str, Mapping[str, str]] | None = None
    contact_declarations: Mapping[str, Mapping[str, str]] | None = None
    program_settings: Mapping[str, Mapping[str, str]] | None = None
    complete: bool = False

    def rename(self, links: Mapping[str, str], joints: Mapping[str, str]) -> None:
        """Rename links and joints by {old: new}; other names stay, as do the texts of what is declared beside them."""
        self.links = renamed(self.links, links)
        self.masses = with_new_keys(self.masses, links)
        self.shown = with_new_keys(self.shown, links)
        self.collides = with_new_keys(self.collides, links)
        self.assumed = frozenset(renamed(self.assumed, links))
        self.partly_shown = frozenset(renamed(self.partly_shown, links))
        for number, joint in enumerate(self.joints):
            self.joints[number] = joint.renamed(links, joints)
        self.frames = _with_renamed_links(self.frames, links)
        self.points = _with_renamed_links(self.points, links)
        if self.fixed_to_world is not None:
            self.fixed_to_world = frozenset(renamed(self.fixed_to_world, links))
        self.trocars = frozenset(renamed(self.trocars, joints))
        if self.couplings is not None:
            couplings: dict[str, tuple[Mapping[str, float], float]] = {}
            for name, (factors, constant) in self.couplings.items():
                couplings[name] = (with_new_keys(factors, joints), constant)
            self.couplings = couplings
        if self.motors is not None:
            motors = {}
            for name, motor in self.motors.items():
                motors[name] = motor.renamed(joints)
            self.motors = motors
        if self.reductions is not None:
            self.reductions = with_new_keys(self.reductions, joints)
        if self.weight_shares is not None:
            self.weight_shares = with_new_keys(self.weight_shares, links)
        if self.postures is not None:
            postures = {}
            for name, coordinates in self.postures.items():
                postures[name] = with_new_keys(coordinates, joints)
            self.postures = postures
        if self.home_posture is not None:
            self.home_posture = with_new_keys(self.home_posture, joints)
        if self.home is not None:
            self.home = with_new_keys(self.home, joints)

    def immobile_links(self, known_links: Collection[str]) -> frozenset[str] | None:
        """Return the known links that cannot move in the world; None if the format cannot state it.

        They are the links of `fixed_to_world`, and all links that fixed joints connect with them. A link named "world"
        is not among them: some formats have it as a link of its own, MJCF has it as the world itself.
        """
        if self.fixed_to_world is None:
            return None
        fixed_pairs = []
        for joint in self.joints_between({WORLD, *known_links}):
            if joint.kind == "fixed":
                fixed_pairs.append({joint.parent, joint.child})
        immobile_links = {WORLD, *self.fixed_to_world}
        has_grown = True
        while has_grown:
            has_grown = False
            for pair in fixed_pairs:
                if pair & immobile_links and not pair <= immobile_links:
                    immobile_links |= pair
                    has_grown = True
        return frozenset(immobile_links & set(known_links)) - {WORLD}

    def joints_between(self, known_links: Collection[str]) -> list[FileJoint]:
        """Return the joints between known links, with the parts of a joint as one, as `merged_joints`."""
        return merged_joints(self.joints, known_links)

    def added_joints(self, known_links: Collection[str]) -> list[FileJoint]:
        """Return the movable joints of unknown links that are heavier than a helper and have no other joint.

        `joints_between` leaves out the joints of all links with one joint, because some formats need helpers: links
        almost without mass that only split a joint or close a loop. A heavier link is none, so that its joint is an
        addition.
        """
        added: list[FileJoint] = []
        for joint in self._heavy_end_joints(known_links).values():
            if joint.names and joint.kind not in ("", "fixed"):
                added.append(joint)
        return added

    def load_links(self, known_links: Collection[str]) -> list[str]:
        """Return the unknown links that are a load: fixed to one other link, with a mass, or without any joint.

        Where a format divides a link, the masses of its parts are those of no link of the others either.
        """
        loads: list[str] = []
        if self.complete and self.joints:
            for link in self.links:
                if link not in known_links and not joints_of(link, self.joints):
                    loads.append(link)
        for link, joint in self._heavy_end_joints(known_links).items():
            if joint.kind == "fixed":
                loads.append(link)
        return loads

    def _heavy_end_joints(self, known_links: Collection[str]) -> dict[str, FileJoint]:
        """Return {link: its joint} of the unknown links that are heavier than a helper and have one joint."""
        total_mass = 0.0
        for mass in self.masses.values():
            total_mass += mass.mass
        end_joints: dict[str, FileJoint] = {}
        for link, mass in self.masses.items():
            if link in known_links or not mass.mass > _HELPER_SHARE * total_mass:
                continue
            joints = joints_of(link, self.joints)
            if len(joints) == 1:
                end_joints[link] = joints[0]
        return end_joints
