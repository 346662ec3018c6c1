using System;
using UnityEngine;

namespace Twin.Player
{
    /// <summary>Shows the live robot of `twin serve` on a model; links are found by name.</summary>
    /// <remarks>A background task receives frames; the newest is applied on the main thread. Links get absolute
    /// poses, so that the loops of a parallel robot stay closed without kinematics on the device. UWP requires the
    /// capabilities InternetClient and PrivateNetworkClientServer, Android requires Internet access. WebGL has no
    /// sockets: use the page of `twin serve` there.</remarks>
    [AddComponentMenu("Twin/Stream Client")]
    [DisallowMultipleComponent]
    public sealed class StreamClient : MonoBehaviour
    {
        [Tooltip("The address printed by `twin serve`, with its token if there is one.")]
        public string url = "http://127.0.0.1:8080/";

        [Tooltip("Name of the robot of a scene; empty if a single robot is served.")]
        public string robot = "";

        [Tooltip("The imported robot; empty: this object.")]
        public Transform model;

        [Tooltip("The importer of the model.")]
        public Convention convention = Convention.GltFast;

        [Tooltip("Connect when this component is enabled.")]
        public bool connectOnEnable = true;

        private readonly PoseSource source;
        private StreamConnection connection;
        private string reported = "";

        public StreamClient()
        {
            source = Pose;
            State = new StateMessage();
            Refusal = "";
        }

        /// <summary>Raised for every text message of the server, with (type, JSON text).</summary>
        public event Action<string, string> Message;

        /// <summary>The connection, or null.</summary>
        public StreamConnection Connection
        {
            get { return connection; }
        }

        /// <summary>The displayed robot, or null before the first connection.</summary>
        public RobotDescription Robot { get; private set; }

        public LinkBinding Binding { get; private set; }

        /// <summary>The displayed frame, or null.</summary>
        public StreamFrame Frame { get; private set; }

        /// <summary>The state shared by all clients, from the last message.</summary>
        public StateMessage State { get; private set; }

        /// <summary>The last refusal of the server, or "".</summary>
        public string Refusal { get; private set; }

        /// <summary>Age of the displayed frame in s; see `StreamConnection.Age`.</summary>
        public double Age
        {
            get { return Frame == null || connection == null ? double.PositiveInfinity : connection.Age(Frame); }
        }

        /// <summary>Connect to `url`, and reconnect after each lost connection.</summary>
        public void Connect()
        {
            Disconnect();
            connection = new StreamConnection(url, robot);
            connection.Start();
        }

        public void Disconnect()
        {
            if (connection != null)
            {
                connection.Dispose();
                connection = null;
            }
        }

        /// <summary>Send a request of <see cref="Requests"/>; false if there is no connection.</summary>
        public bool Send(string json, bool replaces)
        {
            return connection != null && connection.Send(json, replaces);
        }

        /// <summary>Set the robot, and find its links in the model.</summary>
        /// <exception cref="ArgumentException">The model lacks a link.</exception>
        public void Use(RobotDescription found)
        {
            Binding = new LinkBinding(model == null ? transform : model, found.links, convention);
            Robot = found;
        }

        /// <summary>Set the pose of every link from a frame.</summary>
        public void Show(StreamFrame frame)
        {
            Frame = frame;
            Binding.Apply(source);
        }

        /// <summary>Process received frames and messages; Update calls this method in each frame.</summary>
        public void Tick()
        {
            if (connection == null)
            {
                return;
            }

            for (string json = connection.TakeMessage(); json != null; json = connection.TakeMessage())
            {
                Hear(json);
            }

            StreamFrame frame = connection.Take();
            if (frame == null)
            {
                return;
            }

            RobotDescription found = connection.Robot;
            if (!ReferenceEquals(found, Robot) && !Bind(found))
            {
                return;
            }

            if (frame.LinkCount == Robot.links.Length)
            {
                Show(frame);
            }
        }

        private bool Bind(RobotDescription found)
        {
            try
            {
                Use(found);
                return true;
            }
            catch (ArgumentException error)
            {
                if (reported != error.Message) // report an error once, not in each frame
                {
                    reported = error.Message;
                    Debug.LogError("StreamClient: " + reported, this);
                }

                return false;
            }
        }

        private void Hear(string json)
        {
            string type = JsonUtility.FromJson<ServerMessage>(json).type;
            if (type == "state")
            {
                State = JsonUtility.FromJson<StateMessage>(json);
                State.Choose(robot);
            }
            else if (type == "error")
            {
                var error = JsonUtility.FromJson<ErrorMessage>(json);
                Refusal = error.code + ": " + error.message;
            }

            if (Message != null)
            {
                Message(type, json);
            }
        }

        private void Pose(int link, out Vector3 position, out Quaternion rotation)
        {
            Frame.Link(link, out position, out rotation);
        }

        private void OnEnable()
        {
            if (connectOnEnable)
            {
                Connect();
            }
        }

        private void OnDisable()
        {
            Disconnect();
        }

        private void Update()
        {
            Tick();
        }
    }
}
