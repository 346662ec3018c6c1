// A stub of UnityEngine, see Math.cs: objects, components and transforms.
using System;
using System.Collections.Generic;

namespace UnityEngine
{
    public class Object
    {
        private bool destroyed;

        public string name { get; set; }

        public static void DestroyImmediate(Object o) { if (!ReferenceEquals(o, null)) o.destroyed = true; }
        public static void Destroy(Object o) { DestroyImmediate(o); }
        public static T Instantiate<T>(T original) where T : Object { throw new NotSupportedException("stub"); }
        public static bool operator ==(Object a, Object b) { return ReferenceEquals(Alive(a), Alive(b)); }
        public static bool operator !=(Object a, Object b) { return !(a == b); }
        public static implicit operator bool(Object o) { return Alive(o) != null; }
        public override bool Equals(object other) { return ReferenceEquals(this, other); }
        public override int GetHashCode() { return base.GetHashCode(); }

        private static object Alive(Object o) { return ReferenceEquals(o, null) || o.destroyed ? null : (object)o; }
    }

    public class Component : Object
    {
        public GameObject gameObject { get; internal set; }
        public Transform transform { get { return gameObject.transform; } }
        public T GetComponent<T>() where T : Component { return gameObject.GetComponent<T>(); }
        public T[] GetComponentsInChildren<T>() where T : Component { return gameObject.GetComponentsInChildren<T>(); }
    }

    public class Behaviour : Component
    {
        public bool enabled = true;
    }

    public class MonoBehaviour : Behaviour
    {
    }

    public class GameObject : Object
    {
        private readonly List<Component> components = new List<Component>();

        public GameObject(string name)
        {
            this.name = name;
            activeSelf = true;
            transform = new Transform { gameObject = this, name = name };
        }

        public Transform transform { get; private set; }
        public bool activeSelf { get; private set; }
        public void SetActive(bool on) { activeSelf = on; }

        public T AddComponent<T>() where T : Component, new()
        {
            var added = new T { gameObject = this, name = name };
            components.Add(added);
            return added;
        }

        public static GameObject CreatePrimitive(PrimitiveType type) { return new GameObject("" + type); }
        public T GetComponent<T>() where T : Component { return components.Find(c => c is T && c) as T; }

        public T[] GetComponents<T>() where T : Component
        {
            var found = new List<T>();
            foreach (Component c in components)
            {
                if (c is T && c) found.Add((T)c);
            }

            return found.ToArray();
        }

        public T[] GetComponentsInChildren<T>() where T : Component
        {
            var found = new List<T>();
            Walk(transform, found);
            return found.ToArray();
        }

        private static void Walk<T>(Transform at, List<T> found) where T : Component
        {
            foreach (Component c in at.gameObject.components)
            {
                if (c is T) found.Add((T)c);
            }

            for (int i = 0; i < at.childCount; i++) Walk(at.GetChild(i), found);
        }
    }

    public sealed class Transform : Component
    {
        private readonly List<Transform> children = new List<Transform>();

        public Transform()
        {
            localRotation = Quaternion.identity;
            localScale = Vector3.one;
        }

        public Transform parent { get; private set; }
        public Vector3 localPosition { get; set; }
        public Quaternion localRotation { get; set; }
        public Vector3 localScale { get; set; }
        public new Transform transform { get { return this; } }
        public int childCount { get { return children.Count; } }
        public Transform GetChild(int i) { return children[i]; }
        public Vector3 forward { get { return rotation * Vector3.forward; } }
        public Vector3 position { get { return parent == null ? localPosition : parent.TransformPoint(localPosition); } }

        public Quaternion rotation
        {
            get { return parent == null ? localRotation : parent.rotation * localRotation; }
        }

        public void SetParent(Transform to, bool worldPositionStays)
        {
            if (worldPositionStays) throw new NotSupportedException("stub");
            if (parent != null) parent.children.Remove(this);
            parent = to;
            if (to != null) to.children.Add(this);
        }

        public Vector3 TransformPoint(Vector3 p)
        {
            Vector3 outer = localRotation * Vector3.Scale(localScale, p) + localPosition;
            return parent == null ? outer : parent.TransformPoint(outer);
        }

        public Vector3 InverseTransformPoint(Vector3 p)
        {
            Vector3 inner = parent == null ? p : parent.InverseTransformPoint(p);
            inner = Quaternion.Inverse(localRotation) * (inner - localPosition);
            return new Vector3(inner.x / localScale.x, inner.y / localScale.y, inner.z / localScale.z);
        }

        public void SetPositionAndRotation(Vector3 p, Quaternion q)
        {
            localPosition = parent == null ? p : parent.InverseTransformPoint(p);
            localRotation = parent == null ? q : Quaternion.Inverse(parent.rotation) * q;
        }
    }

    public class TextAsset : Object
    {
        public TextAsset(string text) { this.text = text; }

        public string text { get; private set; }
        public byte[] bytes { get { return System.Text.Encoding.UTF8.GetBytes(text); } }
    }

    public class TextMesh : Component
    {
        public string text { get; set; }
        public TextAnchor anchor { get; set; }
    }

    public struct Bounds
    {
        public Vector3 center, extents;

        public bool IntersectRay(Ray ray, out float distance)
        {
            distance = 0f;
            throw new NotSupportedException("stub");
        }
    }

    public class Animation : Behaviour
    {
    }

    public class Mesh : Object
    {
        private Vector3[] corners = new Vector3[0];

        public Vector3[] vertices
        {
            get { return (Vector3[])corners.Clone(); }
            set { corners = (Vector3[])value.Clone(); }
        }

        public int[] triangles { get; set; }
        public void MarkDynamic() { }
        public void Clear() { corners = new Vector3[0]; triangles = null; }
        public void RecalculateNormals() { }
        public void RecalculateBounds() { }
    }

    public class Shader : Object
    {
        public static Shader Find(string name) { return new Shader { name = name }; }
    }

    public class Material : Object
    {
        public Material(Shader shader) { }
        public Material(Material other) { color = other.color; }

        public Color color { get; set; }
    }

    public class MeshFilter : Component
    {
        public Mesh sharedMesh { get; set; }
    }

    public class MeshRenderer : Renderer
    {
        public Material sharedMaterial { get; set; }
    }

    public class Renderer : Component
    {
        public Bounds bounds { get; set; }
    }

    public class Camera : Behaviour
    {
        public static Camera main { get { return null; } }
        public Ray ScreenPointToRay(Vector3 p) { throw new NotSupportedException("stub"); }
    }
}
