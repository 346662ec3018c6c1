using System;
using UnityEngine;

namespace Twin.Player
{
    /// <summary>Takes hold of the robot of a stream and pulls it, whatever the input is: a hand, a controller, a
    /// mouse. The server solves, and the robot follows in the stream.</summary>
    /// <remarks>All poses are those of Unity's world; they are sent in the robot's. The tool keeps the place that it
    /// had in the hand: what moves is the difference. One client holds the robot at a time; see
    /// <see cref="StreamClient.Refusal"/>.</remarks>
    [AddComponentMenu("Twin/Grab")]
    public sealed class Grab : MonoBehaviour
    {
        [Tooltip("The robot that is held.")]
        public StreamClient stream;

        /// <summary>Where requests go, and whether the last one that waits is replaced; `stream` if it is null.</summary>
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

        /// <summary>Whether something is held, as far as this client knows.</summary>
        public bool IsHolding
        {
            get { return held != Kind.Nothing; }
        }

        /// <summary>Take hold of the tool with a hand at a pose of Unity's world; false if there is no stream.</summary>
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

        /// <summary>Take hold of a link at a point of Unity's world; false if it is none or there is no stream.</summary>
        /// <param name="part">The link's Transform, or one below it.</param>
        /// <param name="point">On the link.</param>
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

        /// <summary>Take hold of an active joint by its name; lead it with <see cref="MoveJoint"/>.</summary>
        public bool BeginJoint(string joint)
        {
            End();
            return Begin(Kind.Joint, Requests.GrabJoint(joint));
        }

        /// <summary>Lead the tool with the hand, or the point of a link to where the hand is.</summary>
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

        /// <summary>Lead a joint to a value in m or rad, in the robot's sense.</summary>
        public bool MoveJoint(float value)
        {
            return held == Kind.Joint && Send(Requests.DragValue(value), true);
        }

        /// <summary>Let go.</summary>
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

        // The tool's pose in the robot's world: its link's, then its own place on the link.
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
