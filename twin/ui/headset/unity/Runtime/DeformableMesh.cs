using System;
using UnityEngine;

namespace Twin.Player
{
    /// <summary>The displayed mesh of a deformable, in a new child of an object.</summary>
    internal sealed class DeformableMesh
    {
        private readonly int[] triangles;
        private readonly GameObject body;
        private readonly Material own;
        private Vector3[] vertices = new Vector3[0];

        /// <summary>Create the mesh, without vertices.</summary>
        /// <param name="parent">The object at the origin of the scene's world.</param>
        /// <param name="triangles">Indices of corners, counter-clockwise as seen from outside in the scene's world.</param>
        /// <param name="color">Linear red, green, blue and opacity.</param>
        /// <param name="material">Material that is copied; null: the mesh is not drawn.</param>
        public DeformableMesh(Transform parent, string name, int[] triangles, Color color, Material material)
        {
            this.triangles = Mirrored(triangles);
            body = new GameObject(name);
            body.transform.SetParent(parent, false);
            Mesh = new Mesh { name = name };
            Mesh.MarkDynamic();
            body.AddComponent<MeshFilter>().sharedMesh = Mesh;
            if (material != null)
            {
                own = new Material(material) { color = color.gamma }; // Unity stores the colour of a material as sRGB
                body.AddComponent<MeshRenderer>().sharedMaterial = own;
            }
        }

        public Mesh Mesh { get; private set; }

        /// <summary>Destroy the children that were created, with their meshes and copies of the material.</summary>
        public static void Destroy(DeformableMesh[] meshes)
        {
            foreach (DeformableMesh mesh in meshes)
            {
                Destroy(mesh.body);
                Destroy(mesh.Mesh);
                Destroy(mesh.own);
            }
        }

        /// <summary>Show vertices, x y z each in the scene's world, z up; return a fault, or "".</summary>
        public string Show(float[] points, Convention convention)
        {
            bool first = vertices.Length != points.Length / 3;
            if (first)
            {
                vertices = new Vector3[points.Length / 3];
            }

            for (int i = 0; i < vertices.Length; i++)
            {
                vertices[i] = Frames.ToUnity(new Vector3(points[3 * i], points[3 * i + 1], points[3 * i + 2]), convention);
            }

            if (first)
            {
                if (triangles.Length == 0 || Largest(triangles) >= vertices.Length)
                {
                    string need = triangles.Length == 0
                        ? "it has no triangles"
                        : "its triangles need " + (Largest(triangles) + 1);
                    return "'" + Mesh.name + "' has " + vertices.Length + " vertices; " + need;
                }

                Mesh.Clear();
                Mesh.vertices = vertices;
                Mesh.triangles = triangles;
            }
            else
            {
                Mesh.vertices = vertices;
            }

            Mesh.RecalculateNormals();
            Mesh.RecalculateBounds();
            return "";
        }

        private static void Destroy(UnityEngine.Object made)
        {
            if (Application.isPlaying)
            {
                UnityEngine.Object.Destroy(made);
            }
            else
            {
                UnityEngine.Object.DestroyImmediate(made);
            }
        }

        // Reverse the corners of each triangle, because Unity's coordinates are mirrored.
        private static int[] Mirrored(int[] corners)
        {
            var reversed = new int[corners.Length];
            for (int i = 0; i < corners.Length; i++)
            {
                reversed[i] = corners[i - i % 3 + 2 - i % 3];
            }

            return reversed;
        }

        private static int Largest(int[] values)
        {
            int largest = values[0];
            foreach (int value in values)
            {
                largest = Math.Max(largest, value);
            }

            return largest;
        }
    }
}
