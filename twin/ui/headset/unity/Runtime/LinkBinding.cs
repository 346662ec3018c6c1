using System;
using System.Collections.Generic;
using UnityEngine;

namespace Twin.Player
{
    /// <summary>Return the pose of a link in the robot's world.</summary>
    public delegate void PoseSource(int link, out Vector3 position, out Quaternion rotation);

    /// <summary>The Transforms of a model for the links of a robot, found by name.</summary>
    /// <remarks>In a GLB of twin, all links are children of one root node. Each link then gets a local pose, and the
    /// whole model may be moved, rotated and scaled. Nested links (URDF-Importer) are placed in Unity's world,
    /// parents first.</remarks>
    public sealed class LinkBinding
    {
        private readonly Transform[] links;
        private readonly int[] order;
        private readonly bool flat;

        /// <summary>Find the links below a model.</summary>
        /// <exception cref="ArgumentException">A link is missing, or several Transforms have its name.</exception>
        public LinkBinding(Transform model, string[] names, Convention convention)
        {
            if (model == null)
            {
                throw new ArgumentException("no model: assign the imported robot");
            }

            Convention = convention;
            links = Find(model, names);
            order = ByDepth(links);
            Root = links[0].parent;
            flat = Root != null;
            foreach (Transform link in links)
            {
                flat = flat && link.parent == Root;
            }

            if (!flat)
            {
                Root = model;
            }
        }

        /// <summary>The Transform to which poses converted by <see cref="Convention"/> are local.</summary>
        public Transform Root { get; private set; }

        public Convention Convention { get; private set; }

        /// <summary>Return the Transform of a link by its index.</summary>
        public Transform Link(int link)
        {
            return links[link];
        }

        /// <summary>Return the index of the link of a Transform (itself or an ancestor), or -1.</summary>
        public int LinkOf(Transform part)
        {
            for (Transform at = part; at != null; at = at.parent)
            {
                int found = Array.IndexOf(links, at);
                if (found >= 0)
                {
                    return found;
                }
            }

            return -1;
        }

        /// <summary>Set the pose of every link.</summary>
        public void Apply(PoseSource source)
        {
            foreach (int link in order)
            {
                Vector3 position;
                Quaternion rotation;
                source(link, out position, out rotation);
                position = Frames.ToUnity(position, Convention);
                rotation = Frames.ToUnity(rotation, Convention);
                if (flat)
                {
                    links[link].localPosition = position;
                    links[link].localRotation = rotation;
                }
                else
                {
                    links[link].SetPositionAndRotation(Root.TransformPoint(position), Root.rotation * rotation);
                }
            }
        }

        /// <summary>Convert a pose from the robot's world to Unity's world.</summary>
        public void ToWorld(ref Vector3 position, ref Quaternion rotation)
        {
            position = Root.TransformPoint(Frames.ToUnity(position, Convention));
            rotation = Root.rotation * Frames.ToUnity(rotation, Convention);
        }

        /// <summary>Convert a pose from Unity's world to the robot's world.</summary>
        public void FromWorld(ref Vector3 position, ref Quaternion rotation)
        {
            position = Frames.FromUnity(Root.InverseTransformPoint(position), Convention);
            rotation = Frames.FromUnity(Quaternion.Inverse(Root.rotation) * rotation, Convention);
        }

        private static Transform[] Find(Transform model, string[] names)
        {
            var wanted = new Dictionary<string, int>();
            for (int i = 0; i < names.Length; i++)
            {
                wanted[names[i]] = i;
            }

            var found = new Transform[names.Length];
            var twice = new List<string>();
            Walk(model, wanted, found, twice);
            var missing = new List<string>();
            for (int i = 0; i < names.Length; i++)
            {
                if (found[i] == null)
                {
                    missing.Add(names[i]);
                }
            }

            if (missing.Count > 0)
            {
                throw new ArgumentException("model '" + model.name + "' has no Transform named "
                    + string.Join(", ", missing.ToArray()) + ": is it the robot of this motion?");
            }

            if (twice.Count > 0)
            {
                throw new ArgumentException("model '" + model.name + "' has more than one Transform named "
                    + string.Join(", ", twice.ToArray()) + ": names of links must be unique below the model");
            }

            return found;
        }

        private static void Walk(
            Transform at, Dictionary<string, int> wanted, Transform[] found, List<string> twice)
        {
            int link;
            if (wanted.TryGetValue(at.name, out link))
            {
                if (found[link] != null)
                {
                    twice.Add(at.name);
                }

                found[link] = at;
            }

            for (int i = 0; i < at.childCount; i++)
            {
                Walk(at.GetChild(i), wanted, found, twice);
            }
        }

        private static int[] ByDepth(Transform[] links)
        {
            var depths = new int[links.Length];
            var order = new int[links.Length];
            for (int i = 0; i < links.Length; i++)
            {
                order[i] = i;
                for (Transform at = links[i].parent; at != null; at = at.parent)
                {
                    depths[i]++;
                }
            }

            Array.Sort(depths, order);
            return order;
        }
    }
}
