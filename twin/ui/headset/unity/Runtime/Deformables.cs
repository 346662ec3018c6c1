using System;
using UnityEngine;

namespace Twin.Player
{
    /// <summary>Draws the deformable bodies of a scene, such as soft organs, from the frames of a Stream Client.</summary>
    /// <remarks>Each deformable becomes a child of this object, with a mesh whose vertices are those of the displayed
    /// frame. This object stands where the scene's world does, rotated as the root of the models: for glTFast by -90
    /// degrees about x.</remarks>
    [AddComponentMenu("Twin/Deformables")]
    [DisallowMultipleComponent]
    public sealed class Deformables : MonoBehaviour
    {
        [Tooltip("The Stream Client of one robot of the scene.")]
        public StreamClient stream;

        [Tooltip("The importer of the models; it sets the axes.")]
        public Convention convention = Convention.GltFast;

        [Tooltip("Material of the deformables; each one gets a copy with its own colour.")]
        public Material material;

        private RobotDescription described;
        private StreamFrame shown;
        private uint sequence;
        private Mesh[] meshes = new Mesh[0];
        private Vector3[][] vertices = new Vector3[0][];
        private string reported = "";

        /// <summary>Number of deformables of the scene.</summary>
        public int Count
        {
            get { return meshes.Length; }
        }

        /// <summary>Return the mesh of a deformable by its index in scene.json.</summary>
        public Mesh MeshOf(int index)
        {
            return meshes[index];
        }

        /// <summary>Show the vertices of the stream's newest frame; Update calls this method in each frame.</summary>
        public void Tick()
        {
            if (stream == null || stream.Robot == null || stream.Frame == null)
            {
                return;
            }

            if (!ReferenceEquals(described, stream.Robot))
            {
                described = stream.Robot;
                shown = null;
                Build(described.deformables);
            }

            StreamFrame frame = stream.Frame;
            if (ReferenceEquals(shown, frame) && sequence == frame.Sequence)
            {
                return;
            }

            shown = frame;
            sequence = frame.Sequence;
            for (int i = 0; i < meshes.Length && i < frame.Fields.Length; i++)
            {
                Show(i, frame.Fields[i]);
            }
        }

        private void Build(DeformableDescription[] found)
        {
            for (int i = transform.childCount - 1; i >= 0; i--)
            {
                Destroy(transform.GetChild(i).gameObject);
            }

            meshes = new Mesh[found.Length];
            vertices = new Vector3[found.Length][];
            for (int i = 0; i < found.Length; i++)
            {
                var body = new GameObject(found[i].name);
                body.transform.SetParent(transform, false);
                meshes[i] = new Mesh { name = found[i].name };
                meshes[i].MarkDynamic();
                vertices[i] = new Vector3[0];
                body.AddComponent<MeshFilter>().sharedMesh = meshes[i];
                if (material != null)
                {
                    float[] c = found[i].color;
                    body.AddComponent<MeshRenderer>().material =
                        new Material(material) { color = new Color(c[0], c[1], c[2], found[i].opacity) };
                }
            }
        }

        private void Show(int index, float[] points)
        {
            if (points.Length == 0)
            {
                return; // unknown at this time
            }

            bool first = vertices[index].Length != points.Length / 3;
            if (first)
            {
                vertices[index] = new Vector3[points.Length / 3];
            }

            Vector3[] to = vertices[index];
            for (int i = 0; i < to.Length; i++)
            {
                to[i] = Frames.ToUnity(new Vector3(points[3 * i], points[3 * i + 1], points[3 * i + 2]), convention);
            }

            Mesh mesh = meshes[index];
            if (first)
            {
                int[] triangles = described.deformables[index].Mirrored();
                if (triangles.Length == 0 || LargestOf(triangles) >= to.Length)
                {
                    Report("'" + mesh.name + "' has " + to.Length + " vertices; its triangles need others");
                    return;
                }

                mesh.Clear();
                mesh.vertices = to;
                mesh.triangles = triangles;
            }
            else
            {
                mesh.vertices = to;
            }

            mesh.RecalculateNormals();
            mesh.RecalculateBounds();
        }

        private static int LargestOf(int[] values)
        {
            int largest = values[0];
            foreach (int value in values)
            {
                largest = Math.Max(largest, value);
            }

            return largest;
        }

        private void Report(string fault)
        {
            if (reported != fault) // report an error once, not in each frame
            {
                reported = fault;
                Debug.LogError("Deformables: " + fault, this);
            }
        }

        private void Update()
        {
            Tick();
        }
    }
}
