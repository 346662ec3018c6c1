// A stub of UnityEngine, see Math.cs: physics, events, attributes and the rest.
using System;
using System.Collections.Generic;
using System.IO;

namespace UnityEngine
{
    public enum ArticulationJointType { FixedJoint, PrismaticJoint, RevoluteJoint, SphericalJoint }

    public struct ArticulationDrive
    {
        public float lowerLimit, upperLimit, stiffness, damping, forceLimit, target, targetVelocity;
    }

    public struct ArticulationReducedSpace
    {
        private readonly float first;

        public ArticulationReducedSpace(float a) { first = a; }

        public float this[int i] { get { return first; } }
    }

    public class ArticulationBody : Behaviour
    {
        public ArticulationJointType jointType { get; set; }
        public ArticulationDrive xDrive { get; set; } // a property of a struct, as in Unity: a copy goes out and in
        public ArticulationReducedSpace jointPosition { get; set; }
    }

    public class ConfigurableJoint : Component
    {
        public Vector3 targetPosition { get; set; }
        public Quaternion targetRotation { get; set; }
        public Rigidbody connectedBody { get; set; }
        public bool autoConfigureConnectedAnchor { get; set; }
        public bool enableCollision { get; set; }
        public Vector3 anchor { get; set; }
        public Vector3 connectedAnchor { get; set; }
        public Vector3 axis { get; set; }
        public Vector3 secondaryAxis { get; set; }
        public ConfigurableJointMotion xMotion { get; set; }
        public ConfigurableJointMotion yMotion { get; set; }
        public ConfigurableJointMotion zMotion { get; set; }
        public ConfigurableJointMotion angularXMotion { get; set; }
        public ConfigurableJointMotion angularYMotion { get; set; }
        public ConfigurableJointMotion angularZMotion { get; set; }
        public SoftJointLimit lowAngularXLimit { get; set; }
        public SoftJointLimit highAngularXLimit { get; set; }
        public JointDrive angularXDrive { get; set; }
        public JointDrive xDrive { get; set; }
    }

    public static class Debug
    {
        public static readonly List<string> Lines = new List<string>();

        public static void Log(object o) { Lines.Add("" + o); }
        public static void Log(object o, Object about) { Lines.Add("" + o); }
        public static void LogError(object o, Object about) { Lines.Add("error: " + o); }
        public static void LogWarning(object o, Object about) { Lines.Add("warning: " + o); }
    }

    public static class Time
    {
        public static float deltaTime { get; set; }
    }

    public enum RuntimePlatform { LinuxEditor }

    public static class Application
    {
        public static bool isPlaying { get { return false; } }
        public static string unityVersion { get { return "none (stub)"; } }
        public static RuntimePlatform platform { get { return RuntimePlatform.LinuxEditor; } }
        public static string dataPath { get { return Environment.GetEnvironmentVariable("TWIN_ASSETS"); } }
    }

    public static class Screen
    {
        public static int width { get { return 640; } }
        public static int height { get { return 480; } }
    }

    public static class GUI
    {
        public static bool Button(Rect r, string text) { return false; }
        public static void Label(Rect r, string text) { }
        public static float HorizontalSlider(Rect r, float value, float left, float right) { return value; }
    }

    public static class Input
    {
        public static Vector3 mousePosition { get { return Vector3.zero; } }
        public static bool GetMouseButtonDown(int b) { return false; }
        public static bool GetMouseButtonUp(int b) { return false; }
        public static bool GetMouseButton(int b) { return false; }
    }

    public static class Resources
    {
        public static T Load<T>(string name) where T : Object
        {
            string file = Path.Combine(Environment.GetEnvironmentVariable("TWIN_RESOURCES") ?? "", name + ".json");
            return File.Exists(file) ? new TextAsset(File.ReadAllText(file)) as T : null;
        }
    }

    [AttributeUsage(AttributeTargets.Field)]
    public sealed class TooltipAttribute : Attribute { public TooltipAttribute(string text) { } }

    [AttributeUsage(AttributeTargets.Class)]
    public sealed class AddComponentMenu : Attribute { public AddComponentMenu(string path) { } }

    [AttributeUsage(AttributeTargets.Class)]
    public sealed class DisallowMultipleComponent : Attribute { }

    [AttributeUsage(AttributeTargets.Method)]
    public sealed class ContextMenu : Attribute { public ContextMenu(string name) { } }
}

namespace UnityEngine.Events
{
    public delegate void UnityAction();

    public delegate void UnityAction<T>(T a);

    public class UnityEvent
    {
        private event UnityAction called;

        public void AddListener(UnityAction a) { called += a; }
        public void Invoke() { if (called != null) called(); }
    }

    public class UnityEvent<T>
    {
        private event UnityAction<T> called;

        public void AddListener(UnityAction<T> a) { called += a; }
        public void Invoke(T a) { if (called != null) called(a); }
    }
}

namespace UnityEngine.Scripting
{
    [AttributeUsage(AttributeTargets.All)]
    public sealed class PreserveAttribute : Attribute { }

    [AttributeUsage(AttributeTargets.Assembly)]
    public sealed class AlwaysLinkAssemblyAttribute : Attribute { }
}

namespace UnityEditor
{
    [AttributeUsage(AttributeTargets.Method)]
    public sealed class MenuItem : Attribute { public MenuItem(string path) { } }

    public static class EditorUtility
    {
        public static string OpenFolderPanel(string title, string folder, string name) { return ""; }
        public static bool DisplayDialog(string title, string message, string ok) { return true; }
    }

    public static class AssetDatabase
    {
        public static void Refresh() { }
        public static T LoadAssetAtPath<T>(string path) where T : UnityEngine.Object { return null; }
    }
}
