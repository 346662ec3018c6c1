// A stub: the few parts of UnityEngine that the package uses, with the same names and the same semantics as far as
// they matter here. Written for these tests; it is not Unity, and passing against it is not passing in Unity.
using System;

namespace UnityEngine
{
    public struct Vector3
    {
        public float x, y, z;

        public Vector3(float x, float y, float z) { this.x = x; this.y = y; this.z = z; }

        public static Vector3 zero { get { return new Vector3(0, 0, 0); } }
        public static Vector3 one { get { return new Vector3(1, 1, 1); } }
        public static Vector3 right { get { return new Vector3(1, 0, 0); } }
        public static Vector3 forward { get { return new Vector3(0, 0, 1); } }
        public float magnitude { get { return (float)Math.Sqrt((double)x * x + (double)y * y + (double)z * z); } }
        public static Vector3 operator +(Vector3 a, Vector3 b) { return new Vector3(a.x + b.x, a.y + b.y, a.z + b.z); }
        public static Vector3 operator -(Vector3 a, Vector3 b) { return new Vector3(a.x - b.x, a.y - b.y, a.z - b.z); }
        public static Vector3 operator -(Vector3 a) { return new Vector3(-a.x, -a.y, -a.z); }
        public static Vector3 operator *(Vector3 a, float s) { return new Vector3(a.x * s, a.y * s, a.z * s); }
        public static Vector3 operator *(float s, Vector3 a) { return a * s; }
        public static float Dot(Vector3 a, Vector3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
        public static float Distance(Vector3 a, Vector3 b) { return (a - b).magnitude; }
        public static Vector3 Scale(Vector3 a, Vector3 b) { return new Vector3(a.x * b.x, a.y * b.y, a.z * b.z); }
    }

    public struct Quaternion
    {
        public float x, y, z, w;

        public Quaternion(float x, float y, float z, float w) { this.x = x; this.y = y; this.z = z; this.w = w; }

        public static Quaternion identity { get { return new Quaternion(0, 0, 0, 1); } }
        public static Quaternion Inverse(Quaternion q) { return new Quaternion(-q.x, -q.y, -q.z, q.w); }
        public static float Dot(Quaternion a, Quaternion b) { return a.x * b.x + a.y * b.y + a.z * b.z + a.w * b.w; }

        public static Quaternion AngleAxis(float degrees, Vector3 axis)
        {
            double half = degrees * Math.PI / 360.0;
            double s = Math.Sin(half) / axis.magnitude;
            return new Quaternion((float)(s * axis.x), (float)(s * axis.y), (float)(s * axis.z), (float)Math.Cos(half));
        }

        public static Quaternion operator *(Quaternion a, Quaternion b)
        {
            return new Quaternion(
                a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
                a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
                a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w,
                a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z);
        }

        public static Vector3 operator *(Quaternion q, Vector3 v)
        {
            double tx = 2.0 * ((double)q.y * v.z - (double)q.z * v.y);
            double ty = 2.0 * ((double)q.z * v.x - (double)q.x * v.z);
            double tz = 2.0 * ((double)q.x * v.y - (double)q.y * v.x);
            return new Vector3(
                (float)(v.x + q.w * tx + q.y * tz - q.z * ty),
                (float)(v.y + q.w * ty + q.z * tx - q.x * tz),
                (float)(v.z + q.w * tz + q.x * ty - q.y * tx));
        }
    }

    public static class Mathf
    {
        public const float Rad2Deg = 57.29578f;
        public const float Deg2Rad = 0.0174532924f;
        public static float Clamp(float v, float low, float high) { return v < low ? low : v > high ? high : v; }
        public static float Sqrt(float v) { return (float)Math.Sqrt(v); }
        public static float Abs(float v) { return Math.Abs(v); }
    }

    public struct Rect
    {
        public Rect(float x, float y, float width, float height) { }
    }

    public struct Ray
    {
        public Vector3 origin, direction;

        public Ray(Vector3 origin, Vector3 direction) { this.origin = origin; this.direction = direction; }

        public Vector3 GetPoint(float distance) { return origin + direction * distance; }
    }

    public struct Plane
    {
        private Vector3 normal;
        private float offset;

        public Plane(Vector3 normal, Vector3 point) { this.normal = normal; offset = -Vector3.Dot(normal, point); }

        public bool Raycast(Ray ray, out float enter)
        {
            float along = Vector3.Dot(ray.direction, normal);
            enter = along == 0f ? 0f : -(Vector3.Dot(ray.origin, normal) + offset) / along;
            return enter > 0f;
        }
    }

    public struct Color
    {
        public float r, g, b, a;

        public Color(float r, float g, float b, float a) { this.r = r; this.g = g; this.b = b; this.a = a; }

        public Color gamma { get { return new Color(Shown(r), Shown(g), Shown(b), a); } }

        private static float Shown(float x)
        {
            return x <= 0.0031308f ? 12.92f * x : (float)(1.055 * Math.Pow(x, 1 / 2.4) - 0.055);
        }
    }
}
