using System;
using System.Text;
using UnityEngine;

namespace Twin.Player
{
    /// <summary>A binary glTF 2.0 file (.glb) as twin writes it: a JSON part and one buffer.</summary>
    internal sealed class GlbFile
    {
        public const int Float = 5126;
        public const int UInt32 = 5125;

        private const uint Magic = 0x46546C67;
        private const uint Json = 0x4E4F534A;
        private const uint Binary = 0x004E4942;

        private readonly byte[] data;
        private readonly int buffer;

        /// <summary>Read the header and the JSON part.</summary>
        /// <exception cref="FormatException">The file is truncated, or is not a .glb file.</exception>
        public GlbFile(byte[] data)
        {
            this.data = data;
            if (data.Length < 28 || U32(0) != Magic || U32(4) != 2)
            {
                throw new FormatException("not a .glb file of version 2: " + data.Length + " bytes");
            }

            uint text = U32(12);
            if (U32(8) != data.Length || U32(16) != Json || text > data.Length - 28)
            {
                throw new FormatException("the .glb file is truncated: " + data.Length + " bytes of " + U32(8));
            }

            buffer = 28 + (int)text;
            if (U32(buffer - 4) != Binary || U32(buffer - 8) != data.Length - buffer)
            {
                throw new FormatException("the .glb file has no buffer that ends with the file");
            }

            try
            {
                Document = JsonUtility.FromJson<GlbDocument>(Encoding.UTF8.GetString(data, 20, (int)text));
            }
            catch (ArgumentException error)
            {
                throw new FormatException("the JSON part of the .glb file is invalid: " + error.Message, error);
            }
        }

        public GlbDocument Document { get; private set; }

        /// <summary>Return the numbers of an accessor in single precision, `width` for each element.</summary>
        /// <exception cref="FormatException">It does not exist, has another type, or is not within the file.</exception>
        public float[] Floats(int accessor, int width)
        {
            var values = new float[Count(accessor, Float, width) * width];
            Buffer.BlockCopy(data, Start(accessor, 4 * values.Length), values, 0, 4 * values.Length);
            foreach (float value in values)
            {
                if (float.IsNaN(value) || float.IsInfinity(value))
                {
                    throw new FormatException("accessor " + accessor + " has a value that is not finite");
                }
            }

            return values;
        }

        /// <summary>Return the numbers of an accessor of indices of 32 bits.</summary>
        /// <exception cref="FormatException">As for Floats, or an index is not below `limit`.</exception>
        public int[] Indices(int accessor, int limit)
        {
            var values = new int[Count(accessor, UInt32, 1)];
            Buffer.BlockCopy(data, Start(accessor, 4 * values.Length), values, 0, 4 * values.Length);
            foreach (int value in values)
            {
                if (value < 0 || value >= limit)
                {
                    throw new FormatException("accessor " + accessor + " refers to vertex " + value + " of " + limit);
                }
            }

            return values;
        }

        private int Count(int accessor, int component, int width)
        {
            GlbAccessor found = At(Document.accessors, accessor, "accessor");
            string type = width == 3 ? "VEC3" : "SCALAR";
            if (found.componentType != component || found.type != type || found.count < 1 || found.count > data.Length)
            {
                throw new FormatException("accessor " + accessor + " has " + found.count + " elements of type "
                    + found.type + ", " + found.componentType + "; expected " + type + ", " + component);
            }

            return found.count;
        }

        private int Start(int accessor, int bytes)
        {
            GlbAccessor found = Document.accessors[accessor];
            GlbView view = At(Document.bufferViews, found.bufferView, "buffer view");
            int element = bytes / found.count;
            long start = (long)view.byteOffset + found.byteOffset;
            bool within = found.byteOffset >= 0 && view.byteOffset >= 0
                && (long)found.byteOffset + bytes <= view.byteLength
                && (long)view.byteOffset + view.byteLength <= data.Length - buffer;
            if (!within || (view.byteStride != 0 && view.byteStride != element))
            {
                throw new FormatException("accessor " + accessor + " is not within its buffer view, or not tightly packed");
            }

            return buffer + (int)start;
        }

        /// <summary>Return an entry of a list by its index.</summary>
        /// <exception cref="FormatException">There is no such entry.</exception>
        public static T At<T>(T[] list, int index, string what)
        {
            if (index < 0 || index >= list.Length)
            {
                throw new FormatException("there is no " + what + " " + index + " of " + list.Length);
            }

            return list[index];
        }

        private uint U32(int at)
        {
            return data[at] | (uint)data[at + 1] << 8 | (uint)data[at + 2] << 16 | (uint)data[at + 3] << 24;
        }
    }

    /// <summary>The JSON part of a .glb file; names as in glTF 2.0, as JsonUtility requires.</summary>
    [Serializable]
    internal sealed class GlbDocument
    {
        public GlbAsset asset = new GlbAsset();
        public GlbNode[] nodes = new GlbNode[0];
        public GlbMesh[] meshes = new GlbMesh[0];
        public GlbMaterial[] materials = new GlbMaterial[0];
        public GlbAnimation[] animations = new GlbAnimation[0];
        public GlbAccessor[] accessors = new GlbAccessor[0];
        public GlbView[] bufferViews = new GlbView[0];
    }

    [Serializable]
    internal sealed class GlbAsset
    {
        public GlbExtras extras = new GlbExtras();
    }

    [Serializable]
    internal sealed class GlbExtras
    {
        public string schema = "";
        public int version = 0;
    }

    [Serializable]
    internal sealed class GlbNode
    {
        public string name = "";
        public int mesh = -1;
        public int[] children = new int[0];
    }

    [Serializable]
    internal sealed class GlbMesh
    {
        public GlbPrimitive[] primitives = new GlbPrimitive[0];
    }

    [Serializable]
    internal sealed class GlbPrimitive
    {
        public GlbAttributes attributes = new GlbAttributes();
        public GlbAttributes[] targets = new GlbAttributes[0];
        public int indices = -1;
        public int material = -1;
    }

    [Serializable]
    internal sealed class GlbAttributes
    {
        public int POSITION = -1;
    }

    [Serializable]
    internal sealed class GlbMaterial
    {
        public GlbSurface pbrMetallicRoughness = new GlbSurface();
    }

    [Serializable]
    internal sealed class GlbSurface
    {
        public float[] baseColorFactor = new float[0];
    }

    [Serializable]
    internal sealed class GlbAnimation
    {
        public GlbChannel[] channels = new GlbChannel[0];
        public GlbSampler[] samplers = new GlbSampler[0];
    }

    [Serializable]
    internal sealed class GlbChannel
    {
        public int sampler = -1;
        public GlbTarget target = new GlbTarget();
    }

    [Serializable]
    internal sealed class GlbTarget
    {
        public int node = -1;
        public string path = "";
    }

    [Serializable]
    internal sealed class GlbSampler
    {
        public int input = -1;
        public int output = -1;
        public string interpolation = "";
    }

    [Serializable]
    internal sealed class GlbAccessor
    {
        public int bufferView = -1;
        public int byteOffset = 0;
        public int componentType = 0;
        public int count = 0;
        public string type = "";
    }

    [Serializable]
    internal sealed class GlbView
    {
        public int byteOffset = 0;
        public int byteLength = 0;
        public int byteStride = 0;
    }
}
