// A client of the stream as a scene would be one: a model, StreamClient and Grab, and a loop that ticks them. It prints
// a line for each frame that it shows and takes orders from its input, one a line.
//
//     Listen.exe <address> [--robot=<of a scene>] <link> ...
//     pause <ms>          show nothing for a while, like a scene that loads
//     tool <x y z>        take hold of the tool with a hand there, in Unity's world
//     link <name x y z>   take hold of a link
//     joint <name>        take hold of a joint
//     move <x y z>        move the hand
//     value <v>           move the joint
//     end                 release what is held
// It ends with its input; its last line says that the client has closed.
using System;
using System.Collections.Generic;
using System.Globalization;
using System.Threading;
using Twin.Player;
using UnityEngine;

public static class Listen
{
    private static readonly Queue<string> Orders = new Queue<string>();
    private static StreamClient client;
    private static Grab grab;
    private static Deformables soft;

    public static void Main(string[] arguments)
    {
        var model = new GameObject("model");
        string robot = "";
        for (int i = 1; i < arguments.Length; i++)
        {
            if (arguments[i].StartsWith("--robot="))
            {
                robot = arguments[i].Substring(8);
                continue;
            }

            new GameObject(arguments[i]).transform.SetParent(model.transform, false);
        }

        client = model.AddComponent<StreamClient>();
        client.url = arguments[0];
        client.robot = robot;
        soft = new GameObject("soft").AddComponent<Deformables>();
        soft.stream = client;
        grab = model.AddComponent<Grab>();
        grab.stream = client;
        client.Connect();
        new Thread(Read) { IsBackground = true }.Start();
        StreamFrame shown = null;
        StreamState state = StreamState.Closed;
        uint sequence = 0;
        for (bool on = true; on; Thread.Sleep(2))
        {
            client.Tick();
            soft.Tick();
            if (client.Frame != null && (!ReferenceEquals(client.Frame, shown) || client.Frame.Sequence != sequence))
            {
                shown = client.Frame;
                sequence = shown.Sequence;
                Say("frame");
            }

            if (client.Connection.State != state)
            {
                state = client.Connection.State;
                Say("state");
            }

            string order = Next();
            on = order != "quit";
            if (on && order != null)
            {
                Obey(order.Split(' '));
            }
        }

        client.Disconnect();
        Console.WriteLine("{\"what\":\"end\"}");
        Console.Out.Flush();
    }

    private static void Obey(string[] words)
    {
        switch (words[0])
        {
            case "pause": Thread.Sleep(int.Parse(words[1])); break;
            case "tool": grab.BeginTool(Vector(words, 1), Quaternion.identity); break;
            case "link": grab.BeginLink(client.Binding.Link(Array.IndexOf(client.Robot.links, words[1])), Vector(words, 2)); break;
            case "joint": grab.BeginJoint(words[1]); break;
            case "move": grab.Move(Vector(words, 1), Quaternion.identity); break;
            case "value": grab.MoveJoint(Number(words[1])); break;
            case "end": grab.End(); break;
            default: throw new ArgumentException(words[0]);
        }
    }

    private static void Say(string what)
    {
        StreamConnection line = client.Connection;
        string shown = "null";
        if (client.Frame != null)
        {
            Vector3 p = client.Binding.Link(client.Robot.links.Length - 1).localPosition;
            shown = "[" + Text(p.x) + "," + Text(p.y) + "," + Text(p.z) + "]";
        }

        string vertex = "null";
        if (client.Frame != null && client.Frame.Fields.Length > 0)
        {
            float[] v = client.Frame.Fields[0];
            vertex = "[" + Text(v[v.Length - 3]) + "," + Text(v[v.Length - 2]) + "," + Text(v[v.Length - 1]) + "]";
        }

        string mesh = "null";
        if (soft.Count > 0 && soft.MeshOf(0).triangles != null)
        {
            Vector3[] v = soft.MeshOf(0).vertices;
            Vector3 last = v[v.Length - 1];
            mesh = "[" + v.Length + "," + Text(last.x) + "," + Text(last.y) + "," + Text(last.z) + ","
                + string.Join(",", soft.MeshOf(0).triangles) + "]";
        }

        string age = client.Frame == null ? "null" : Text(client.Age);
        Console.WriteLine("{\"what\":\"" + what + "\",\"state\":\"" + line.State + "\",\"sequence\":"
            + (client.Frame == null ? "null" : client.Frame.Sequence.ToString()) + ",\"last\":" + shown + ",\"age\":" + age + ",\"vertex\":" + vertex + ",\"mesh\":" + mesh
            + ",\"connects\":" + line.Connects + ",\"received\":" + line.Received + ",\"skipped\":" + line.Skipped
            + ",\"refused\":" + line.Refused + ",\"holding\":" + (grab.IsHolding ? "true" : "false")
            + ",\"phase\":\"" + client.State.phase + "\",\"refusal\":\"" + client.Refusal + "\",\"error\":\""
            + line.LastError.Replace("\\", "/").Replace("\"", "'").Replace("\n", " ") + "\"}");
        Console.Out.Flush();
    }

    private static void Read()
    {
        for (string line = Console.ReadLine(); line != null; line = Console.ReadLine())
        {
            lock (Orders)
            {
                Orders.Enqueue(line);
            }
        }

        lock (Orders)
        {
            Orders.Enqueue("quit");
        }
    }

    private static string Next()
    {
        lock (Orders)
        {
            return Orders.Count > 0 ? Orders.Dequeue() : null;
        }
    }

    private static Vector3 Vector(string[] words, int at)
    {
        return new Vector3(Number(words[at]), Number(words[at + 1]), Number(words[at + 2]));
    }

    private static float Number(string word)
    {
        return float.Parse(word, CultureInfo.InvariantCulture);
    }

    private static string Text(double v)
    {
        return v.ToString("R", CultureInfo.InvariantCulture);
    }
}
