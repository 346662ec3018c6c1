using System;
using System.Runtime.InteropServices;
using UnityEngine;

namespace Twin.Player
{
    /// <summary>One whole frame of the stream of `twin serve`: the poses of all links at one time.</summary>
    /// <remarks>Little endian: u32 magic, u32 sequence, f64 server time, f64 clip time, u16 links, u16 joints,
    /// u32 flags, f32 poses (links * 7), f32 active joints, f32 ghost (7) if flag 1.</remarks>
    public sealed class StreamFrame
    {
        public const uint Magic = 0x314E5754; // "TWN1"
        public const int HeaderSize = 32;
        public const uint FlagGhost = 1;
        public const uint FlagPlaying = 2;
        public const uint FlagRefused = 4;
        public const uint FlagHeld = 8;

        /// <summary>Counts frames, modulo 2^32.</summary>
        public uint Sequence;

        /// <summary>Seconds of the server's clock.</summary>
        public double ServerTime;

        /// <summary>Seconds in the protocol.</summary>
        public double ClipTime;

        public uint Flags;

        /// <summary>x y z qx qy qz qw of every link, in the robot's world.</summary>
        public float[] Poses = new float[0];

        /// <summary>Active joints in m or rad.</summary>
        public float[] Joints = new float[0];

        /// <summary>The tool where the equations put it; all zero without flag 1.</summary>
        public readonly float[] Ghost = new float[Track.PoseSize];

        /// <summary>Seconds of this machine's clock at which it came.</summary>
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

        /// <summary>Return whether one sequence number comes after another, also round the end of the numbers.</summary>
        public static bool IsNewer(uint sequence, uint than)
        {
            return unchecked((int)(sequence - than)) > 0;
        }

        /// <summary>Read a message into this frame, which is unchanged if the answer is false.</summary>
        /// <param name="data">The message.</param>
        /// <param name="count">Its bytes; there may be more room.</param>
        /// <param name="fault">What is wrong with it, or "".</param>
        public bool Read(byte[] data, int count, out string fault)
        {
            if (count < HeaderSize)
            {
                fault = "frame of " + count + " bytes; a header alone has " + HeaderSize;
                return false;
            }

            if (U32(data, 0) != Magic)
            {
                fault = "frame begins with 0x" + U32(data, 0).ToString("x8") + ", not with TWN1";
                return false;
            }

            int links = U16(data, 24);
            int joints = U16(data, 26);
            uint flags = U32(data, 28);
            bool ghost = (flags & FlagGhost) != 0;
            int size = HeaderSize + 4 * (links * Track.PoseSize + joints + (ghost ? Track.PoseSize : 0));
            if (count != size)
            {
                fault = "frame of " + count + " bytes; " + links + " links and " + joints + " joints make " + size;
                return false;
            }

            for (int at = HeaderSize; at < size; at += 4)
            {
                if ((U32(data, at) & 0x7F800000) == 0x7F800000)
                {
                    fault = "frame with a number that is not finite, at byte " + at;
                    return false;
                }
            }

            Sequence = U32(data, 4);
            ServerTime = F64(data, 8);
            ClipTime = F64(data, 16);
            Flags = flags;
            if (Poses.Length != links * Track.PoseSize)
            {
                Poses = new float[links * Track.PoseSize];
            }

            if (Joints.Length != joints)
            {
                Joints = new float[joints];
            }

            int next = Floats(data, HeaderSize, Poses);
            next = Floats(data, next, Joints);
            if (ghost)
            {
                Floats(data, next, Ghost);
            }
            else
            {
                Array.Clear(Ghost, 0, Ghost.Length);
            }

            fault = "";
            return true;
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

        // The bits of a float by byte order of the stream, whatever that of the machine is.
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
