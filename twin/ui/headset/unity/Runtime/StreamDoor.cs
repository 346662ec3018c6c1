using System;
using System.IO;
using System.Net;
using System.Text;

namespace Twin.Player
{
    /// <summary>What the server gives over plain HTTP before the stream: entry, and the robot's description.</summary>
    internal sealed class StreamDoor
    {
        private readonly Uri page;
        private readonly int milliseconds;
        private bool entered;

        public StreamDoor(Uri page, string robot, int milliseconds)
        {
            this.page = page;
            Robot = robot;
            this.milliseconds = milliseconds;
            Cookies = new CookieContainer();
        }

        /// <summary>Which robot of a scene; "": the only one.</summary>
        public string Robot { get; private set; }

        /// <summary>The session, once the token is spent.</summary>
        public CookieContainer Cookies { get; private set; }

        /// <summary>Return the robot that is served, or the one of a scene that was asked for.</summary>
        /// <remarks>The page comes first, with its one-time token: the answer holds the cookie that opens
        /// everything else.</remarks>
        /// <exception cref="WebException">The server is not there, or lets nobody in.</exception>
        /// <exception cref="FormatException">It is another server.</exception>
        public RobotDescription Describe()
        {
            if (page.Query.Length > 1 && !entered)
            {
                Get(page);
                entered = true;
            }

            if (Robot == "")
            {
                return RobotDescription.Parse(Get(new Uri(page, "/robot.json")));
            }

            SceneDescription scene = SceneDescription.Parse(Get(new Uri(page, "/scene.json")));
            int number = scene.Find(Robot);
            scene.robots[number].number = number;
            return scene.robots[number];
        }

        private string Get(Uri address)
        {
            var request = (HttpWebRequest)WebRequest.Create(address);
            request.CookieContainer = Cookies;
            request.Timeout = milliseconds;
            request.ReadWriteTimeout = milliseconds;
            using (WebResponse response = request.GetResponse())
            using (var reader = new StreamReader(response.GetResponseStream(), Encoding.UTF8))
            {
                return reader.ReadToEnd();
            }
        }
    }
}
