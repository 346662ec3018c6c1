using System;
using System.Collections.Generic;
using UnityEngine;

namespace Twin.Player
{
    /// <summary>What carries a joint in Unity, and which way it counts.</summary>
    [Serializable]
    public sealed class DrivenJoint
    {
        [Tooltip("Name of the joint in the track.")]
        public string joint = "";

        [Tooltip("The body that this joint moves. Leave empty to drive a ConfigurableJoint.")]
        public ArticulationBody body;

        [Tooltip("Used when there is no ArticulationBody.")]
        public ConfigurableJoint configurable;

        [Tooltip("+1 or -1. A mirror turns the sense of a rotation: an axis that was mirrored like any direction "
            + "needs -1 for a revolute joint. URDF-Importer turns that axis round by itself: +1.")]
        public float sign = 1f;

        [Tooltip("Added to the robot's value before the sign, in m or rad: where Unity's zero is elsewhere.")]
        public float offset;
    }

    /// <summary>Sends joint values to physics: drive targets of ArticulationBody or ConfigurableJoint.</summary>
    /// <remarks>An articulation is a tree. The loops of a parallel robot cannot be part of it: play such a robot with
    /// <see cref="TrackPlayer"/>, which needs no physics, or close each loop with a ConfigurableJoint of your own and
    /// drive the active joints only. Targets are degrees for revolute joints and metres for prismatic ones, while
    /// `jointPosition` is in radians.</remarks>
    [AddComponentMenu("Twin/Articulation Driver")]
    public sealed class ArticulationDriver : MonoBehaviour
    {
        [Tooltip("Drives from this player in FixedUpdate; leave empty to call Apply yourself.")]
        public TrackPlayer player;

        public List<DrivenJoint> driven = new List<DrivenJoint>();

        [Tooltip("Hold targets within the limits of the track.")]
        public bool clamp = true;

        private Track checkedFor;
        private int checkedCount;

        /// <summary>Return the joints of a track that are active and that nothing here drives.</summary>
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
        /// <exception cref="ArgumentException">An entry names no joint of the track, has nothing to drive, or drives
        /// a body of another type.</exception>
        public void Apply(Track track, double time)
        {
            Check(track);
            foreach (DrivenJoint entry in driven)
            {
                int joint = track.JointIndex(entry.joint);
                Set(entry, Target(track, joint, track.Joint(time, joint), entry), track.IsAngle(joint));
            }
        }

        /// <summary>Return the target of a joint as Unity takes it: degrees or metres, with its sign.</summary>
        public float Target(Track track, int joint, float value, DrivenJoint entry)
        {
            if (clamp)
            {
                value = Mathf.Clamp(value, track.joint_lower[joint], track.joint_upper[joint]);
            }

            float inUnity = entry.sign * (value + entry.offset);
            return track.IsAngle(joint) ? inUnity * Mathf.Rad2Deg : inUnity;
        }

        /// <summary>Return the value (m or rad) that an ArticulationBody has reached, in the robot's sense.</summary>
        public static float Reached(DrivenJoint entry)
        {
            return Value(entry, entry.body.jointPosition[0]);
        }

        /// <summary>Return the value (m or rad) in the robot's sense of a position (m or rad) in Unity's.</summary>
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
                    throw new ArgumentException("ArticulationDriver: joint '" + entry.joint + "' drives nothing");
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
                        + track.joint_types[joint] + ", its body is a " + entry.body.jointType);
                }
            }

            checkedFor = track;
            checkedCount = driven.Count;
        }

        private static void Set(DrivenJoint entry, float target, bool angle)
        {
            if (entry.body != null)
            {
                ArticulationDrive drive = entry.body.xDrive; // a struct: changing the property's copy does nothing
                drive.target = target;
                entry.body.xDrive = drive;
            }
            else if (angle)
            {
                // Both targets of a ConfigurableJoint say where its connected body goes: the opposite way.
                entry.configurable.targetRotation = Quaternion.AngleAxis(-target, Vector3.right);
            }
            else
            {
                entry.configurable.targetPosition = new Vector3(-target, 0f, 0f);
            }
        }
    }
}
