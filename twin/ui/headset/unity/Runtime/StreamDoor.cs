using System;
using System.IO;
using System.Net;
using System.Text;

namespace Twin.Player
{
    /// <summary>HTTP requests before the stream: log in with the token, and read the robot's description.</summary>
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

        /// <summary>Name of the robot of a scene; "": a single robot is served.</summary>
        public string Robot { get; private set; }

        /// <summary>Cookies, with the session that the server opens for the token.</summary>
        public CookieContainer Cookies { get; private set; }

        /// <summary>Return the description of the served robot, or of the selected robot of a scene.</summary>
        /// <remarks>The page is requested first, with the one-time token; the response has the cookie for all other
        /// requests.</remarks>
        /// <exception cref="WebException">The server cannot be reached, or refuses access.</exception>
        /// <exception cref="FormatException">The response is not from `twin serve`, or the scene has no such
        /// robot.</exception>
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
            scene.robots[number].deformables = scene.fields;
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
