using System;
using UnityEngine;

namespace Twin.Player
{
    /// <summary>Grabs and drags the robot of a stream, with any input: a hand, a controller or a mouse. The server
    /// computes the motion of the robot, and the stream shows it.</summary>
    /// <remarks>Arguments are in Unity's world; requests are in the robot's world. The tool keeps its pose relative
    /// to the hand at the grab. Only one client at a time can hold the robot; see
    /// <see cref="StreamClient.Refusal"/>.</remarks>
    [AddComponentMenu("Twin/Grab")]
    public sealed class Grab : MonoBehaviour
    {
        [Tooltip("Stream client of the robot to grab.")]
        public StreamClient stream;

        /// <summary>Sends a request: (JSON text, whether it replaces a waiting one); null: `stream`.</summary>
        public Func<string, bool, bool> Outgoing;

        private Kind held;
        private Vector3 inHand;
        private Quaternion turnInHand;

        private enum Kind
        {
            Nothing,
            Tool,
            Link,
            Joint
        }

        /// <summary>Whether this client has grabbed something; the server may have refused it.</summary>
        public bool IsHolding
        {
            get { return held != Kind.Nothing; }
        }

        /// <summary>Grab the tool with a hand at a pose in Unity's world; false if there is no stream.</summary>
        public bool BeginTool(Vector3 hand, Quaternion turn)
        {
            End();
            if (stream == null || stream.Binding == null || stream.Frame == null)
            {
                return false;
            }

            Vector3 position;
            Quaternion rotation;
            Tool(out position, out rotation);
            stream.Binding.ToWorld(ref position, ref rotation);
            Quaternion back = Quaternion.Inverse(turn);
            inHand = back * (position - hand);
            turnInHand = back * rotation;
            return Begin(Kind.Tool, Requests.GrabTool());
        }

        /// <summary>Grab a link; false if `part` does not belong to a link, or there is no stream.</summary>
        /// <param name="part">The Transform of the link, or a descendant.</param>
        /// <param name="point">The grabbed point on the link, in Unity's world.</param>
        public bool BeginLink(Transform part, Vector3 point)
        {
            End();
            if (stream == null || stream.Binding == null)
            {
                return false;
            }

            int link = stream.Binding.LinkOf(part);
            if (link < 0)
            {
                return false;
            }

            Vector3 local = stream.Binding.Link(link).InverseTransformPoint(point);
            Vector3 onLink = Frames.FromUnity(local, stream.Binding.Convention);
            return Begin(Kind.Link, Requests.GrabLink(stream.Robot.links[link], onLink));
        }

        /// <summary>Grab an active joint by its name; move it with <see cref="MoveJoint"/>.</summary>
        public bool BeginJoint(string joint)
        {
            End();
            return Begin(Kind.Joint, Requests.GrabJoint(joint));
        }

        /// <summary>Move the grabbed tool with the hand, or the grabbed point of a link to the hand.</summary>
        public bool Move(Vector3 hand, Quaternion turn)
        {
            if (held == Kind.Link)
            {
                Vector3 point = hand;
                Quaternion any = turn;
                stream.Binding.FromWorld(ref point, ref any);
                return Send(Requests.DragPoint(point), true);
            }

            if (held != Kind.Tool)
            {
                return false;
            }

            Vector3 position = hand + turn * inHand;
            Quaternion rotation = turn * turnInHand;
            stream.Binding.FromWorld(ref position, ref rotation);
            return Send(Requests.DragPose(position, Unit(rotation)), true);
        }

        /// <summary>Move the grabbed joint to a value in m or rad, with the robot's sign and zero.</summary>
        public bool MoveJoint(float value)
        {
            return held == Kind.Joint && Send(Requests.DragValue(value), true);
        }

        /// <summary>Release the robot.</summary>
        public void End()
        {
            if (held != Kind.Nothing)
            {
                held = Kind.Nothing;
                Send(Requests.Release(), false);
            }
        }

        private bool Begin(Kind kind, string request)
        {
            if (!Send(request, false))
            {
                return false;
            }

            held = kind;
            return true;
        }

        private bool Send(string json, bool replaces)
        {
            if (Outgoing != null)
            {
                return Outgoing(json, replaces);
            }

            return stream != null && stream.Send(json, replaces);
        }

        // Pose of the tool in the robot's world: pose of its link, then pose of the tool on the link.
        private void Tool(out Vector3 position, out Quaternion rotation)
        {
            Vector3 onLink;
            Quaternion turned;
            ToolDescription tool = stream.Robot.tool;
            stream.Frame.Link(Array.IndexOf(stream.Robot.links, tool.link), out position, out rotation);
            Track.ReadPose(tool.T_link_tool, 0, out onLink, out turned);
            position = position + rotation * onLink;
            rotation = rotation * turned;
        }

        private static Quaternion Unit(Quaternion q)
        {
            float length = Mathf.Sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w);
            return new Quaternion(q.x / length, q.y / length, q.z / length, q.w / length);
        }

        private void OnDisable()
        {
            End();
        }
    }
}
