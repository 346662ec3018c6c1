using System;
using System.Collections.Generic;
using System.IO;
using UnityEditor;
using UnityEngine;

namespace Twin.Player.Editor
{
    /// <summary>Imports the model and the tracks of a folder written by `twin export` into the project.</summary>
    public static class BundleImport
    {
        /// <summary>Menu command: ask for the folder, copy its files, and let Unity import them.</summary>
        [MenuItem("Twin/Import bundle…")]
        public static void Ask()
        {
            string bundle = EditorUtility.OpenFolderPanel("Folder written by `twin export`", "", "");
            if (string.IsNullOrEmpty(bundle))
            {
                return;
            }

            try
            {
                List<string> files = Copy(bundle, Application.dataPath);
                AssetDatabase.Refresh();
                string first = "Assets" + files[0].Substring(Application.dataPath.Length).Replace('\\', '/');
                EditorUtility.DisplayDialog(
                    "Twin",
                    files.Count + " files, the first is " + first + ".\n\nA GLB needs the package glTFast "
                        + "(com.unity.cloud.gltfast) to become a model.",
                    "OK");
            }
            catch (Exception error)
            {
                if (!(error is IOException || error is FormatException || error is UnauthorizedAccessException))
                {
                    throw;
                }

                EditorUtility.DisplayDialog("Twin: nothing was imported", error.Message, "OK");
            }
        }

        /// <summary>Copy &lt;robot&gt;.glb and tracks/*.json to &lt;assets&gt;/Twin/&lt;robot&gt; and return the new files,
        /// the model first.</summary>
        /// <exception cref="FormatException">The folder is not a bundle, or a track is invalid or for another robot; in
        /// these cases, no file is copied.</exception>
        public static List<string> Copy(string bundle, string assets)
        {
            string[] models = Directory.Exists(bundle) ? Directory.GetFiles(bundle, "*.glb") : new string[0];
            if (models.Length != 1)
            {
                throw new FormatException(bundle + " contains " + models.Length + " GLB files, expected one: "
                    + "export again with `twin export <robot> --to glb,tracks,unity`");
            }

            string robot = Path.GetFileNameWithoutExtension(models[0]);
            string tracks = Path.Combine(bundle, "tracks");
            string[] found = Directory.Exists(tracks) ? Directory.GetFiles(tracks, "*.json") : new string[0];
            Array.Sort(found, StringComparer.Ordinal);
            var from = new List<string> { models[0] };
            foreach (string file in found)
            {
                if (file.EndsWith(".schema.json", StringComparison.Ordinal))
                {
                    continue;
                }

                Check(file, robot);
                from.Add(file);
            }

            string target = Path.Combine(Path.Combine(assets, "Twin"), robot);
            Directory.CreateDirectory(target);
            var copied = new List<string>();
            foreach (string file in from)
            {
                string copy = Path.Combine(target, Path.GetFileName(file));
                File.Copy(file, copy, true);
                copied.Add(copy);
            }

            return copied;
        }

        private static void Check(string file, string robot)
        {
            try
            {
                Track track = Track.Parse(File.ReadAllText(file));
                if (track.robot != robot)
                {
                    throw new FormatException("the track is for robot '" + track.robot + "', not '" + robot + "'");
                }
            }
            catch (FormatException error)
            {
                throw new FormatException(Path.GetFileName(file) + ": " + error.Message, error);
            }
        }
    }
}
