using System;
using System.Collections.Generic;
using System.IO;
using System.Net.WebSockets;
using System.Text;
using System.Threading;
using System.Threading.Tasks;
using UnityEngine;

namespace Twin.Player
{
    public enum StreamState
    {
        Closed,
        Connecting,
        Open,

        /// <summary>Disconnected; the next attempt follows after a delay.</summary>
        Waiting
    }

    /// <summary>The connection to `twin serve`, on a separate task. All public members may be called from any
    /// thread; no member uses a Transform.</summary>
    /// <remarks>Only the newest frame is kept; a slow reader skips frames. It reconnects without limit, with delays that
    /// double from 0.25 s to 5 s. Sequence numbers are compared only within one connection.</remarks>
    public sealed class StreamConnection : IDisposable
    {
        private const int LargestMessage = 32 * 1024 * 1024;
        private const int LargestInbox = 64;
        private const double FirstDelay = 0.25;
        private const double LongestDelay = 5.0;
        private const int PingMilliseconds = 1000;
        private const double SilentSeconds = 5.0;
        private const int OpenMilliseconds = 8000;

        private readonly Uri page;
        private readonly StreamDoor door;
        private readonly CancellationTokenSource stop = new CancellationTokenSource();
        private readonly object gate = new object();
        private readonly Queue<string> inbox = new Queue<string>();
        private readonly StreamOutbox outbox = new StreamOutbox();

        private StreamFrame incoming = new StreamFrame();
        private StreamFrame latest = new StreamFrame();
        private StreamFrame taken = new StreamFrame();
        private bool fresh;
        private bool first;
        private bool heard;
        private uint sequence;
        private double fastest;
        private long lastHeard;
        private RobotDescription robot;
        private string resume = "";
        private Task running;

        /// <param name="url">The address printed by `twin serve`: http(s)://host:port/ with its token, if any.</param>
        /// <param name="robot">Name of the robot of a scene; "": a single robot is served.</param>
        /// <exception cref="FormatException">The url is not an http address.</exception>
        public StreamConnection(string url, string robot = "")
        {
            if (!Uri.TryCreate(url, UriKind.Absolute, out page) || !page.Scheme.StartsWith("http"))
            {
                throw new FormatException(
                    "stream: '" + url + "' is not an address; expected http://host:port/ as printed by `twin serve`");
            }

            door = new StreamDoor(page, robot, OpenMilliseconds);
            LastError = "";
        }

        public StreamState State { get; private set; }

        /// <summary>Text of the last error, or "".</summary>
        public string LastError { get; private set; }

        /// <summary>Number of opened connections.</summary>
        public int Connects { get; private set; }

        /// <summary>Number of valid frames received.</summary>
        public long Received { get; private set; }

        /// <summary>Number of frames replaced by newer frames before they were read.</summary>
        public long Skipped { get; private set; }

        /// <summary>Number of messages that were not valid frames, or older than the newest frame.</summary>
        public long Refused { get; private set; }

        /// <summary>The robot that the server streams, or null before the first connection.</summary>
        public RobotDescription Robot
        {
            get
            {
                lock (gate)
                {
                    return robot;
                }
            }
        }

        /// <summary>Current time in s of this machine's clock.</summary>
        public static double Now
        {
            get { return System.Diagnostics.Stopwatch.GetTimestamp() / (double)System.Diagnostics.Stopwatch.Frequency; }
        }

        /// <summary>Start the connection; may be called only once.</summary>
        public void Start()
        {
            if (running != null)
            {
                throw new InvalidOperationException("stream: the connection was already started");
            }

            running = Task.Run((Func<Task>)RunAsync);
        }

        /// <summary>Stop the connection, and wait briefly for the task to end.</summary>
        public void Dispose()
        {
            stop.Cancel();
            try
            {
                if (running != null)
                {
                    running.Wait(1000);
                }
            }
            catch (AggregateException)
            {
                // The task has ended; its exception is not needed.
            }

            State = StreamState.Closed;
        }

