// Plays the deformables of a file organs.glb at given times on the package's DeformablePlayer, and prints, in Unity's
// world, the vertices and the triangles of each mesh. What that means for the scene is worked out by whoever reads it.
//
//     PlayBends.exe <organs.glb> <GltFast | UrdfImporter> <time> ...
using System;
using System.Collections.Generic;
using System.Globalization;
using System.IO;
using Twin.Player;
using UnityEngine;

public static class PlayBends
{
    public static void Main(string[] arguments)
    {
        var convention = (Convention)Enum.Parse(typeof(Convention), arguments[1]);
        var root = new GameObject("organs");
        root.transform.localRotation = Frames.RootRotation(convention);
        var player = root.AddComponent<DeformablePlayer>();
        player.convention = convention;
        player.Load(File.ReadAllBytes(arguments[0]));
        var lines = new List<string>();
        for (int body = 0; body < player.Motion.Count; body++)
        {
            var frames = new List<string>();
            for (int i = 2; i < arguments.Length; i++)
            {
                player.Seek(double.Parse(arguments[i], CultureInfo.InvariantCulture));
                var numbers = new List<string>();
                foreach (Vector3 vertex in player.MeshOf(body).vertices)
                {
                    Vector3 v = root.transform.TransformPoint(vertex);
                    numbers.Add(Text(v.x));
                    numbers.Add(Text(v.y));
                    numbers.Add(Text(v.z));
                }

                frames.Add("[" + string.Join(",", numbers.ToArray()) + "]");
            }

            string triangles = string.Join(",", Array.ConvertAll(player.MeshOf(body).triangles, t => t.ToString()));
            lines.Add("\"" + player.MeshOf(body).name + "\":{\"frames\":[" + string.Join(",", frames.ToArray())
                + "],\"triangles\":[" + triangles + "]}");
        }

        Console.WriteLine("{" + string.Join(",", lines.ToArray()) + "}");
    }

    private static string Text(float x)
    {
        return x.ToString("R", CultureInfo.InvariantCulture);
    }
}
