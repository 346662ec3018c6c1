using System;
using UnityEditor;
using UnityEngine;

namespace Twin.Player.Editor
{
    /// <summary>Writes the joints of a robot, those that close loops too, as ConfigurableJoints between its links.</summary>
    /// <remarks>An articulation is a tree; rigid bodies with a joint for each pair of links may form loops. The joints
    /// are written in the posture that the model shows. Active joints get limits and a drive that holds this posture;
    /// passive joints move freely. PhysX has not yet run the result.</remarks>
    public static class PhysicsJoints
    {
        private const float Stiffness = 2000f; // N m/rad, N/m
        private const float Damping = 100f;

        [MenuItem("Twin/Write physics joints of the selected robot")]
        public static void Ask()
        {
            GameObject selected = Selection.activeGameObject;
            try
            {
                if (selected == null)
                {
                    throw new ArgumentException("select the imported model of a robot first");
                }

                IRobotKinematics robot = Kinematics(selected.name);
                int count = Write(robot, selected.transform, Convention.GltFast);
                Debug.Log("twin: " + count + " joints of " + robot.Robot + " written", selected);
            }
            catch (ArgumentException error)
            {
                EditorUtility.DisplayDialog("Twin", error.Message, "OK");
            }
        }

        /// <summary>Return new kinematics for a robot from the classes that `twin export` has written.</summary>
        /// <exception cref="ArgumentException">There is no such class.</exception>
        public static IRobotKinematics Kinematics(string robot)
        {
            foreach (Type type in TypeCache.GetTypesDerivedFrom<IRobotKinematics>())
            {
                var found = (IRobotKinematics)Activator.CreateInstance(type);
                if (found.Robot == robot)
                {
                    return found;
                }
            }

            throw new ArgumentException("no kinematics of '" + robot + "': the selected object must have the name of the "
                + "robot, and the package must come from `twin export " + robot + " --to unity,glb`");
        }

        /// <summary>Write a Rigidbody for each link and a joint for each pair; earlier joints are removed.</summary>
        /// <returns>The number of joints.</returns>
        /// <exception cref="ArgumentException">A link is missing in the model.</exception>
        public static int Write(IRobotKinematics robot, Transform model, Convention convention)
        {
            var binding = new LinkBinding(model, robot.Links, convention);
            for (int i = 0; i < robot.Links.Length; i++)
            {
                GameObject link = binding.Link(i).gameObject;
                foreach (ConfigurableJoint old in link.GetComponents<ConfigurableJoint>())
                {
                    UnityEngine.Object.DestroyImmediate(old);
                }

                Rigidbody body = link.GetComponent<Rigidbody>();
                body = body != null ? body : link.AddComponent<Rigidbody>();
                body.mass = robot.LinkMasses[i] > 0.0 ? (float)robot.LinkMasses[i] : 1f;
                body.isKinematic = i == 0; // the base
            }

            for (int j = 0; j < robot.AllJoints.Length; j++)
            {
                GameObject child = binding.Link(robot.JointChildren[j]).gameObject;
                var joint = child.AddComponent<ConfigurableJoint>();
                joint.connectedBody = binding.Link(robot.JointParents[j]).GetComponent<Rigidbody>();
                Place(joint, robot, j, convention);
                Free(joint, robot.JointTypes[j]);
                int active = robot.JointActive[j];
                if (active >= 0)
                {
                    Drive(joint, robot, j, robot.Q[active]);
                }
            }

            return robot.AllJoints.Length;
        }

        private static void Place(ConfigurableJoint joint, IRobotKinematics robot, int j, Convention convention)
        {
            int parent = 24 * j;
            int child = parent + 12;
            joint.autoConfigureConnectedAnchor = false;
            joint.anchor = Frames.ToUnity(Column(robot.JointFrames, child, 3), convention);
            joint.connectedAnchor = Frames.ToUnity(Column(robot.JointFrames, parent, 3), convention);
            joint.axis = Frames.ToUnity(Column(robot.JointFrames, child, 2), convention);
            joint.secondaryAxis = Frames.ToUnity(Column(robot.JointFrames, child, 0), convention);
            joint.enableCollision = false; // neighbours overlap in their bearings
        }

        private static void Free(ConfigurableJoint joint, string type)
        {
            ConfigurableJointMotion along = ConfigurableJointMotion.Locked;
            ConfigurableJointMotion about = ConfigurableJointMotion.Locked;
            ConfigurableJointMotion others = ConfigurableJointMotion.Locked;
            ConfigurableJointMotion sideways = ConfigurableJointMotion.Locked;
            if (type == "prismatic" || type == "cylindrical" || type == "free")
            {
                along = ConfigurableJointMotion.Free;
            }

            if (type == "revolute" || type == "cylindrical" || type == "spherical" || type == "free")
            {
                about = ConfigurableJointMotion.Free;
            }

            if (type == "spherical" || type == "free")
            {
                others = ConfigurableJointMotion.Free;
            }

            if (type == "free")
            {
                sideways = ConfigurableJointMotion.Free;
            }

            joint.xMotion = along;
            joint.yMotion = sideways;
            joint.zMotion = sideways;
            joint.angularXMotion = about;
            joint.angularYMotion = others;
            joint.angularZMotion = others;
        }

        // Limits are relative to the posture in which the joint is written. Unity's coordinates are a mirror image, in
        // which a rotation about the mirrored axis has the other sign.
        private static void Drive(ConfigurableJoint joint, IRobotKinematics robot, int j, double q)
        {
            double lower = robot.JointLimits[2 * j];
            double upper = robot.JointLimits[2 * j + 1];
            bool limited = !double.IsInfinity(lower) && !double.IsInfinity(upper);
            var drive = new JointDrive { positionSpring = Stiffness, positionDamper = Damping, maximumForce = 1e6f };
            if (robot.JointTypes[j] == "revolute")
            {
                joint.angularXDrive = drive;
                if (limited && upper - lower < Math.PI)
                {
                    joint.angularXMotion = ConfigurableJointMotion.Limited;
                    joint.lowAngularXLimit = new SoftJointLimit { limit = (float)((q - upper) * Mathf.Rad2Deg) };
                    joint.highAngularXLimit = new SoftJointLimit { limit = (float)((q - lower) * Mathf.Rad2Deg) };
                }

                return;
            }

            joint.xDrive = drive; // the range of a slide is not symmetrical about the anchor: it is not limited here
        }

        private static Vector3 Column(double[] rows, int at, int column)
        {
            return new Vector3((float)rows[at + column], (float)rows[at + 4 + column], (float)rows[at + 8 + column]);
        }
    }
}