        /// <summary>Return the newest frame; null if no frame has arrived since the last call. The frame is valid until
        /// the next call.</summary>
        public StreamFrame Take()
        {
            lock (gate)
            {
                if (!fresh)
                {
                    return null;
                }

                StreamFrame old = taken;
                taken = latest;
                latest = old;
                fresh = false;
                return taken;
            }
        }

        /// <summary>Return the next text message, or null.</summary>
        public string TakeMessage()
        {
            lock (gate)
            {
                return inbox.Count > 0 ? inbox.Dequeue() : null;
            }
        }

        /// <summary>Return the age of a frame in s: time since the server made it, minus the transmission time of the
        /// fastest frame so far. The clocks of server and client need not agree.</summary>
        public double Age(StreamFrame frame)
        {
            lock (gate)
            {
                return Math.Max(0.0, Now - frame.ServerTime - fastest);
            }
        }

        /// <summary>Queue a request; false, without effect, if there is no connection or the queue is full.</summary>
        /// <param name="json">See <see cref="Requests"/>.</param>
        /// <param name="replaces">Whether it replaces the last waiting request, if that may be replaced too.</param>
        public bool Send(string json, bool replaces)
        {
            return State == StreamState.Open && outbox.Add(Requests.Of(door.Robot, json), replaces);
        }

        private async Task RunAsync()
        {
            double delay = FirstDelay;
            while (!stop.IsCancellationRequested)
            {
                heard = false;
                try
                {
                    await ConnectAsync().ConfigureAwait(false);
                }
                catch (Exception error)
                {
                    LastError = error.GetBaseException().Message;
                }

                if (stop.IsCancellationRequested)
                {
                    break;
                }

                State = StreamState.Waiting;
                delay = heard ? FirstDelay : Math.Min(LongestDelay, 2.0 * delay);
                await Task.WhenAny(Task.Delay(TimeSpan.FromSeconds(delay), stop.Token)).ConfigureAwait(false);
            }

            State = StreamState.Closed;
        }

        private async Task ConnectAsync()
        {
            State = StreamState.Connecting;
            RobotDescription found = door.Describe();
            lock (gate)
            {
                robot = found;
            }

            using (var socket = new ClientWebSocket())
            using (var end = CancellationTokenSource.CreateLinkedTokenSource(stop.Token))
            {
                socket.Options.Cookies = door.Cookies;
                socket.Options.KeepAliveInterval = TimeSpan.Zero;
                var address = new UriBuilder(page);
                address.Scheme = page.Scheme == "https" ? "wss" : "ws";
                address.Path = "/ws";
                address.Query = resume == "" ? "" : "resume=" + Uri.EscapeDataString(resume);
                using (var late = CancellationTokenSource.CreateLinkedTokenSource(end.Token))
                {
                    late.CancelAfter(OpenMilliseconds);
                    await socket.ConnectAsync(address.Uri, late.Token).ConfigureAwait(false);
                }

                lock (gate)
                {
                    first = true;
                    fastest = double.PositiveInfinity;
                    inbox.Clear();
                }

                outbox.Clear();
                Interlocked.Exchange(ref lastHeard, DateTime.UtcNow.Ticks);
                Connects++;
                State = StreamState.Open;
                Task sends = SendAsync(socket, end.Token);
                try
                {
                    await ReceiveAsync(socket, end.Token).ConfigureAwait(false);
                }
                finally
                {
                    State = StreamState.Waiting;
                    end.Cancel();
                    socket.Abort();
                    await Task.WhenAny(sends).ConfigureAwait(false);
                    GC.KeepAlive(sends.Exception); // reading the exception marks it as observed
                }
            }
        }

