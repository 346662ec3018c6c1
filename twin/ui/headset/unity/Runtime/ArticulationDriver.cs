using System;
using System.Collections.Generic;
using UnityEngine;

namespace Twin.Player
{
    /// <summary>A joint of the track, and the physics joint of Unity that it drives.</summary>
    [Serializable]
    public sealed class DrivenJoint
    {
        [Tooltip("Name of the joint in the track.")]
        public string joint = "";

        [Tooltip("The body that this joint moves. Leave empty to drive a ConfigurableJoint.")]
        public ArticulationBody body;

        [Tooltip("Used when there is no ArticulationBody.")]
        public ConfigurableJoint configurable;

        [Tooltip("+1 or -1. Mirroring reverses rotations: a revolute joint whose axis was mirrored like a direction "
            + "needs -1. URDF-Importer already reverses the axis of revolute joints: +1.")]
        public float sign = 1f;

        [Tooltip("Offset in m or rad, added to the robot's value before the sign, if Unity's zero position differs.")]
        public float offset;
    }

    /// <summary>Sends joint values to physics: drive targets of ArticulationBody or ConfigurableJoint.</summary>
    /// <remarks>An articulation is a tree, so it cannot contain the loops of a parallel robot. Play such a robot with
    /// <see cref="TrackPlayer"/>, which needs no physics, or add a ConfigurableJoint that closes each loop and drive
    /// only the active joints. Drive targets are in degrees for revolute joints and in metres for prismatic joints;
    /// `jointPosition` is in radians.</remarks>
    [AddComponentMenu("Twin/Articulation Driver")]
    public sealed class ArticulationDriver : MonoBehaviour
    {
        [Tooltip("Player whose motion is applied in FixedUpdate; leave empty to call Apply yourself.")]
        public TrackPlayer player;

        public List<DrivenJoint> driven = new List<DrivenJoint>();

        [Tooltip("Clamp targets to the joint limits in the track.")]
        public bool clamp = true;

        private Track checkedFor;
        private int checkedCount;

        /// <summary>Return the active joints of a track that this component does not drive.</summary>
        public List<string> Undriven(Track track)
        {
            var open = new List<string>();
            for (int j = 0; j < track.joints.Length; j++)
            {
                string name = track.joints[j];
                if (track.joint_active[j] == 1 && !driven.Exists(d => d.joint == name))
                {
                    open.Add(name);
                }
            }

            return open;
        }

        /// <summary>Set every target to the motion at a time (s).</summary>
        /// <exception cref="ArgumentException">An entry has a joint that is not in the track, no body and no
        /// ConfigurableJoint, or a body of another joint type.</exception>
        public void Apply(Track track, double time)
        {
            Check(track);
            foreach (DrivenJoint entry in driven)
            {
                int joint = track.JointIndex(entry.joint);
                Set(entry, Target(track, joint, track.Joint(time, joint), entry), track.IsAngle(joint));
            }
        }

        /// <summary>Return the drive target of a joint for Unity: in degrees or metres, with its sign.</summary>
        public float Target(Track track, int joint, float value, DrivenJoint entry)
        {
            if (clamp)
            {
                value = Mathf.Clamp(value, track.joint_lower[joint], track.joint_upper[joint]);
            }

            float inUnity = entry.sign * (value + entry.offset);
            return track.IsAngle(joint) ? inUnity * Mathf.Rad2Deg : inUnity;
        }

        /// <summary>Return the current value (m or rad) of an ArticulationBody, with the robot's sign and zero.</summary>
        public static float Reached(DrivenJoint entry)
        {
            return Value(entry, entry.body.jointPosition[0]);
        }

        /// <summary>Convert a position (m or rad) of Unity to a value (m or rad) with the robot's sign and zero.</summary>
        public static float Value(DrivenJoint entry, float inUnity)
        {
            return entry.sign * inUnity - entry.offset;
        }

        private void FixedUpdate()
        {
            if (player != null && player.Track != null)
            {
                Apply(player.Track, player.Time);
            }
        }

        private void Check(Track track)
        {
            if (ReferenceEquals(checkedFor, track) && checkedCount == driven.Count)
            {
                return;
            }

            foreach (DrivenJoint entry in driven)
            {
                int joint = track.JointIndex(entry.joint);
                if (joint < 0)
                {
                    throw new ArgumentException("ArticulationDriver: the track has no joint '" + entry.joint
                        + "'; it has " + string.Join(", ", track.joints));
                }

                if (entry.body == null && entry.configurable == null)
                {
                    throw new ArgumentException("ArticulationDriver: joint '" + entry.joint + "'"
                        + " has neither a body nor a ConfigurableJoint");
                }

                if (entry.sign != 1f && entry.sign != -1f)
                {
                    throw new ArgumentException("ArticulationDriver: joint '" + entry.joint + "' has sign "
                        + entry.sign + ", expected 1 or -1");
                }

                var type = track.IsAngle(joint)
                    ? ArticulationJointType.RevoluteJoint
                    : ArticulationJointType.PrismaticJoint;
                if (entry.body != null && entry.body.jointType != type)
                {
                    throw new ArgumentException("ArticulationDriver: joint '" + entry.joint + "' is "
                        + track.joint_types[joint] + ", but its body is a " + entry.body.jointType);
                }
            }

            checkedFor = track;
            checkedCount = driven.Count;
        }

        private static void Set(DrivenJoint entry, float target, bool angle)
        {
            if (entry.body != null)
            {
                ArticulationDrive drive = entry.body.xDrive; // a struct: the changed copy must be assigned back
                drive.target = target;
                entry.body.xDrive = drive;
            }
            else if (angle)
            {
                // The targets of a ConfigurableJoint are for its connected body, which moves in the opposite direction.
                entry.configurable.targetRotation = Quaternion.AngleAxis(-target, Vector3.right);
            }
            else
            {
                entry.configurable.targetPosition = new Vector3(-target, 0f, 0f);
            }
        }
    }
}
