using System;
using System.Runtime.InteropServices;
using UnityEngine;

namespace Twin.Player
{
    /// <summary>A frame of the stream of `twin serve`: the poses of all links of one robot at one time and, in a scene,
    /// the vertices of deformable bodies (fields).</summary>
    /// <remarks>Little endian. A robot: u32 "TWN1", u32 sequence, f64 server time, f64 clip time, u16 links,
    /// u16 joints, u32 flags, f32 poses (links * 7), f32 active joints, f32 ghost (7) if flag 1. A scene: u32 "TWN2",
    /// u32 sequence, f64 server time, f64 time, u16 robots, u16 fields, u32 flags; then each robot as above; then
    /// each field: u32 vertices, f32 low (3), f32 step (3), u16 (vertices * 3), padded to four bytes.</remarks>
    public sealed class StreamFrame
    {
        public const uint Magic = 0x314E5754; // "TWN1"
        public const uint SceneMagic = 0x324E5754; // "TWN2"
        public const int HeaderSize = 32;
        private const int BoxSize = 28;
        private const int LargestField = 1 << 16;
        public const uint FlagGhost = 1;
        public const uint FlagPlaying = 2;
        public const uint FlagRefused = 4;
        public const uint FlagHeld = 8;

        /// <summary>Sequence number, modulo 2^32.</summary>
        public uint Sequence;

        /// <summary>Time in s of the server's clock.</summary>
        public double ServerTime;

        /// <summary>Time in s within the protocol.</summary>
        public double ClipTime;

        public uint Flags;

        /// <summary>Pose of every link in the robot's world: x y z qx qy qz qw.</summary>
        public float[] Poses = new float[0];

        /// <summary>Values of the active joints in m or rad.</summary>
        public float[] Joints = new float[0];

        /// <summary>Pose of the tool according to the equations; zeros without flag 1.</summary>
        public readonly float[] Ghost = new float[Track.PoseSize];

        /// <summary>Vertices x y z of each field in the scene's world, in the order of scene.json; empty for a single
        /// robot. A field without vertices is unknown at this time.</summary>
        public float[][] Fields = new float[0][];

        /// <summary>Time of arrival in s of this machine's clock.</summary>
        public double ReceivedAt;

        public int LinkCount
        {
            get { return Poses.Length / Track.PoseSize; }
        }

        public bool Has(uint flag)
        {
            return (Flags & flag) != 0;
        }

        /// <summary>Return the pose of a link in the robot's world.</summary>
        public void Link(int link, out Vector3 position, out Quaternion rotation)
        {
            Track.ReadPose(Poses, link * Track.PoseSize, out position, out rotation);
        }

        /// <summary>Return whether a sequence number is after another, including overflow to 0.</summary>
        public static bool IsNewer(uint sequence, uint than)
        {
            return unchecked((int)(sequence - than)) > 0;
        }

        /// <summary>Parse a message into this frame; false if it is invalid: the frame is then unchanged.</summary>
        /// <param name="data">The message.</param>
        /// <param name="count">Number of bytes of the message; the array may be longer.</param>
        /// <param name="fault">The fault of the message, or "".</param>
        /// <param name="robot">Index of the robot of a scene, in the order of scene.json.</param>
        public bool Read(byte[] data, int count, out string fault, int robot = 0)
        {
            if (count < HeaderSize)
            {
                fault = "frame of " + count + " bytes, expected at least " + HeaderSize;
                return false;
            }

            if (U32(data, 0) != SceneMagic)
            {
                if (!Whole(data, 0, count, true, out fault))
                {
                    return false;
                }

                Fields = new float[0][];
                Take(data, 0);
                return true;
            }

            return Scene(data, count, robot, out fault);
        }

        private bool Scene(byte[] data, int count, int robot, out string fault)
        {
            int robots = U16(data, 24);
            int fields = U16(data, 26);
            int at = HeaderSize;
            int mine = -1;
            for (int i = 0; i < robots; i++)
            {
                if (!Whole(data, at, count - at, false, out fault))
                {
                    return false;
                }

                mine = i == robot ? at : mine;
                at += Size(data, at);
            }

            if (mine < 0)
            {
                fault = "frame of a scene with " + robots + " robots; robot " + robot + " does not exist";
                return false;
            }

            var vertices = new float[fields][];
            for (int i = 0; i < fields; i++)
            {
                if (!Field(data, count, ref at, out vertices[i]))
                {
                    fault = "frame of " + count + " bytes; field " + i + " is truncated";
                    return false;
                }
            }

            if (at != count)
            {
                fault = "frame of " + count + " bytes; its parts have " + at;
                return false;
            }

            Fields = vertices;
            Take(data, mine);
            fault = "";
            return true;
        }

