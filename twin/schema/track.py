"""tracks/<protocol>.json: a motion as plain flat arrays, for Unity's JsonUtility and everyone else."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from twin.schema.tables import Identifier, Table

Flag = Literal[0, 1]


class Track(Table):
    """A motion at keys: link poses and joint values, frame after frame; SI, z up, right-handed.

    One object, flat arrays, no dictionaries, no nulls. A pose is seven numbers, x y z in m and a unit quaternion
    x y z w; signs of quaternions never jump from key to key.
    """

    schema_: Annotated[Literal["twin-track"], Field(alias="schema")]
    version: Literal[1]
    robot: str
    protocol: str
    title: str
    model_hash: Annotated[str, Field(pattern="^sha256:[0-9a-f]{64}$", description="of the robot it was made for")]
    frame: Literal["z-up right-handed"]
    length_unit: Literal["m"]
    angle_unit: Literal["rad"]
    quaternion_order: Literal["xyzw"]
    rate: Annotated[float, Field(gt=0, description="keys a second; the last interval may be shorter")]
    frames: Annotated[int, Field(ge=1, description="how many keys")]
    times: Annotated[list[float], Field(description="s, frames")]
    links: Annotated[list[Identifier], Field(description="names of the links, in the order of poses")]
    poses: Annotated[list[float], Field(description="frames x links x 7, of the link in the world (the base frame)")]
    joints: Annotated[
        list[Identifier],
        Field(
            description="joints with one coordinate, passive ones too; then those of the URDF for which a ball stands: "
            "<ball>_x, _y, _z, turns about x, y, z in this order, zero at home"
        ),
    ]
    joint_types: list[Literal["prismatic", "revolute"]]
    joint_active: Annotated[list[Flag], Field(description="1: driven by an actuator")]
    joint_lower: Annotated[list[float], Field(description="m or rad; -1e30: no limit")]
    joint_upper: Annotated[list[float], Field(description="m or rad; 1e30: no limit")]
    positions: Annotated[list[float], Field(description="frames x joints, m or rad")]
    phases: Annotated[list[Identifier], Field(description="names of the phases, in order")]
    phase_start: Annotated[list[float], Field(description="s")]
    phase_end: Annotated[list[float], Field(description="s")]
    phase_has_rcm: Annotated[list[Flag], Field(description="1: a remote centre of motion is registered")]
    phase_rcm_enforced: Annotated[
        list[Flag],
        Field(
            description="1: the shaft, z of a named frame of the tool's link, goes through it; 0: it is only watched"
        ),
    ]
    phase_rcm: Annotated[list[float], Field(description="phases x 3, m, in the world; zeros without one")]
    tool_link: Identifier
    tool_frame: Annotated[list[float], Field(min_length=7, max_length=7, description="pose of the tool in its link")]
    moved_frame: Annotated[Identifier, Field(description="the named frame that the protocol moves")]
    frame_names: list[Identifier]
    frame_links: list[Identifier]
    frames_local: Annotated[list[float], Field(description="frame_names x 7, pose of the frame in its link")]
    rcm: Annotated[list[float], Field(max_length=3, description="the first remote centre of motion or trocar, or []")]
    between_position: Annotated[float, Field(description="m, worst point of any link between keys, drawn linearly")]
    between_rotation: Annotated[float, Field(description="rad, worst rotation of any link between keys")]
    joint_gap: Annotated[float, Field(description="m, by which a joint opens between keys")]
    assumed: Annotated[list[str], Field(description="numbers that nobody has published, with reason")]
