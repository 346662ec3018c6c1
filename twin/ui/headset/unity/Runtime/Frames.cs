using System;
using UnityEngine;

namespace Twin.Player
{
    /// <summary>Mapping of a right-handed robot (z up, metres) to Unity's left-handed coordinates.</summary>
    /// <remarks>The two conventions differ by 90 degrees about the vertical. Choose the convention of the importer
    /// of the model: poses must be mirrored in the same way as meshes.</remarks>
    public enum Convention
    {
        /// <summary>A GLB imported by glTFast: local x is mirrored, and one root node rotates z up to y up.</summary>
        GltFast = 0,

        /// <summary>A URDF imported by URDF-Importer, or any ROS model: forward-left-up becomes right-up-forward.</summary>
        UrdfImporter = 1
    }

    /// <summary>Converts positions and rotations between the robot's world (right-handed, z up) and Unity.</summary>
    /// <remarks>Unity coordinates are local to the root of the links; see <see cref="RootRotation"/>.</remarks>
    public static class Frames
    {
        private const float HalfRoot = 0.70710678f;

        /// <summary>Convert a point (m) or direction from the robot's world to local coordinates of the root.</summary>
        public static Vector3 ToUnity(Vector3 p, Convention convention)
        {
            return convention == Convention.UrdfImporter ? new Vector3(-p.y, p.z, p.x) : new Vector3(-p.x, p.y, p.z);
        }

        /// <summary>Convert a rotation (unit quaternion) from the robot's world to local coordinates of the root.</summary>
        public static Quaternion ToUnity(Quaternion q, Convention convention)
        {
            return convention == Convention.UrdfImporter
                ? new Quaternion(-q.y, q.z, q.x, -q.w)
                : new Quaternion(q.x, -q.y, -q.z, q.w);
        }

        /// <summary>Convert a point (m) or direction from local coordinates of the root to the robot's world.</summary>
        public static Vector3 FromUnity(Vector3 p, Convention convention)
        {
            return convention == Convention.UrdfImporter ? new Vector3(p.z, -p.x, p.y) : new Vector3(-p.x, p.y, p.z);
        }

        /// <summary>Convert a rotation from local coordinates of the root to the robot's world.</summary>
        public static Quaternion FromUnity(Quaternion q, Convention convention)
        {
            return convention == Convention.UrdfImporter
                ? new Quaternion(q.z, -q.x, q.y, -q.w)
                : new Quaternion(q.x, -q.y, -q.z, q.w);
        }

        /// <summary>Return the local rotation of the root of the links for an upright robot.</summary>
        /// <remarks>glTFast: -90 degrees about x; the root is the node with the robot's name in the GLB.</remarks>
        public static Quaternion RootRotation(Convention convention)
        {
            return convention == Convention.UrdfImporter
                ? Quaternion.identity
                : new Quaternion(-HalfRoot, 0f, 0f, HalfRoot);
        }

        /// <summary>Interpolate spherically from a (share 0) to b (share 1), along the shorter rotation.</summary>
        /// <remarks>q and -q are the same rotation: the sign of b that gives the shorter rotation is used.</remarks>
        public static Quaternion Slerp(Quaternion a, Quaternion b, double share)
        {
            double dot = (double)a.x * b.x + (double)a.y * b.y + (double)a.z * b.z + (double)a.w * b.w;
            double sign = dot < 0.0 ? -1.0 : 1.0;
            double first = 1.0 - share;
            double second = share;
            // The angle is computed from its chord: for small rotations this is accurate, an arc cosine is not.
            double chord = Distance(a, b, sign);
            double angle = 2.0 * Math.Asin(Math.Min(1.0, 0.5 * chord));
            double sine = Math.Sin(angle);
            if (sine > 1e-9)
            {
                first = Math.Sin((1.0 - share) * angle) / sine;
                second = Math.Sin(share * angle) / sine;
            }

            second *= sign;
            return Normalized(
                first * a.x + second * b.x,
                first * a.y + second * b.y,
                first * a.z + second * b.z,
                first * a.w + second * b.w);
        }

        private static double Distance(Quaternion a, Quaternion b, double sign)
        {
            double x = a.x - sign * b.x;
            double y = a.y - sign * b.y;
            double z = a.z - sign * b.z;
            double w = a.w - sign * b.w;
            return Math.Sqrt(x * x + y * y + z * z + w * w);
        }

        private static Quaternion Normalized(double x, double y, double z, double w)
        {
            double length = Math.Sqrt(x * x + y * y + z * z + w * w);
            return new Quaternion(
                (float)(x / length), (float)(y / length), (float)(z / length), (float)(w / length));
        }
    }
}
