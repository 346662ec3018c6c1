"""Schema of tracks/<protocol>.json: a motion as flat arrays, for Unity's JsonUtility and other programs."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from twin.schema.tables import Identifier, Table

Flag = Literal[0, 1]


class Track(Table):
    """A motion: link poses and joint values at each key (sample in time), in SI units, z up, right-handed.

    The file is one JSON object with flat arrays; it contains no further objects and no nulls. A pose is seven
    numbers: position x y z in m, then unit quaternion x y z w. The signs of quaternions are continuous from key to key.
    """

    schema_: Annotated[Literal["twin-track"], Field(alias="schema")]
    version: Literal[1]
    robot: str
    protocol: str
    title: str
    model_hash: Annotated[str, Field(pattern="^sha256:[0-9a-f]{64}$", description="hash of the robot's model")]
    frame: Literal["z-up right-handed"]
    length_unit: Literal["m"]
    angle_unit: Literal["rad"]
    quaternion_order: Literal["xyzw"]
    rate: Annotated[float, Field(gt=0, description="keys per second; the last interval may be shorter")]
    frames: Annotated[int, Field(ge=1, description="number of keys")]
    times: Annotated[list[float], Field(description="time of each key in s; as many numbers as there are frames")]
    links: Annotated[list[Identifier], Field(description="names of the links, in the order of poses")]
    poses: Annotated[
        list[float], Field(description="pose of each link in the world (the base frame); frames x links x 7 numbers")
    ]
    joints: Annotated[
        list[Identifier],
        Field(
            description=(
                "joints with one coordinate, including passive joints; then the three URDF joints of each ball: "
                "<ball>_x, _y, _z, rotations about x, y, z in this order, zero at home"
            )
        ),
    ]
    joint_types: list[Literal["prismatic", "revolute"]]
    joint_active: Annotated[list[Flag], Field(description="1: driven by an actuator; 0: passive")]
    joint_lower: Annotated[list[float], Field(description="lower limit of each joint in m or rad; -1e30: no limit")]
    joint_upper: Annotated[list[float], Field(description="upper limit of each joint in m or rad; 1e30: no limit")]
    positions: Annotated[list[float], Field(description="joint values in m or rad; frames x joints numbers")]
    phases: Annotated[list[Identifier], Field(description="names of the phases, in order")]
    phase_start: Annotated[list[float], Field(description="start time of each phase in s")]
    phase_end: Annotated[list[float], Field(description="end time of each phase in s")]
    phase_has_rcm: Annotated[
        list[Flag], Field(description="1: the phase has a remote centre of motion (RCM); 0: it has none")
    ]
    phase_rcm_enforced: Annotated[
        list[Flag],
        Field(
            description=(
                "1: the shaft (shaft_axis of moved_frame, or z axis of a named frame on the tool's link) must pass "
                "through the RCM; 0: the RCM is only monitored"
            )
        ),
    ]
    phase_rcm: Annotated[
        list[float],
        Field(description="RCM of each phase in m, in the world; phases x 3 numbers; zeros if the phase has none"),
    ]
    tool_link: Identifier
    tool_frame: Annotated[list[float], Field(min_length=7, max_length=7, description="pose of the tool in its link")]
    moved_frame: Annotated[Identifier, Field(description="name of the frame that the protocol moves")]
    shaft_axis: list[float] = Field(
        default_factory=lambda: [0.0, 0.0, 1.0],
        min_length=3,
        max_length=3,
        description="unit vector along the shaft in moved_frame; the z axis if absent",
    )
    frame_names: list[Identifier]
    frame_links: list[Identifier]
    frames_local: Annotated[
        list[float], Field(description="pose of each frame of frame_names in its link; frame_names x 7 numbers")
    ]
    rcm: Annotated[
        list[float],
        Field(max_length=3, description="first remote centre of motion or trocar, in m in the world; [] without one"),
    ]
    between_position: Annotated[
        float,
        Field(description="largest position error in m of any point of a link between keys, with linear interpolation"),
    ]
    between_rotation: Annotated[float, Field(description="largest rotation error in rad of any link between keys")]
    joint_gap: Annotated[float, Field(description="largest gap in m of a joint between keys")]
    assumed: Annotated[list[str], Field(description="assumed (unpublished) numbers, each with the reason")]
