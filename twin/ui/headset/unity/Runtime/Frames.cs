using System;
using UnityEngine;

namespace Twin.Player
{
    /// <summary>How a right-handed robot (z up, metres) was brought into Unity, which is left-handed.</summary>
    /// <remarks>The two differ by a quarter turn about the vertical. A model says which one it needs by the
    /// importer it came through: meshes and poses must have been mirrored in the same way.</remarks>
    public enum Convention
    {
        /// <summary>A GLB imported by glTFast: local x is mirrored, and one root node turns z up into y up.</summary>
        GltFast = 0,

        /// <summary>A URDF imported by URDF-Importer, or any ROS model: forward-left-up becomes right-up-forward.</summary>
        UrdfImporter = 1
    }

    /// <summary>Positions and rotations of the robot's world (right-handed, z up) in Unity, and back.</summary>
    /// <remarks>Unity's side is always local to the root of the links: see <see cref="RootRotation"/>.</remarks>
    public static class Frames
    {
        private const float HalfRoot = 0.70710678f;

        /// <summary>Return a point (m) or direction of the robot's world as a local one below the root.</summary>
        public static Vector3 ToUnity(Vector3 p, Convention convention)
        {
            return convention == Convention.UrdfImporter ? new Vector3(-p.y, p.z, p.x) : new Vector3(-p.x, p.y, p.z);
        }

        /// <summary>Return a rotation (unit quaternion) of the robot's world as a local one below the root.</summary>
        public static Quaternion ToUnity(Quaternion q, Convention convention)
        {
            return convention == Convention.UrdfImporter
                ? new Quaternion(-q.y, q.z, q.x, -q.w)
                : new Quaternion(q.x, -q.y, -q.z, q.w);
        }

        /// <summary>Return a local point (m) or direction below the root as one of the robot's world.</summary>
        public static Vector3 FromUnity(Vector3 p, Convention convention)
        {
            return convention == Convention.UrdfImporter ? new Vector3(p.z, -p.x, p.y) : new Vector3(-p.x, p.y, p.z);
        }

        /// <summary>Return a local rotation below the root as one of the robot's world.</summary>
        public static Quaternion FromUnity(Quaternion q, Convention convention)
        {
            return convention == Convention.UrdfImporter
                ? new Quaternion(q.z, -q.x, q.y, -q.w)
                : new Quaternion(q.x, -q.y, -q.z, q.w);
        }

        /// <summary>Return the local rotation that the root of the links has when the robot stands upright.</summary>
        /// <remarks>glTFast: -90 degrees about x, the node that carries the robot's name in the GLB.</remarks>
        public static Quaternion RootRotation(Convention convention)
        {
            return convention == Convention.UrdfImporter
                ? Quaternion.identity
                : new Quaternion(-HalfRoot, 0f, 0f, HalfRoot);
        }

        /// <summary>Return the rotation that turns evenly from a (share 0) to b (share 1) the short way round.</summary>
        /// <remarks>q and -q are the same rotation: the sign of b is chosen so that the way is short.</remarks>
        public static Quaternion Slerp(Quaternion a, Quaternion b, double share)
        {
            double dot = (double)a.x * b.x + (double)a.y * b.y + (double)a.z * b.z + (double)a.w * b.w;
            double sign = dot < 0.0 ? -1.0 : 1.0;
            double first = 1.0 - share;
            double second = share;
            // The angle from its chord: exact for the small turns between two keys, where the arc cosine is not.
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
