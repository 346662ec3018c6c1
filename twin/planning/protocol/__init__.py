"""A medical protocol: waypoints, and the phases that lead through them, read from TOML.

A protocol names the frame that it moves (`tool`, `endoscope_tip`, ...). Positions are those of the
origin of this frame in base. Angles are always those of the `tool` frame, about the axes that
`rotation` names, one after the other ("zyx": R_base_tool = Rz(psi) Ry(theta) Rx(phi)), so that a table
of poses from a paper can be copied whichever point it speaks of.
The shaft runs through the origin of the moved frame along `shaft_axis`, which is given in that frame
and points from the platform to the tip. Depth is counted along the shaft from the RCM to that origin.

Phases:
    positioning   straight to a waypoint, position and angles linear in s; outside the patient
    joints        by the driven joints, each at the same share of its way; the tool follows the mechanism
    auxiliary     joints that do not move the tool (a jaw) to their values; the tool stands still
    insertion     straight along the shaft by a depth; registers the RCM where it starts
    pivot         about the RCM: "enforced" goes to angles and a depth, the tip follows from them;
                  "monitored" goes to a waypoint as it stands, and the missed RCM is reported
    circle        full circles of the tip; about the RCM if there is one, without spin, else with the attitude kept
    retraction    straight back along the shaft to a depth; at 0 the RCM is given up
    home          to the home waypoint: positioning, or by the joints if it holds joint values

Of several trocars (`[trocars_mm]`) insertion, pivot, circle and retraction name theirs. An insertion begins there; the
shaft of the others passes it, which registers it as the RCM if none is: the instrument is in the patient already.
"""

from twin.planning.protocol.load import load_protocol as load_protocol
from twin.planning.protocol.model import DIRECTIONS as DIRECTIONS
from twin.planning.protocol.model import Auxiliary as Auxiliary
from twin.planning.protocol.model import Circle as Circle
from twin.planning.protocol.model import Direction as Direction
from twin.planning.protocol.model import Home as Home
from twin.planning.protocol.model import Insertion as Insertion
from twin.planning.protocol.model import Joints as Joints
from twin.planning.protocol.model import Limits as Limits
from twin.planning.protocol.model import PatientPlace as PatientPlace
from twin.planning.protocol.model import Phase as Phase
from twin.planning.protocol.model import PhaseType as PhaseType
from twin.planning.protocol.model import Pivot as Pivot
from twin.planning.protocol.model import Positioning as Positioning
from twin.planning.protocol.model import Protocol as Protocol
from twin.planning.protocol.model import RcmMode as RcmMode
from twin.planning.protocol.model import Retraction as Retraction
from twin.planning.protocol.model import RotationOrder as RotationOrder
from twin.planning.protocol.model import Tolerances as Tolerances
from twin.planning.protocol.model import Waypoint as Waypoint
from twin.planning.protocol.model import trocar_of as trocar_of
from twin.planning.protocol.tables import ProtocolTable as ProtocolTable
