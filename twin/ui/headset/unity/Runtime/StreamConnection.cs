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

        /// <summary>Broken off; the next try comes after a while.</summary>
        Waiting
    }

    /// <summary>The connection to `twin serve`, on a task of its own. All public members may be called from any
    /// thread; nothing here touches a Transform.</summary>
    /// <remarks>Of frames only the newest is kept: whoever is slow skips. It reconnects for ever, after 0.25 s that
    /// double to 5 s, and starts anew there: the sequence of another server says nothing about this one.</remarks>
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

        /// <param name="url">The address that `twin serve` shows: http(s)://host:port/ with its token, if any.</param>
        /// <param name="robot">Which robot of a scene; "": the only one that is served.</param>
        /// <exception cref="FormatException">It is no http address.</exception>
        public StreamConnection(string url, string robot = "")
        {
            if (!Uri.TryCreate(url, UriKind.Absolute, out page) || !page.Scheme.StartsWith("http"))
            {
                throw new FormatException(
                    "stream: '" + url + "' is no address; expected http://host:port/ as `twin serve` shows it");
            }

            door = new StreamDoor(page, robot, OpenMilliseconds);
            LastError = "";
        }

        public StreamState State { get; private set; }

        /// <summary>What went wrong last, or "".</summary>
        public string LastError { get; private set; }

        /// <summary>Connections that were opened.</summary>
        public int Connects { get; private set; }

        /// <summary>Whole frames that came.</summary>
        public long Received { get; private set; }

        /// <summary>Frames that were replaced by a newer one before anybody took them.</summary>
        public long Skipped { get; private set; }

        /// <summary>Messages that were no frame, or older than the newest.</summary>
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

        /// <summary>Seconds of this machine's clock.</summary>
        public static double Now
        {
            get { return System.Diagnostics.Stopwatch.GetTimestamp() / (double)System.Diagnostics.Stopwatch.Frequency; }
        }

        /// <summary>Begin; once.</summary>
        public void Start()
        {
            if (running != null)
            {
                throw new InvalidOperationException("stream: it runs already");
            }

            running = Task.Run((Func<Task>)RunAsync);
        }

        /// <summary>End, and wait a moment for the task.</summary>
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
                // It ends: how does not matter.
            }

            State = StreamState.Closed;
        }

        /// <summary>Return the newest frame if none newer than the last one taken has come, else null. It is valid
        /// until the next call.</summary>
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

        /// <summary>Return how old a frame is (s): since the server made it, less the way of the fastest frame so
        /// far. Both clocks are only ever compared with themselves.</summary>
        public double Age(StreamFrame frame)
        {
            lock (gate)
            {
                return Math.Max(0.0, Now - frame.ServerTime - fastest);
            }
        }

        /// <summary>Send a request; false if there is no connection, then it is forgotten.</summary>
        /// <param name="json">See <see cref="Requests"/>.</param>
        /// <param name="replaces">Whether it takes the place of one of this kind that still waits at the end.</param>
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
                    GC.KeepAlive(sends.Exception); // seen: it ends with the connection
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
                    LastError = "nothing came for " + SilentSeconds + " s";
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
                    LastError = "frame with " + incoming.LinkCount + " links; the robot has another number";
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
            // JsonUtility.FromJson may be called from any thread; it touches no object of a scene.
            if (JsonUtility.FromJson<ServerMessage>(json).type == "hello")
            {
                var hello = JsonUtility.FromJson<HelloMessage>(json);
                if (hello.protocol != 1 && hello.protocol != 2)
                {
                    throw new IOException("the server speaks version " + hello.protocol + " of the stream, not 1 or 2");
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