        private static int Size(byte[] data, int at)
        {
            bool ghost = (U32(data, at + 28) & FlagGhost) != 0;
            int numbers = U16(data, at + 24) * Track.PoseSize + U16(data, at + 26) + (ghost ? Track.PoseSize : 0);
            return HeaderSize + 4 * numbers;
        }

        // Return whether a complete robot frame with finite numbers begins here.
        private static bool Whole(byte[] data, int begin, int count, bool alone, out string fault)
        {
            if (count < HeaderSize || U32(data, begin) != Magic)
            {
                fault = count < HeaderSize
                    ? "the frame of a robot is truncated in its header"
                    : "frame begins with 0x" + U32(data, begin).ToString("x8") + ", not with TWN1";
                return false;
            }

            int size = Size(data, begin);
            count = alone ? count : Math.Min(count, size);
            if (count != size)
            {
                fault = "frame of " + count + " bytes; " + U16(data, begin + 24) + " links and "
                    + U16(data, begin + 26) + " joints require " + size;
                return false;
            }

            for (int at = begin + HeaderSize; at < begin + size; at += 4)
            {
                if ((U32(data, at) & 0x7F800000) == 0x7F800000)
                {
                    fault = "frame with a number that is not finite, at byte " + at;
                    return false;
                }
            }

            fault = "";
            return true;
        }

        private static bool Field(byte[] data, int count, ref int at, out float[] vertices)
        {
            vertices = null;
            if (count - at < BoxSize)
            {
                return false;
            }

            uint number = U32(data, at);
            if (number > LargestField || count - at - BoxSize < (6 * (int)number + 3) / 4 * 4)
            {
                return false;
            }

            var box = new float[6];
            int next = Floats(data, at + 4, box);
            vertices = new float[3 * (int)number];
            for (int i = 0; i < vertices.Length; i++)
            {
                vertices[i] = box[i % 3] + box[3 + i % 3] * U16(data, next + 2 * i);
            }

            at = next + (2 * vertices.Length + 3) / 4 * 4;
            return true;
        }

        // Copy the content of a valid frame.
        private void Take(byte[] data, int begin)
        {
            int links = U16(data, begin + 24);
            int joints = U16(data, begin + 26);
            Sequence = U32(data, begin + 4);
            ServerTime = F64(data, begin + 8);
            ClipTime = F64(data, begin + 16);
            Flags = U32(data, begin + 28);
            if (Poses.Length != links * Track.PoseSize)
            {
                Poses = new float[links * Track.PoseSize];
            }

            if (Joints.Length != joints)
            {
                Joints = new float[joints];
            }

            int next = Floats(data, begin + HeaderSize, Poses);
            next = Floats(data, next, Joints);
            if (Has(FlagGhost))
            {
                Floats(data, next, Ghost);
            }
            else
            {
                Array.Clear(Ghost, 0, Ghost.Length);
            }
        }

        private static int Floats(byte[] data, int at, float[] into)
        {
            var bits = new Bits();
            for (int i = 0; i < into.Length; i++)
            {
                bits.Whole = U32(data, at);
                into[i] = bits.Number;
                at += 4;
            }

            return at;
        }

        private static int U16(byte[] data, int at)
        {
            return data[at] | data[at + 1] << 8;
        }

        private static uint U32(byte[] data, int at)
        {
            return (uint)(data[at] | data[at + 1] << 8 | data[at + 2] << 16 | data[at + 3] << 24);
        }

        private static double F64(byte[] data, int at)
        {
            ulong bits = U32(data, at) | (ulong)U32(data, at + 4) << 32;
            return BitConverter.Int64BitsToDouble(unchecked((long)bits));
        }

        // A float and its bits as an integer, which does not depend on the byte order of the machine.
        [StructLayout(LayoutKind.Explicit)]
        private struct Bits
        {
            [FieldOffset(0)]
            public uint Whole;

            [FieldOffset(0)]
            public float Number;
        }
    }
}
