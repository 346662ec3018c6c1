using System;
using System.Globalization;
using System.Text;
using UnityEngine;

namespace Twin.Player
{
    /// <summary>What `/robot.json` of the server says, as far as it is needed here.</summary>
    [Serializable]
    public sealed class RobotDescription
    {
        public string schema = "";
        public int version;
        public string name = "";
        public string title = "";
        public string model_hash = "";
        public string frame = "";

        /// <summary>Names in the order of the poses of a frame.</summary>
        public string[] links = new string[0];

        public ToolDescription tool = new ToolDescription();

        public string[] postures = new string[0];

        /// <summary>Read and check a description.</summary>
        /// <exception cref="FormatException">It is not one; the message names the field.</exception>
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

            if (robot == null || robot.schema != "twin-robot" || robot.version != 1)
            {
                throw new FormatException("robot.json is not of schema twin-robot, version 1: is this `twin serve`?");
            }

            if (robot.frame != "z-up right-handed")
            {
                throw new FormatException("robot.json: frame is '" + robot.frame + "', expected 'z-up right-handed'");
            }

            if (robot.links.Length == 0)
            {
                throw new FormatException("robot.json: links is empty");
            }

            if (Array.IndexOf(robot.links, robot.tool.link) < 0 || robot.tool.T_link_tool.Length != Track.PoseSize)
            {
                throw new FormatException("robot.json: the tool is on no link, or has no pose of seven numbers");
            }

            return robot;
        }
    }

    /// <summary>The tool's frame on its link.</summary>
    [Serializable]
    public sealed class ToolDescription
    {
        public string link = "";
        public float[] T_link_tool = new float[0];
    }

    /// <summary>Any text message of the server: only what kind it is.</summary>
    [Serializable]
    public sealed class ServerMessage
    {
        public string type = "";
    }

    /// <summary>The first message of a connection.</summary>
    [Serializable]
    public sealed class HelloMessage
    {
        /// <summary>Version of the protocol.</summary>
        public int protocol;

        public string client = "";
        public string robot = "";
        public string model_hash = "";

        /// <summary>Lets this client come back as itself.</summary>
        public string resume = "";
    }

    /// <summary>What all clients share.</summary>
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
    }

    /// <summary>A request was not followed.</summary>
    [Serializable]
    public sealed class ErrorMessage
    {
        public string code = "";
        public string message = "";
    }

    /// <summary>What a client says, as JSON text. Numbers are in the robot's world, m and rad.</summary>
    public static class Requests
    {
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

        /// <summary>Take hold of a link at a point in the link's own frame (m).</summary>
        public static string GrabLink(string link, Vector3 point)
        {
            return "{\"type\":\"grab\",\"target\":\"link\",\"name\":" + Quoted(link) + ",\"point\":" + Vector(point) + "}";
        }

        /// <summary>Lead the tool to a pose in the robot's world.</summary>
        public static string DragPose(Vector3 p, Quaternion q)
        {
            return "{\"type\":\"drag\",\"pose\":[" + Number(p.x) + "," + Number(p.y) + "," + Number(p.z) + ","
                + Number(q.x) + "," + Number(q.y) + "," + Number(q.z) + "," + Number(q.w) + "]}";
        }

        /// <summary>Lead the point of a link to a place in the robot's world.</summary>
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

        private static string Bool(bool on)
        {
            return on ? "true" : "false";
        }

        private static string Vector(Vector3 v)
        {
            return "[" + Number(v.x) + "," + Number(v.y) + "," + Number(v.z) + "]";
        }

        // Whatever language the machine speaks: a decimal point, and nothing that JSON does not have.
        private static string Number(double value)
        {
            if (double.IsNaN(value) || double.IsInfinity(value))
            {
                throw new ArgumentException("a request holds a number that is not finite");
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
