using System;
using UnityEngine;

namespace Twin.Player
{
    /// <summary>One protocol of one robot, written by `twin export`: joint values and link poses at keys.</summary>
    /// <remarks>The fields have the names of the JSON file (schema "twin-track", version 1), as JsonUtility requires.
    /// All values are in the robot's world: right-handed, z up, m, rad, quaternions x y z w.</remarks>
    [Serializable]
    public sealed class Track
    {
        public const string Schema = "twin-track";
        public const int Version = 1;

        /// <summary>Count of numbers of a pose: x y z qx qy qz qw.</summary>
        public const int PoseSize = 7;

        public string schema = "";
        public int version;
        public string robot = "";
        public string protocol = "";
        public string title = "";
        public string model_hash = "";
        public string frame = "";
        public string length_unit = "";
        public string angle_unit = "";
        public string quaternion_order = "";
        public double rate;
        public int frames;
        public double[] times = new double[0];
        public string[] links = new string[0];
        public float[] poses = new float[0];
        public string[] joints = new string[0];
        public string[] joint_types = new string[0];
        public int[] joint_active = new int[0];
        public float[] joint_lower = new float[0];
        public float[] joint_upper = new float[0];
        public float[] positions = new float[0];
        public string[] phases = new string[0];
        public double[] phase_start = new double[0];
        public double[] phase_end = new double[0];
        public int[] phase_has_rcm = new int[0];
        public int[] phase_rcm_enforced = new int[0];
        public float[] phase_rcm = new float[0];
        public string tool_link = "";
        public float[] tool_frame = new float[0];
        public string moved_frame = "";
        public float[] shaft_axis = { 0, 0, 1 };
        public string[] frame_names = new string[0];
        public string[] frame_links = new string[0];
        public float[] frames_local = new float[0];
        public float[] rcm = new float[0];
        public double between_position;
        public double between_rotation;
        public double joint_gap;
        public string[] assumed = new string[0];

        /// <summary>Parse and check a track.</summary>
        /// <exception cref="FormatException">The text is not JSON, not a track, or inconsistent; the message gives
        /// the field, its value and the expected value.</exception>
        public static Track Parse(string json)
        {
            Track track;
            try
            {
                track = JsonUtility.FromJson<Track>(json);
            }
            catch (ArgumentException error)
            {
                throw new FormatException("the track is not JSON: " + error.Message, error);
            }

            if (track == null)
            {
                throw new FormatException("the track is empty: export it again with `twin export`");
            }

            TrackCheck.Require(track);
            return track;
        }

        /// <summary>Time of the last key in s.</summary>
        public double Duration
        {
            get { return times[frames - 1]; }
        }

        /// <summary>Return the index of a link by its name, or -1.</summary>
        public int LinkIndex(string name)
        {
            return Array.IndexOf(links, name);
        }

        /// <summary>Return the index of a joint by its name, or -1.</summary>
        public int JointIndex(string name)
        {
            return Array.IndexOf(joints, name);
        }

        /// <summary>Return whether a joint's values are angles in rad; else they are lengths in m.</summary>
        public bool IsAngle(int joint)
        {
            return joint_types[joint] == "revolute";
        }

        /// <summary>Find the interval between keys that contains a time.</summary>
        /// <param name="time">Time in s, which is clamped to the duration of the track.</param>
        /// <param name="first">The key at or before the time.</param>
        /// <param name="share">Elapsed fraction of the interval, 0..1; 0 at the key `first`.</param>
        public void Locate(double time, out int first, out double share)
        {
            Keys.Locate(times, time, out first, out share);
        }

        /// <summary>Return the pose of a link at a key, in the robot's world.</summary>
        public void Key(int key, int link, out Vector3 position, out Quaternion rotation)
        {
            ReadPose(poses, (key * links.Length + link) * PoseSize, out position, out rotation);
        }

        /// <summary>Return the pose of a link at a time (s), in the robot's world. Between keys, the position is
        /// interpolated linearly and the rotation spherically.</summary>
        public void Sample(double time, int link, out Vector3 position, out Quaternion rotation)
        {
            int key;
            double share;
            Locate(time, out key, out share);
            Sample(key, share, link, out position, out rotation);
        }

        /// <summary>Return the pose of a link between a key (share 0) and the next key (share 1), interpolated as
        /// above.</summary>
        public void Sample(int key, double share, int link, out Vector3 position, out Quaternion rotation)
        {
            Key(key, link, out position, out rotation);
            if (share <= 0.0)
            {
                return;
            }

            Vector3 next;
            Quaternion turned;
            Key(key + 1, link, out next, out turned);
            position = new Vector3(
                (float)(position.x + share * (next.x - position.x)),
                (float)(position.y + share * (next.y - position.y)),
                (float)(position.z + share * (next.z - position.z)));
            rotation = Frames.Slerp(rotation, turned, share);
        }

        /// <summary>Return the value of a joint (m or rad) at a time (s).</summary>
        public float Joint(double time, int joint)
        {
            int key;
            double share;
            Locate(time, out key, out share);
            float value = positions[key * joints.Length + joint];
            if (share <= 0.0)
            {
                return value;
            }

            float next = positions[(key + 1) * joints.Length + joint];
            return (float)(value + share * (next - value));
        }

        /// <summary>Return the index of the last phase that has started at a time (s), even if it has ended; -1 before the
        /// first phase.</summary>
        public int PhaseAt(double time)
        {
            int found = -1;
            for (int i = 0; i < phases.Length; i++)
            {
                if (phase_start[i] <= time)
                {
                    found = i;
                }
            }

            return found;
        }

        internal static void ReadPose(float[] from, int at, out Vector3 position, out Quaternion rotation)
        {
            position = new Vector3(from[at], from[at + 1], from[at + 2]);
            rotation = new Quaternion(from[at + 3], from[at + 4], from[at + 5], from[at + 6]);
        }
    }
}
