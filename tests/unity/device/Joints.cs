// Shows a robot on the stub of the engine: physics joints between its links, and a grab with a hand.
//
//     Joints.exe <robot> <GltFast | UrdfImporter>
//     joints <count> <loops> <largest distance of two anchors in m> <largest angle between two axes in rad>
//     grab <remaining distance of the tool in m> <error of the tool's motion in Unity's world in m>
//     again <count of joints on the link of the tool after a second call>
using System;
using System.Globalization;
using Twin.Player;
using Twin.Player.Editor;
using UnityEngine;

public static class Joints
{
    public static void Main(string[] arguments)
    {
        IRobotKinematics robot = PhysicsJoints.Kinematics(arguments[0]);
        var convention = (Convention)Enum.Parse(typeof(Convention), arguments[1]);
        var model = new GameObject("place");
        model.transform.localPosition = new Vector3(0.3f, -0.2f, 1f);
        model.transform.localRotation = Quaternion.AngleAxis(30f, new Vector3(0f, 1f, 0f));
        Transform root = Child(model.transform, robot.Robot);
        root.localRotation = Frames.RootRotation(convention);
        foreach (string link in robot.Links)
        {
            Child(root, link);
        }

        var device = model.AddComponent<DeviceRobot>();
        device.convention = convention;
        device.steps = 60;
        device.Use(robot);
        int count = PhysicsJoints.Write(robot, model.transform, convention);
        float apart = 0f;
        float tilted = 0f;
        int loops = 0;
        for (int j = 0, k = 0; j < robot.AllJoints.Length; j++)
        {
            loops += robot.InLoops[j] ? 1 : 0;
            Transform child = device.Binding.Link(robot.JointChildren[j]);
            Transform parent = device.Binding.Link(robot.JointParents[j]);
            ConfigurableJoint[] joints = child.gameObject.GetComponents<ConfigurableJoint>();
            for (k = 0; k < joints.Length && joints[k].connectedBody != parent.GetComponent<Rigidbody>(); k++)
            {
            }

            ConfigurableJoint joint = joints[k];
            Vector3 anchor = child.TransformPoint(joint.anchor);
            Vector3 other = parent.TransformPoint(joint.connectedAnchor);
            bool slides = robot.JointTypes[j] == "prismatic" || robot.JointTypes[j] == "cylindrical";
            Vector3 axis = child.TransformPoint(joint.anchor + joint.axis) - anchor;
            Vector3 gap = anchor - other;
            apart = Math.Max(apart, slides ? (gap - axis * Vector3.Dot(gap, axis)).magnitude : gap.magnitude);
            if (robot.JointTypes[j] != "spherical")
            {
                int at = 24 * j;
                double[] f = robot.JointFrames;
                var z = new Vector3((float)f[at + 2], (float)f[at + 6], (float)f[at + 10]);
                Vector3 zero = parent.TransformPoint(Vector3.zero);
                Vector3 wanted = parent.TransformPoint(Frames.ToUnity(z, convention)) - zero;
                tilted = Math.Max(tilted, (wanted - axis).magnitude);
            }
        }

        Console.WriteLine("joints " + count + " " + loops + " " + Text(apart) + " " + Text(tilted));
        Grab(device);
        PhysicsJoints.Write(robot, model.transform, convention);
        Transform last = device.Binding.Link(robot.JointChildren[0]);
        Console.WriteLine("again " + last.gameObject.GetComponents<ConfigurableJoint>().Length);
    }

    private static void Grab(DeviceRobot device)
    {
        Vector3 before = Tool(device);
        var hand = new Vector3(0.1f, 0.2f, 0.3f);
        Quaternion turn = Quaternion.AngleAxis(20f, new Vector3(0f, 0f, 1f));
        var moved = new Vector3(0.004f, -0.003f, 0.002f);
        device.BeginTool(hand, turn);
        double left = device.Move(hand + moved, turn);
        device.End();
        Vector3 error = Tool(device) - before - moved;
        Console.WriteLine("grab " + Text(left) + " " + Text(error.magnitude));
    }

    private static Vector3 Tool(DeviceRobot device)
    {
        double[] pose = device.Kinematics.Tool;
        var position = new Vector3((float)pose[3], (float)pose[7], (float)pose[11]);
        Quaternion any = Quaternion.identity;
        device.Binding.ToWorld(ref position, ref any);
        return position;
    }

    private static Transform Child(Transform parent, string name)
    {
        Transform made = new GameObject(name).transform;
        made.SetParent(parent, false);
        return made;
    }

    private static string Text(double x)
    {
        return x.ToString("R", CultureInfo.InvariantCulture);
    }
}
