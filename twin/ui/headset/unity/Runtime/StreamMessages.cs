using System;
using System.Globalization;
using System.Text;
using UnityEngine;

namespace Twin.Player
{
    /// <summary>The entries of the server's `/robot.json` that this package uses.</summary>
    [Serializable]
    public sealed class RobotDescription
    {
        public string schema = "";
        public int version;
        public string name = "";
        public string title = "";
        public string model_hash = "";
        public string frame = "";

        /// <summary>Names of the links, in the order of the poses in a frame.</summary>
        public string[] links = new string[0];

        public ToolDescription tool = new ToolDescription();

        public string[] postures = new string[0];

        /// <summary>Pose of the base in the scene's world: x y z and quaternion x y z w.</summary>
        public float[] T_world_base = new float[0];

        /// <summary>Index of the robot in the frames of a scene.</summary>
        [NonSerialized]
        public int number;

        /// <summary>The deformables of the robot's scene, in the order of <see cref="StreamFrame.Fields"/>.</summary>
        [NonSerialized]
        public DeformableDescription[] deformables = new DeformableDescription[0];

        /// <summary>Parse and check a description.</summary>
        /// <exception cref="FormatException">The text is not a description; the message names the field.</exception>
        public static RobotDescription Parse(string json)
        {
            RobotDescription robot;
            try
            {
                robot = JsonUtility.FromJson<RobotDescription>(json);
            }
            catch (ArgumentException error)
            {
                throw new FormatException("robot.json is not JSON: " + error.Message, error);
            }

            if (robot == null)
            {
                throw new FormatException("robot.json is not of schema twin-robot, version 1: is this `twin serve`?");
            }

            robot.Check("robot.json");
            return robot;
        }

        internal void Check(string file)
        {
            if (schema != "twin-robot" || version != 1)
            {
                throw new FormatException(file + " is not of schema twin-robot, version 1: is this `twin serve`?");
            }

            if (frame != "z-up right-handed")
            {
                throw new FormatException(file + ": frame is '" + frame + "', expected 'z-up right-handed'");
            }

            if (links.Length == 0)
            {
                throw new FormatException(file + ": links is empty");
            }

            if (Array.IndexOf(links, tool.link) < 0 || tool.T_link_tool.Length != Track.PoseSize)
            {
                throw new FormatException(file + ": the tool is on an unknown link, or its pose is not seven numbers");
            }
        }
    }

    /// <summary>The entries of the server's `/scene.json` that this package uses.</summary>
    [Serializable]
    public sealed class SceneDescription
    {
        public string schema = "";
        public int version;
        public string name = "";

        /// <summary>The robots, in their order in a frame.</summary>
        public RobotDescription[] robots = new RobotDescription[0];

        /// <summary>The deformables, in their order in a frame.</summary>
        public DeformableDescription[] fields = new DeformableDescription[0];

        /// <summary>Parse and check a description.</summary>
        /// <exception cref="FormatException">The text is not a description; the message names the field.</exception>
        public static SceneDescription Parse(string json)
        {
            SceneDescription scene;
            try
            {
                scene = JsonUtility.FromJson<SceneDescription>(json);
            }
            catch (ArgumentException error)
            {
                throw new FormatException("scene.json is not JSON: " + error.Message, error);
            }

            if (scene == null || scene.schema != "twin-scene" || scene.version != 1)
            {
                throw new FormatException("scene.json is not of schema twin-scene, version 1: is this `twin serve`?");
            }

            foreach (RobotDescription robot in scene.robots)
            {
                robot.Check("scene.json, robots");
            }

            foreach (DeformableDescription field in scene.fields)
            {
                field.Check("scene.json, fields");
            }

            return scene;
        }

        /// <summary>Return the index of a robot by its name.</summary>
        /// <exception cref="FormatException">No robot has this name; the message lists the existing names.</exception>
        public int Find(string robot)
        {
            int found = Array.FindIndex(robots, r => r.name == robot);
            if (found < 0)
            {
                string names = string.Join(", ", Array.ConvertAll(robots, r => r.name));
                throw new FormatException("scene " + name + " has no robot '" + robot + "'; it has " + names);
            }

            return found;
        }
    }

    /// <summary>Frame of the tool on its link.</summary>
    [Serializable]
    public sealed class ToolDescription
    {
        public string link = "";
        public float[] T_link_tool = new float[0];
    }

    /// <summary>Type of a text message of the server.</summary>
    [Serializable]
    public sealed class ServerMessage
    {
        public string type = "";
    }

    /// <summary>The first message of a connection.</summary>
    [Serializable]
    public sealed class HelloMessage
    {
        /// <summary>Version of the protocol: 1 for one robot, 2 for a scene.</summary>
        public int protocol;

        public string client = "";
        public string robot = "";
        public string model_hash = "";

        /// <summary>Token with which this client resumes its session after a reconnection.</summary>
        public string resume = "";
    }

    /// <summary>State shared by all clients.</summary>
    [Serializable]
    public sealed class StateMessage
    {
        public bool playing;
        public double time;
        public double duration;
        public float speed;
        public bool loop;
        public string protocol = "";
        public string phase = "";

