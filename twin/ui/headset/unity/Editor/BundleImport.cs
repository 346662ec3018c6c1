using System;
using System.Collections.Generic;
using System.IO;
using System.Text.RegularExpressions;
using UnityEditor;
using UnityEngine;

namespace Twin.Player.Editor
{
    /// <summary>Imports models, tracks and deformables of a folder written by `twin export` into the project.</summary>
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

        /// <summary>Copy the files of a bundle and return the new files: of a robot its model first, of a scene its organs
        /// first, if it has any, then the files of each robot.</summary>
        /// <remarks>A bundle of a robot: &lt;robot&gt;.glb and tracks/*.json to &lt;assets&gt;/Twin/&lt;robot&gt;. A bundle
        /// of a scene: organs.glb as organs.bytes, which Deformable Player reads, to &lt;assets&gt;/Twin/&lt;scene&gt;,
        /// and the bundle of each robot to a folder in it.</remarks>
        /// <exception cref="FormatException">The folder is not a bundle, or a track is invalid or for another robot; in
        /// these cases, no file is copied.</exception>
        public static List<string> Copy(string bundle, string assets)
        {
            string target = Path.Combine(assets, "Twin");
            var copies = new List<KeyValuePair<string, string>>();
            if (File.Exists(Path.Combine(bundle, "scene.json")))
            {
                FindScene(bundle, target, copies);
            }
            else
            {
                FindRobot(bundle, target, "", copies);
            }

            var copied = new List<string>();
            foreach (KeyValuePair<string, string> copy in copies)
            {
                Directory.CreateDirectory(Path.GetDirectoryName(copy.Value));
                File.Copy(copy.Key, copy.Value, true);
                copied.Add(copy.Value);
            }

            return copied;
        }

        private static void FindScene(string bundle, string assets, List<KeyValuePair<string, string>> copies)
        {
            string target = Path.Combine(assets, SceneName(Path.Combine(bundle, "scene.json")));
            string organs = Path.Combine(bundle, "organs.glb");
            if (File.Exists(organs))
            {
                try
                {
                    DeformableMotion.Parse(File.ReadAllBytes(organs));
                }
                catch (FormatException error)
                {
                    throw new FormatException("organs.glb: " + error.Message, error);
                }

                copies.Add(new KeyValuePair<string, string>(organs, Path.Combine(target, "organs.bytes")));
            }

            string[] folders = Directory.GetDirectories(bundle);
            Array.Sort(folders, StringComparer.Ordinal);
            foreach (string folder in folders)
            {
                if (File.Exists(Path.Combine(folder, "proof.json")))
                {
                    FindRobot(folder, target, Path.GetFileName(folder), copies);
                }
            }

            if (copies.Count == 0)
            {
                throw new FormatException(bundle + " contains scene.json, but neither organs.glb nor the folder of a robot: "
                    + "export again with `twin export <scene>`");
            }
        }

        private static void FindRobot(
            string bundle, string target, string place, List<KeyValuePair<string, string>> copies)
        {
            string[] models = Directory.Exists(bundle) ? Directory.GetFiles(bundle, "*.glb") : new string[0];
            if (models.Length != 1)
            {
                throw new FormatException(bundle + " contains " + models.Length + " GLB files, expected one: "
                    + "export again with `twin export <robot> --to glb,tracks,unity`");
            }

            string robot = Path.GetFileNameWithoutExtension(models[0]);
            string folder = Path.Combine(target, place == "" ? robot : place);
            string tracks = Path.Combine(bundle, "tracks");
            string[] found = Directory.Exists(tracks) ? Directory.GetFiles(tracks, "*.json") : new string[0];
            Array.Sort(found, StringComparer.Ordinal);
            copies.Add(new KeyValuePair<string, string>(models[0], Path.Combine(folder, Path.GetFileName(models[0]))));
            foreach (string file in found)
            {
                if (file.EndsWith(".schema.json", StringComparison.Ordinal))
                {
                    continue;
                }

                Check(file, robot);
                copies.Add(new KeyValuePair<string, string>(file, Path.Combine(folder, Path.GetFileName(file))));
            }
        }

        private static string SceneName(string file)
        {
            string name;
            try
            {
                name = JsonUtility.FromJson<SceneFile>(File.ReadAllText(file)).scene;
            }
            catch (ArgumentException error)
            {
                throw new FormatException("scene.json: " + error.Message, error);
            }

            if (!Regex.IsMatch(name, "^[A-Za-z0-9_]+$"))
            {
                throw new FormatException("scene.json: scene '" + name + "' is not a name of letters, digits and _");
            }

            return name;
        }

        [Serializable]
        private sealed class SceneFile
        {
            public string scene = "";
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
