using System;
using UnityEngine;

namespace Twin.Player
{
    /// <summary>A model whose kinematics run on the device: grab the tool, a link or a joint without a server.</summary>
    /// <remarks>Set <see cref="Kinematics"/> to an object of the class that `twin export` wrote for the robot, for
    /// example `new Twin.Robots.SilsKinematics()`. Arguments of the grabs are in Unity's world.</remarks>
    [AddComponentMenu("Twin/Device Robot")]
    public sealed class DeviceRobot : MonoBehaviour
    {
        [Tooltip("The imported robot; empty: this object.")]
        public Transform model;

        public Convention convention;

        [Tooltip("Maximum number of steps of a grab in a frame.")]
        public int steps = 4;

        private readonly double[] onLink = new double[3];
        private readonly double[] target = new double[3];
        private readonly double[] pose = new double[12];
        private KinematicGrab grab;
        private int link = -1;
        private bool tool;
        private Vector3 inHand;
        private Quaternion turnInHand;

        public IRobotKinematics Kinematics { get; private set; }

        public LinkBinding Binding { get; private set; }

        public bool IsHolding
        {
            get { return tool || link >= 0; }
        }

        /// <summary>Why the last grab did not reach its target, or "".</summary>
        public string Reason
        {
            get { return grab == null ? "no kinematics" : grab.Reason; }
        }

        /// <summary>Use these kinematics for the model, and show the posture "home".</summary>
        /// <exception cref="ArgumentException">A link of the robot is missing in the model.</exception>
        public void Use(IRobotKinematics kinematics)
        {
            Binding = new LinkBinding(model != null ? model : transform, kinematics.Links, convention);
            Kinematics = kinematics;
            grab = new KinematicGrab(kinematics);
            kinematics.Reset();
            Show();
        }

        /// <summary>Place every link at its present pose.</summary>
        public void Show()
        {
            Binding.Apply(LinkPose);
        }

        /// <summary>Grab the link of a Transform at a point in Unity's world; false if it is no link.</summary>
        public bool BeginLink(Transform part, Vector3 at)
        {
            End();
            link = Binding == null ? -1 : Binding.LinkOf(part);
            if (link < 0)
            {
                return false;
            }

            Vector3 local = Frames.FromUnity(Binding.Link(link).InverseTransformPoint(at), convention);
            Write(local, onLink);
            return true;
        }

        /// <summary>Grab the tool with a hand at a pose in Unity's world; false without kinematics.</summary>
        public bool BeginTool(Vector3 hand, Quaternion turn)
        {
            End();
            if (Binding == null)
            {
                return false;
            }

            Vector3 position;
            Quaternion rotation;
            Pose(Kinematics.Tool, 0, out position, out rotation);
            Binding.ToWorld(ref position, ref rotation);
            Quaternion back = Quaternion.Inverse(turn);
            inHand = back * (position - hand);
            turnInHand = back * rotation;
            tool = true;
            return true;
        }

        /// <summary>Move what is grabbed to the hand; return the remaining distance in m of the robot.</summary>
        public double Move(Vector3 hand, Quaternion turn)
        {
            if (!IsHolding)
            {
                return 0.0;
            }

            Vector3 position = tool ? hand + turn * inHand : hand;
            Quaternion rotation = tool ? turn * turnInHand : turn;
            Binding.FromWorld(ref position, ref rotation);
            double left;
            if (tool)
            {
                WritePose(position, rotation, pose);
                left = grab.Tool(pose, steps);
            }
            else
            {
                Write(position, target);
                left = grab.Point(link, onLink, target, steps);
            }

            Show();
            return left;
        }

        /// <summary>Move an active joint towards a value in m or rad; return the remaining difference.</summary>
        public double MoveJoint(int joint, double value)
        {
            double left = grab.Joint(joint, value, steps);
            Show();
            return left;
        }

        /// <summary>Change a distance of two joints in m; false if the loops do not close then.</summary>
        public bool SetDistance(int index, double metres)
        {
            bool good = Kinematics.SetDistance(index, metres);
            Show();
            return good;
        }

        /// <summary>Undo all changes of the design, and show the posture "home".</summary>
        public void ResetDesign()
        {
            Kinematics.Reset();
            Show();
        }

        /// <summary>Release what is grabbed.</summary>
        public void End()
        {
            tool = false;
            link = -1;
        }

        private void LinkPose(int index, out Vector3 position, out Quaternion rotation)
        {
            Pose(Kinematics.Poses, 12 * index, out position, out rotation);
        }

        private static void Pose(double[] rows, int at, out Vector3 position, out Quaternion rotation)
        {
            position = new Vector3((float)rows[at + 3], (float)rows[at + 7], (float)rows[at + 11]);
            rotation = Rotation(rows, at);
        }

        // The quaternion of a rotation matrix, from the largest of its four components.
        private static Quaternion Rotation(double[] m, int at)
        {
            double xx = m[at], yy = m[at + 5], zz = m[at + 10];
            double w = 1.0 + xx + yy + zz;
            double x = 1.0 + xx - yy - zz;
            double y = 1.0 - xx + yy - zz;
            double z = 1.0 - xx - yy + zz;
            double wx = m[at + 9] - m[at + 6], wy = m[at + 2] - m[at + 8], wz = m[at + 4] - m[at + 1];
            double xy = m[at + 4] + m[at + 1], xz = m[at + 2] + m[at + 8], yz = m[at + 9] + m[at + 6];
            double largest = Math.Max(Math.Max(w, x), Math.Max(y, z));
            if (largest == w)
            {
                return Unit(wx, wy, wz, w);
            }

            if (largest == x)
            {
                return Unit(x, xy, xz, wx);
            }

            return largest == y ? Unit(xy, y, yz, wy) : Unit(xz, yz, z, wz);
        }

        private static Quaternion Unit(double x, double y, double z, double w)
        {
            double length = Math.Sqrt(x * x + y * y + z * z + w * w);
            return new Quaternion((float)(x / length), (float)(y / length), (float)(z / length), (float)(w / length));
        }

        private static void Write(Vector3 p, double[] to)
        {
            to[0] = p.x;
            to[1] = p.y;
            to[2] = p.z;
        }

        private static void WritePose(Vector3 p, Quaternion q, double[] to)
        {
            double length = Math.Sqrt(q.x * (double)q.x + q.y * (double)q.y + q.z * (double)q.z + q.w * (double)q.w);
            double x = q.x / length, y = q.y / length, z = q.z / length, w = q.w / length;
            to[0] = 1 - 2 * (y * y + z * z);
            to[1] = 2 * (x * y - w * z);
            to[2] = 2 * (x * z + w * y);
            to[4] = 2 * (x * y + w * z);
            to[5] = 1 - 2 * (x * x + z * z);
            to[6] = 2 * (y * z - w * x);
            to[8] = 2 * (x * z - w * y);
            to[9] = 2 * (y * z + w * x);
            to[10] = 1 - 2 * (x * x + y * y);
            to[3] = p.x;
            to[7] = p.y;
            to[11] = p.z;
        }
    }
}
