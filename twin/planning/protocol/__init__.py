"""A medical protocol, read from TOML: waypoints, and phases that move the robot from one waypoint to the next.

A protocol names the frame that it moves (`tool`, `endoscope_tip`, ...). Positions are positions of the origin of this
frame in base. Angles are always the angles of the `tool` frame, about the axes named by `rotation`, in this order
("zyx": R_base_tool = Rz(psi) Ry(theta) Rx(phi)). A table of poses in a paper can therefore be copied, whatever the
reference point of its positions. The shaft passes through the origin of the moved frame. The direction of the shaft is
`shaft_axis`, a vector in the moved frame that points from the platform to the tip. The depth is the distance along the
shaft from the RCM to the origin of the moved frame.

Each phase type is defined in one file in `phases`.

If there are several trocars (`[trocars_mm]`), each phase of type insertion, pivot, circle or retraction names one of
them. An insertion begins at its trocar and registers it as the RCM. If a protocol begins with a pivot, circle or
retraction, the instrument is in the patient from the start: the shaft already passes through the named trocar, and this
phase registers it as the RCM.
"""

from twin.planning.protocol.course import RcmMode as RcmMode
from twin.planning.protocol.course import RotationOrder as RotationOrder
from twin.planning.protocol.load import load_protocol as load_protocol
from twin.planning.protocol.model import DIRECTIONS as DIRECTIONS
from twin.planning.protocol.model import SOLVERS as SOLVERS
from twin.planning.protocol.model import Direction as Direction
from twin.planning.protocol.model import Limits as Limits
from twin.planning.protocol.model import PatientPlace as PatientPlace
from twin.planning.protocol.model import Protocol as Protocol
from twin.planning.protocol.model import Solver as Solver
from twin.planning.protocol.model import TrajectoryTolerances as TrajectoryTolerances
from twin.planning.protocol.phase import Phase as Phase
from twin.planning.protocol.phase import trocar_of as trocar_of
from twin.planning.protocol.phases.auxiliary import Auxiliary as Auxiliary
from twin.planning.protocol.phases.circle import Circle as Circle
from twin.planning.protocol.phases.free import Free as Free
from twin.planning.protocol.phases.home import Home as Home
from twin.planning.protocol.phases.insertion import Insertion as Insertion
from twin.planning.protocol.phases.joints import Joints as Joints
from twin.planning.protocol.phases.pivot import Pivot as Pivot
from twin.planning.protocol.phases.positioning import Positioning as Positioning
from twin.planning.protocol.phases.retraction import Retraction as Retraction
from twin.planning.protocol.phases.samples import Samples as Samples
from twin.planning.protocol.tables import ProtocolTable as ProtocolTable
from twin.planning.protocol.waypoint import Waypoint as Waypoint