        /// <summary>The client that holds the robot, or "".</summary>
        public string holder = "";

        /// <summary>Why the last request was refused, or "".</summary>
        public string reason = "";

        /// <summary>State of each robot of a scene; the fields above are a copy for the displayed robot.</summary>
        public RobotState[] robots = new RobotState[0];

        /// <summary>Copy protocol, phase, holder and reason of one robot to this state.</summary>
        internal void Choose(string robot)
        {
            RobotState own = Array.Find(robots, r => r.name == robot);
            if (own != null)
            {
                protocol = own.protocol;
                phase = own.phase;
                holder = own.holder;
                reason = own.reason;
            }
        }
    }

    /// <summary>State of one robot of a scene.</summary>
    [Serializable]
    public sealed class RobotState
    {
        public string name = "";
        public string protocol = "";
        public string phase = "";
        public string holder = "";
        public string reason = "";
    }

    /// <summary>Message of the server that a request was refused.</summary>
    [Serializable]
    public sealed class ErrorMessage
    {
        public string code = "";
        public string message = "";
    }

    /// <summary>Requests of a client as JSON text. Numbers are in the robot's world, in m and rad.</summary>
    public static class Requests
    {
        private static readonly string[] OfRobot =
        {
            "protocol", "posture", "grab", "drag", "release", "variant", "workspace"
        };

        public static string Play(bool on)
        {
            return "{\"type\":\"play\",\"on\":" + Bool(on) + "}";
        }

        public static string Seek(double seconds)
        {
            return "{\"type\":\"seek\",\"t\":" + Number(seconds) + "}";
        }

        public static string Speed(double value)
        {
            return "{\"type\":\"speed\",\"value\":" + Number(value) + "}";
        }

        public static string Loop(bool on)
        {
            return "{\"type\":\"loop\",\"on\":" + Bool(on) + "}";
        }

        public static string Protocol(string name)
        {
            return "{\"type\":\"protocol\",\"name\":" + Quoted(name) + "}";
        }

        public static string Posture(string name)
        {
            return "{\"type\":\"posture\",\"name\":" + Quoted(name) + "}";
        }

        public static string GrabTool()
        {
            return "{\"type\":\"grab\",\"target\":\"tool\"}";
        }

        public static string GrabJoint(string joint)
        {
            return "{\"type\":\"grab\",\"target\":\"joint\",\"name\":" + Quoted(joint) + "}";
        }

        /// <summary>Grab a link at a point (m) in the frame of the link.</summary>
        public static string GrabLink(string link, Vector3 point)
        {
            return "{\"type\":\"grab\",\"target\":\"link\",\"name\":" + Quoted(link) + ",\"point\":" + Vector(point) + "}";
        }

        /// <summary>Drag the tool to a pose in the robot's world.</summary>
        public static string DragPose(Vector3 p, Quaternion q)
        {
            return "{\"type\":\"drag\",\"pose\":[" + Number(p.x) + "," + Number(p.y) + "," + Number(p.z) + ","
                + Number(q.x) + "," + Number(q.y) + "," + Number(q.z) + "," + Number(q.w) + "]}";
        }

        /// <summary>Drag the grabbed point of a link to a position in the robot's world.</summary>
        public static string DragPoint(Vector3 point)
        {
            return "{\"type\":\"drag\",\"point\":" + Vector(point) + "}";
        }

        public static string DragValue(double value)
        {
            return "{\"type\":\"drag\",\"value\":" + Number(value) + "}";
        }

        public static string Release()
        {
            return "{\"type\":\"release\"}";
        }

        public static string Ping(double seconds)
        {
            return "{\"type\":\"ping\",\"t\":" + Number(seconds) + "}";
        }

        /// <summary>Add the name of a robot of a scene to a request, if its type concerns a single robot.</summary>
        public static string Of(string robot, string json)
        {
            if (robot == "" || !Array.Exists(OfRobot, kind => json.StartsWith("{\"type\":\"" + kind + "\"")))
            {
                return json;
            }

            return json.Substring(0, json.Length - 1) + ",\"robot\":" + Quoted(robot) + "}";
        }

        private static string Bool(bool on)
        {
            return on ? "true" : "false";
        }

        private static string Vector(Vector3 v)
        {
            return "[" + Number(v.x) + "," + Number(v.y) + "," + Number(v.z) + "]";
        }

        // In every locale, write a decimal point; refuse NaN and infinity, which JSON does not have.
        private static string Number(double value)
        {
            if (double.IsNaN(value) || double.IsInfinity(value))
            {
                throw new ArgumentException("a request contains a number that is not finite");
            }

            return value.ToString("G9", CultureInfo.InvariantCulture);
        }

        private static string Quoted(string text)
        {
            var quoted = new StringBuilder("\"");
            foreach (char c in text)
            {
                if (c == '"' || c == '\\' || c < ' ')
                {
                    quoted.Append("\\u").Append(((int)c).ToString("x4"));
                }
                else
                {
                    quoted.Append(c);
                }
            }

            return quoted.Append('"').ToString();
        }
    }
}
