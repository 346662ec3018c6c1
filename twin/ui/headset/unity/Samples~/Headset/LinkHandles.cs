using System.Collections.Generic;
using MixedReality.Toolkit.SpatialManipulation;
using UnityEngine;
using UnityEngine.XR.Interaction.Toolkit;

namespace Twin.Player.Samples
{
    /// <summary>Makes every link of a robot grabbable by hands and rays (MRTK3).</summary>
    /// <remarks>An ObjectManipulator on each link moves an invisible handle; the grabbed point of the link then follows
    /// the handle, as far as the mechanism allows. The link that carries the tool is grabbed as the tool: it follows
    /// position and rotation.</remarks>
    public sealed class LinkHandles : MonoBehaviour
    {
        private readonly List<ObjectManipulator> manipulators = new List<ObjectManipulator>();
        private readonly List<Transform> handles = new List<Transform>();
        private DeviceRobot robot;
        private int held = -1;
        private Vector3 onHandle;
        private bool asTool;

        /// <summary>Why the grabbed part does not follow, or "".</summary>
        public string Reason
        {
            get { return held < 0 || robot == null ? "" : robot.Reason; }
        }

        /// <summary>Add colliders and manipulators to the links of a robot.</summary>
        public void Attach(DeviceRobot device)
        {
            robot = device;
            for (int i = 0; i < device.Kinematics.Links.Length; i++)
            {
                Transform link = device.Binding.Link(i);
                foreach (MeshFilter mesh in link.gameObject.GetComponentsInChildren<MeshFilter>())
                {
                    mesh.gameObject.AddComponent<MeshCollider>().sharedMesh = mesh.sharedMesh;
                }

                Transform handle = new GameObject("handle of " + link.name).transform;
                handle.SetParent(transform, false);
                handles.Add(handle);
                var manipulator = link.gameObject.AddComponent<ObjectManipulator>();
                manipulator.HostTransform = handle;
                int index = i;
                manipulator.firstSelectEntered.AddListener(args => Begin(index, args));
                manipulator.lastSelectExited.AddListener(args => End());
                manipulators.Add(manipulator);
            }
        }

        /// <summary>Allow or forbid grabs.</summary>
        public void Allow(bool on)
        {
            End();
            foreach (ObjectManipulator manipulator in manipulators)
            {
                manipulator.enabled = on;
            }
        }

        private void Begin(int link, SelectEnterEventArgs args)
        {
            Transform part = robot.Binding.Link(link);
            Transform handle = handles[link];
            handle.SetPositionAndRotation(part.position, part.rotation);
            Vector3 point = args.interactorObject.GetAttachTransform(args.interactableObject).position;
            onHandle = handle.InverseTransformPoint(point);
            asTool = robot.Kinematics.Links[link] == robot.Kinematics.ToolLink;
            bool begun = asTool ? robot.BeginTool(point, handle.rotation) : robot.BeginLink(part, point);
            held = begun ? link : -1;
        }

        private void End()
        {
            held = -1;
            if (robot != null)
            {
                robot.End();
            }
        }

        private void Update()
        {
            for (int i = 0; i < handles.Count; i++)
            {
                if (i != held)
                {
                    Transform part = robot.Binding.Link(i);
                    handles[i].SetPositionAndRotation(part.position, part.rotation);
                }
            }

            if (held >= 0)
            {
                robot.Move(handles[held].TransformPoint(onHandle), handles[held].rotation);
            }
        }
    }
}
