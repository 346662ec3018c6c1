// Declarations of MRTK3, XR Interaction Toolkit and the editor, as far as the sample for headsets uses them. They are a
// stub and do nothing: they show that the sample is C# with these names, not that the toolkits accept it.
using System;
using System.Collections.Generic;
using UnityEngine.Events;

namespace UnityEngine
{
    public enum PrimitiveType { Cube }

    public enum TextAnchor { MiddleCenter }

    public enum LightType { Directional }

    public class Light : Behaviour
    {
        public LightType type { get; set; }
    }

    public class MeshCollider : Component
    {
        public Mesh sharedMesh { get; set; }
    }

    public class Rigidbody : Component
    {
        public float mass { get; set; }
        public bool isKinematic { get; set; }
    }

    public enum ConfigurableJointMotion { Locked, Limited, Free }

    public struct SoftJointLimit
    {
        public float limit { get; set; }
    }

    public struct JointDrive
    {
        public float positionSpring { get; set; }
        public float positionDamper { get; set; }
        public float maximumForce { get; set; }
    }
}

namespace UnityEngine.SceneManagement
{
    public struct Scene { }
}

namespace UnityEngine.XR.Interaction.Toolkit
{
    public class Interactable { }

    public class Interactor
    {
        public Transform GetAttachTransform(Interactable interactable) { throw new NotSupportedException("stub"); }
    }

    public class SelectEnterEventArgs
    {
        public Interactor interactorObject { get; set; }
        public Interactable interactableObject { get; set; }
    }

    public class SelectExitEventArgs { }

    public class SelectEnterEvent : UnityEvent<SelectEnterEventArgs> { }

    public class SelectExitEvent : UnityEvent<SelectExitEventArgs> { }
}

namespace MixedReality.Toolkit
{
    using UnityEngine.XR.Interaction.Toolkit;

    public class StatefulInteractable : UnityEngine.MonoBehaviour
    {
        private readonly UnityEvent clicked = new UnityEvent();
        private readonly SelectEnterEvent entered = new SelectEnterEvent();
        private readonly SelectExitEvent exited = new SelectExitEvent();

        public UnityEvent OnClicked { get { return clicked; } }
        public SelectEnterEvent firstSelectEntered { get { return entered; } }
        public SelectExitEvent lastSelectExited { get { return exited; } }
    }
}

namespace MixedReality.Toolkit.SpatialManipulation
{
    public class ObjectManipulator : StatefulInteractable
    {
        public UnityEngine.Transform HostTransform { get; set; }
    }

    public class SolverHandler : UnityEngine.MonoBehaviour { }

    public class HandConstraintPalmUp : UnityEngine.MonoBehaviour { }
}

namespace MixedReality.Toolkit.UX
{
    public class SliderEventData
    {
        public float NewValue { get; set; }
    }

    public class SliderEvent : UnityEvent<SliderEventData> { }

    public class Slider : StatefulInteractable
    {
        private readonly SliderEvent updated = new SliderEvent();

        public UnityEngine.Transform SliderStart { get; set; }
        public UnityEngine.Transform SliderEnd { get; set; }
        public UnityEngine.Transform HandleTransform { get; set; }
        public float MinValue { get; set; }
        public float MaxValue { get; set; }
        public float Value { get; set; }
        public SliderEvent OnValueUpdated { get { return updated; } }
    }
}

namespace UnityEditor
{
    public static class Selection
    {
        public static UnityEngine.GameObject activeGameObject { get; set; }
    }

    public static class TypeCache
    {
        public static IEnumerable<Type> GetTypesDerivedFrom<T>()
        {
            foreach (System.Reflection.Assembly assembly in AppDomain.CurrentDomain.GetAssemblies())
            {
                foreach (Type type in assembly.GetTypes())
                {
                    if (typeof(T).IsAssignableFrom(type) && type.IsClass) yield return type;
                }
            }
        }
    }

    public static class PrefabUtility
    {
        public static UnityEngine.Object InstantiatePrefab(UnityEngine.Object o) { throw new NotSupportedException("stub"); }
    }

    public static class PlayerSettings
    {
        public enum WSACapability { InternetClient, PrivateNetworkClientServer, SpatialPerception, GazeInput }

        public static class WSA
        {
            public static void SetCapability(WSACapability capability, bool on) { }
        }
    }
}

namespace UnityEditor.SceneManagement
{
    using UnityEngine.SceneManagement;

    public enum NewSceneSetup { EmptyScene }

    public enum NewSceneMode { Single }

    public static class EditorSceneManager
    {
        public static Scene NewScene(NewSceneSetup setup, NewSceneMode mode) { return new Scene(); }
        public static bool SaveScene(Scene scene, string path) { return true; }
    }
}
