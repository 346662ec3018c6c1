using System;

namespace Twin.Player
{
    /// <summary>A deformable of a scene: its triangles, which do not change; a frame has its vertices.</summary>
    [Serializable]
    public sealed class DeformableDescription
    {
        public string name = "";

        /// <summary>Indices of the corners of the triangles, u32 little endian, as base64.</summary>
        public string triangles = "";

        /// <summary>Red, green, blue, linear, 0 to 1.</summary>
        public float[] color = new float[0];

        public float opacity = 1f;

        /// <summary>Return the indices.</summary>
        public int[] Corners()
        {
            byte[] data = Convert.FromBase64String(triangles);
            var corners = new int[data.Length / 4];
            for (int i = 0; i < corners.Length; i++)
            {
                corners[i] = data[4 * i] | data[4 * i + 1] << 8 | data[4 * i + 2] << 16 | data[4 * i + 3] << 24;
            }

            return corners;
        }

        internal void Check(string file)
        {
            int bytes;
            try
            {
                bytes = Convert.FromBase64String(triangles).Length;
            }
            catch (FormatException error)
            {
                throw new FormatException(file + ": the triangles of '" + name + "' are not base64", error);
            }

            if (bytes % 12 != 0)
            {
                throw new FormatException(file + ": '" + name + "' has " + bytes + " bytes of triangles, expected a "
                    + "multiple of 12");
            }

            if (color.Length != 3)
            {
                throw new FormatException(file + ": '" + name + "' has " + color.Length
                    + " numbers for its colour, expected 3");
            }
        }
    }
}
