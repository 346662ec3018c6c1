using System;

namespace Twin.Player
{
    /// <summary>The motion of the deformables of a scene, such as soft organs: the file organs.glb that `twin export`
    /// writes.</summary>
    /// <remarks>Vertices are those at rest plus a sum of shapes (morph targets), each times a factor that is linear
    /// between keys. They are in the scene's world: right-handed, z up, m.</remarks>
    public sealed class DeformableMotion
    {
        public const string Schema = "twin-deformables";
        public const int Version = 1;

        private readonly Body[] bodies;

        private DeformableMotion(Body[] bodies)
        {
            this.bodies = bodies;
            foreach (Body body in bodies)
            {
                Duration = Math.Max(Duration, body.Times[body.Times.Length - 1]);
            }
        }

        /// <summary>Number of deformables.</summary>
        public int Count
        {
            get { return bodies.Length; }
        }

        /// <summary>Time of the last key in s; the first key is at 0.</summary>
        public double Duration { get; private set; }

        /// <summary>Read a file.</summary>
        /// <exception cref="FormatException">It is not a file of deformables, or it is damaged; the message gives the
        /// deformable, the value and the expected value.</exception>
        public static DeformableMotion Parse(byte[] glb)
        {
            var file = new GlbFile(glb);
            GlbDocument document = file.Document;
            GlbExtras about = document.asset.extras;
            if (about.schema != Schema || about.version != Version)
            {
                throw new FormatException("schema '" + about.schema + "', version " + about.version + "; expected "
                    + Schema + ", " + Version + ": use organs.glb of `twin export <scene>`");
            }

            int[] children = GlbFile.At(document.nodes, 0, "node").children;
            var found = new Body[children.Length];
            for (int i = 0; i < found.Length; i++)
            {
                string name = GlbFile.At(document.nodes, children[i], "node").name;
                try
                {
                    found[i] = Read(file, children[i]);
                }
                catch (FormatException error)
                {
                    throw new FormatException("'" + name + "': " + error.Message, error);
                }
            }

            if (found.Length == 0)
            {
                throw new FormatException("the file has no deformables");
            }

            return new DeformableMotion(found);
        }

        public string NameOf(int body)
        {
            return bodies[body].Name;
        }

        /// <summary>Return red, green, blue (linear) and opacity, each 0 to 1.</summary>
        public float[] ColorOf(int body)
        {
            return (float[])bodies[body].Color.Clone();
        }

        /// <summary>Return three indices of vertices for each triangle, counter-clockwise as seen from outside.</summary>
        public int[] TrianglesOf(int body)
        {
            return (int[])bodies[body].Triangles.Clone();
        }

        /// <summary>Return the length of the array for `Sample`: three numbers for each vertex.</summary>
        public int SizeOf(int body)
        {
            return bodies[body].Rest.Length;
        }

        /// <summary>Compute the vertices (x y z each) at a time (s), which is clamped to the duration.</summary>
        public void Sample(int body, double time, float[] vertices)
        {
            Body b = bodies[body];
            if (vertices.Length != b.Rest.Length)
            {
                throw new ArgumentException("'" + b.Name + "' needs an array of " + b.Rest.Length + " numbers, not "
                    + vertices.Length);
            }

            int key;
            double share;
            Keys.Locate(b.Times, time, out key, out share);
            Array.Clear(vertices, 0, vertices.Length);
            for (int s = 0; s < b.Shapes.Length; s++)
            {
                double factor = b.Factors[key * b.Shapes.Length + s];
                if (share > 0.0)
                {
                    factor += share * (b.Factors[(key + 1) * b.Shapes.Length + s] - factor);
                }

                if (factor != 0.0)
                {
                    Add((float)factor, b.Shapes[s], vertices);
                }
            }

            Add(1f, b.Rest, vertices); // last: the sum of small displacements loses no digits
        }

        private static void Add(float factor, float[] shape, float[] to)
        {
            for (int i = 0; i < to.Length; i++)
            {
                to[i] += factor * shape[i];
            }
        }

        private static Body Read(GlbFile file, int node)
        {
            GlbDocument document = file.Document;
            GlbMesh mesh = GlbFile.At(document.meshes, document.nodes[node].mesh, "mesh");
            GlbPrimitive primitive = GlbFile.At(mesh.primitives, 0, "primitive");
            var body = new Body
            {
                Name = document.nodes[node].name,
                Rest = file.Floats(primitive.attributes.POSITION, 3),
                Shapes = new float[primitive.targets.Length][],
                Color = GlbFile.At(document.materials, primitive.material, "material").pbrMetallicRoughness.baseColorFactor,
            };
            body.Triangles = file.Indices(primitive.indices, body.Rest.Length / 3);
            if (body.Triangles.Length % 3 != 0)
            {
                throw new FormatException(body.Triangles.Length + " indices of triangles, expected a multiple of 3");
            }

            if (body.Color.Length != 4)
            {
                throw new FormatException(body.Color.Length + " numbers for its colour, expected 4");
            }

            for (int s = 0; s < body.Shapes.Length; s++)
            {
                body.Shapes[s] = file.Floats(primitive.targets[s].POSITION, 3);
                if (body.Shapes[s].Length != body.Rest.Length)
                {
                    throw new FormatException("shape " + s + " has " + body.Shapes[s].Length / 3 + " vertices, expected "
                        + body.Rest.Length / 3);
                }
            }

            ReadKeys(file, node, body);
            return body;
        }

        private static void ReadKeys(GlbFile file, int node, Body body)
        {
            foreach (GlbAnimation animation in file.Document.animations)
            {
                foreach (GlbChannel channel in animation.channels)
                {
                    if (channel.target.node == node && channel.target.path == "weights")
                    {
                        GlbSampler sampler = GlbFile.At(animation.samplers, channel.sampler, "sampler");
                        body.Times = Array.ConvertAll(file.Floats(sampler.input, 1), t => (double)t);
                        body.Factors = file.Floats(sampler.output, 1);
                        Require(body, sampler.interpolation);
                        return;
                    }
                }
            }

            if (body.Shapes.Length > 0)
            {
                throw new FormatException("no animation moves its " + body.Shapes.Length + " shapes");
            }
        }

        private static void Require(Body body, string interpolation)
        {
            if (interpolation != "LINEAR" || body.Factors.Length != body.Times.Length * body.Shapes.Length)
            {
                throw new FormatException("interpolation '" + interpolation + "' with " + body.Factors.Length
                    + " factors; expected LINEAR with " + body.Times.Length + " keys * " + body.Shapes.Length + " shapes");
            }

            for (int k = 1; k < body.Times.Length; k++)
            {
                if (!(body.Times[k] > body.Times[k - 1]))
                {
                    throw new FormatException("key " + k + " is at " + body.Times[k] + " s, not after the key before");
                }
            }
        }

        private sealed class Body
        {
            public string Name;
            public float[] Rest;
            public int[] Triangles;
            public float[] Color;
            public float[][] Shapes;
            public double[] Times = { 0.0 };
            public float[] Factors = new float[0];
        }
    }
}