        private async Task SendAsync(ClientWebSocket socket, CancellationToken end)
        {
            double pinged = Now;
            while (!end.IsCancellationRequested)
            {
                string json = await outbox.NextAsync(PingMilliseconds, end).ConfigureAwait(false);
                if (DateTime.UtcNow.Ticks - Interlocked.Read(ref lastHeard) > SilentSeconds * TimeSpan.TicksPerSecond)
                {
                    LastError = "no message was received for " + SilentSeconds + " s";
                    socket.Abort();
                    return;
                }

                if (json != null)
                {
                    await SendAsync(socket, json, end).ConfigureAwait(false);
                }

                if (Now - pinged >= 0.001 * PingMilliseconds)
                {
                    pinged = Now;
                    await SendAsync(socket, Requests.Ping(pinged), end).ConfigureAwait(false);
                }
            }
        }

        private static Task SendAsync(ClientWebSocket socket, string json, CancellationToken end)
        {
            var bytes = new ArraySegment<byte>(Encoding.UTF8.GetBytes(json));
            return socket.SendAsync(bytes, WebSocketMessageType.Text, true, end);
        }

        private async Task ReceiveAsync(ClientWebSocket socket, CancellationToken end)
        {
            var buffer = new byte[16 * 1024];
            while (!end.IsCancellationRequested)
            {
                int count = 0;
                WebSocketReceiveResult part;
                do
                {
                    if (count == buffer.Length)
                    {
                        if (buffer.Length >= LargestMessage)
                        {
                            throw new IOException("a message is larger than " + LargestMessage + " bytes");
                        }

                        Array.Resize(ref buffer, 2 * buffer.Length);
                    }

                    part = await socket.ReceiveAsync(
                        new ArraySegment<byte>(buffer, count, buffer.Length - count), end).ConfigureAwait(false);
                    count += part.Count;
                    Interlocked.Exchange(ref lastHeard, DateTime.UtcNow.Ticks);
                }
                while (!part.EndOfMessage);

                if (part.MessageType == WebSocketMessageType.Close)
                {
                    LastError = "the server closed the connection: " + socket.CloseStatusDescription;
                    return;
                }

                heard = true;
                if (part.MessageType == WebSocketMessageType.Binary)
                {
                    Frame(buffer, count);
                }
                else
                {
                    Text(Encoding.UTF8.GetString(buffer, 0, count));
                }
            }
        }

        private void Frame(byte[] data, int count)
        {
            string fault;
            if (!incoming.Read(data, count, out fault, robot == null ? 0 : robot.number))
            {
                Refused++;
                LastError = fault;
                return;
            }

            lock (gate)
            {
                if (robot == null || incoming.LinkCount != robot.links.Length)
                {
                    Refused++;
                    LastError = "frame with " + incoming.LinkCount + " links, robot with " + (robot?.links.Length ?? 0);
                    return;
                }

                if (!first && !StreamFrame.IsNewer(incoming.Sequence, sequence))
                {
                    Refused++;
                    return;
                }

                first = false;
                sequence = incoming.Sequence;
                incoming.ReceivedAt = Now;
                fastest = Math.Min(fastest, incoming.ReceivedAt - incoming.ServerTime);
                Received++;
                Skipped += fresh ? 1 : 0;
                StreamFrame old = latest;
                latest = incoming;
                incoming = old;
                fresh = true;
            }
        }

        private void Text(string json)
        {
            // JsonUtility.FromJson may be called from any thread, because it uses no objects of a scene.
            if (JsonUtility.FromJson<ServerMessage>(json).type == "hello")
            {
                var hello = JsonUtility.FromJson<HelloMessage>(json);
                if (hello.protocol != 1 && hello.protocol != 2)
                {
                    throw new IOException("the server uses version " + hello.protocol + " of the stream, not 1 or 2");
                }

                resume = hello.resume ?? "";
            }

            lock (gate)
            {
                while (inbox.Count >= LargestInbox)
                {
                    inbox.Dequeue();
                }

                inbox.Enqueue(json);
            }
        }
    }
}
