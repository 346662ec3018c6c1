// Plays a track at given times on the package's TrackPlayer, and prints where Unity's world has every link: the images
// of the origin and of the three axes. What that means for the robot is worked out by whoever reads it.
//
//     PlayTrack.exe <track.json> <GltFast | UrdfImporter> <time> ...
using System;
using System.Collections.Generic;
using System.Globalization;
using System.IO;
using Twin.Player;
using UnityEngine;

public static class PlayTrack
{
    public static void Main(string[] arguments)
    {
        Track track = Track.Parse(File.ReadAllText(arguments[0]));
        var convention = (Convention)Enum.Parse(typeof(Convention), arguments[1]);
        var model = new GameObject("model");
        Transform root = Child(model.transform, track.robot);
        root.localRotation = Frames.RootRotation(convention);
        foreach (string link in track.links)
        {
            Child(root, link);
        }

        var player = model.AddComponent<TrackPlayer>();
        player.convention = convention;
        player.Load(track);
        var lines = new List<string>();
        for (int link = 0; link < track.links.Length; link++)
        {
            var poses = new List<string>();
            for (int i = 2; i < arguments.Length; i++)
            {
                player.Seek(double.Parse(arguments[i], CultureInfo.InvariantCulture));
                Transform at = player.Binding.Link(link);
                poses.Add("[" + Text(at.TransformPoint(Vector3.zero)) + "," + Text(at.TransformPoint(Vector3.right))
                    + "," + Text(at.TransformPoint(new Vector3(0, 1, 0))) + ","
                    + Text(at.TransformPoint(Vector3.forward)) + "]");
            }

            lines.Add("\"" + track.links[link] + "\":[" + string.Join(",", poses.ToArray()) + "]");
        }

        Console.WriteLine("{" + string.Join(",", lines.ToArray()) + "}");
    }

    private static Transform Child(Transform parent, string name)
    {
        Transform child = new GameObject(name).transform;
        child.SetParent(parent, false);
        return child;
    }

    private static string Text(Vector3 v)
    {
        CultureInfo any = CultureInfo.InvariantCulture;
        return "[" + v.x.ToString("R", any) + "," + v.y.ToString("R", any) + "," + v.z.ToString("R", any) + "]";
    }
}
