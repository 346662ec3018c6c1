using System;
using UnityEngine;

namespace Twin.Player
{
    /// <summary>Golden vectors of the self test: computed in Python for the robot SILS, with matrices instead of the
    /// formulas of this package. The fields are named as in Resources/twin-golden.json.</summary>
    [Serializable]
    public sealed class Golden
    {
        public string schema = "";
        public int version;
        public Track track = new Track();

        /// <summary>Pose of the model in Unity's world, followed by its scale.</summary>
        public float[] place = new float[0];
        public float scale;

        /// <summary>Points on links: index of the link, key of the track, x y z in the link frame of the robot, in the
        /// mesh of each importer, and in Unity's world.</summary>
        public int[] point_link = new int[0];
        public int[] point_key = new int[0];
        public float[] point_robot = new float[0];
        public float[] point_gltfast = new float[0];
        public float[] point_urdf = new float[0];
        public float[] world_gltfast = new float[0];
        public float[] world_urdf = new float[0];

        public double[] between_time = new double[0];
        public int[] between_link = new int[0];
        public float[] between_pose = new float[0];

        public float[] turn_a = new float[0];
        public float[] turn_b = new float[0];
        public double[] turn_share = new double[0];
        public float[] turn_want = new float[0];

        public double joint_time;
        public string[] joint_name = new string[0];
        public float[] joint_want = new float[0];

        public string[] drive_joint = new string[0];
        public float[] drive_sign = new float[0];
        public float[] drive_value = new float[0];
        public float[] drive_target = new float[0];

        public double[] phase_time = new double[0];
        public string[] phase_name = new string[0];

        public string stream = "";
        public string stream_sequence = "";
        public double stream_server_time;
        public double stream_clip_time;
        public int stream_flags;
        public int stream_key;
        public float[] stream_joints = new float[0];
        public float[] stream_ghost = new float[0];

        public int grab_key;
        public string tool_link = "";
        public float[] tool_frame = new float[0];
        public float[] grab_hands = new float[0];
        public float[] grab_want_gltfast = new float[0];
        public float[] grab_want_urdf = new float[0];

        /// <summary>Read the vectors of the package.</summary>
        /// <exception cref="FormatException">The vectors are missing or invalid.</exception>
        public static Golden Load()
        {
            var file = Resources.Load<TextAsset>("twin-golden");
            if (file == null)
            {
                throw new FormatException("Resources/twin-golden.json is not in this build");
            }

            var golden = JsonUtility.FromJson<Golden>(file.text);
            if (golden.schema != "twin-golden" || golden.version != 1 || golden.point_link.Length == 0)
            {
                throw new FormatException("Resources/twin-golden.json is invalid: install the package again");
            }

            TrackCheck.Require(golden.track);
            return golden;
        }

        /// <summary>Return the mesh vertices (x y z each) in the local coordinates of an importer.</summary>
        public float[] Points(Convention convention)
        {
            return convention == Convention.UrdfImporter ? point_urdf : point_gltfast;
        }

        /// <summary>Return the same vertices (x y z each) in Unity's world.</summary>
        public float[] World(Convention convention)
        {
            return convention == Convention.UrdfImporter ? world_urdf : world_gltfast;
        }

        /// <summary>Return the expected target pose of the grabbed tool.</summary>
        public float[] GrabWant(Convention convention)
        {
            return convention == Convention.UrdfImporter ? grab_want_urdf : grab_want_gltfast;
        }

        public static Vector3 Vector(float[] from, int row)
        {
            return new Vector3(from[3 * row], from[3 * row + 1], from[3 * row + 2]);
        }

        public static Quaternion Rotation(float[] from, int at)
        {
            return new Quaternion(from[at], from[at + 1], from[at + 2], from[at + 3]);
        }

        /// <summary>Create a model without meshes, with the nodes of an importer; destroy it after use.</summary>
        public GameObject Model(Convention convention)
        {
            var model = new GameObject("model");
            Vector3 position;
            Quaternion rotation;
            Track.ReadPose(place, 0, out position, out rotation);
            model.transform.localPosition = position;
            model.transform.localRotation = rotation;
            model.transform.localScale = new Vector3(scale, scale, scale);
            var root = new GameObject(track.robot).transform;
            root.SetParent(model.transform, false);
            root.localRotation = Frames.RootRotation(convention);
            foreach (string link in track.links)
            {
                new GameObject(link).transform.SetParent(root, false);
            }

            return model;
        }

        /// <summary>Return a description of the robot in the form of `/robot.json`.</summary>
        public RobotDescription Robot()
        {
            var robot = new RobotDescription();
            robot.name = track.robot;
            robot.links = track.links;
            robot.tool.link = tool_link;
            robot.tool.T_link_tool = tool_frame;
            return robot;
        }
    }
}
