using System;
using System.IO;
using System.Text;
using NUnit.Framework;
using UnityEngine;

namespace Twin.Player.Tests
{
    [TestFixture]
    public sealed class DeformableTests
    {
        // A triangle with two shapes: its third corner moves along x, and along z; keys at 0, 1 and 3 s.
        private static readonly float[] Rest = { 0.1f, 0f, 0f, 0f, 0.2f, 0f, 0f, 0f, 0.3f };
        private static readonly float[] AlongX = { 0f, 0f, 0f, 0f, 0f, 0f, 0.04f, 0f, 0f };
        private static readonly float[] AlongZ = { 0f, 0f, 0f, 0f, 0f, 0f, 0f, 0f, 0.08f };
        private static readonly float[] Times = { 0f, 1f, 3f };
        private static readonly float[] Factors = { 0f, 0f, 1f, 0f, 0.5f, 1f };

        private GameObject root;
        private DeformablePlayer player;

        [SetUp]
        public void Make()
        {
            root = new GameObject("organs");
            player = root.AddComponent<DeformablePlayer>();
            player.Load(Example());
        }

        [TearDown]
        public void Destroy()
        {
            UnityEngine.Object.DestroyImmediate(root);
        }

        [Test]
        public void VerticesAreLinearBetweenKeys()
        {
            Shown(0.0, 0f, 0.3f);
            Shown(0.25, 0.01f, 0.3f);
            Shown(1.0, 0.04f, 0.3f);
            Shown(2.0, 0.03f, 0.34f);
            Shown(3.0, 0.02f, 0.38f);
            Shown(9.0, 0.02f, 0.38f);
            Shown(-1.0, 0f, 0.3f);
        }

        [Test]
        public void TheMeshIsMirroredWithTheCoordinates()
        {
            Assert.AreEqual(new[] { 2, 1, 0 }, player.MeshOf(0).triangles);
            Assert.AreEqual(new[] { 0, 1, 2 }, player.Motion.TrianglesOf(0));
            Assert.AreEqual("liver", player.MeshOf(0).name);
            Vector3 first = player.MeshOf(0).vertices[0];
            Assert.That(Vector3.Distance(first, new Vector3(-0.1f, 0f, 0f)), Is.LessThan(1e-7f));
        }

        [Test]
        public void ItPlaysLoopsAndStops()
        {
            player.Tick(0.5);
            Assert.AreEqual(0.0, player.Time);
            player.Play();
            player.Tick(0.5);
            Assert.That(player.Time, Is.EqualTo(0.5).Within(1e-12));
            player.Tick(3.0);
            Assert.That(player.Time, Is.EqualTo(0.5).Within(1e-12));
            player.loop = false;
            player.Tick(3.0);
            Assert.AreEqual(3.0, player.Time);
            Assert.IsFalse(player.IsPlaying);
            player.Play();
            Assert.AreEqual(0.0, player.Time);
            player.Pause();
            Assert.IsFalse(player.IsPlaying);
        }

        [Test]
        public void ItShowsTheTimeOfATrackPlayer()
        {
            Golden golden = Golden.Load();
            GameObject model = golden.Model(Convention.GltFast);
            try
            {
                player.player = model.AddComponent<TrackPlayer>();
                player.player.Load(golden.track);
                player.player.Seek(1.5);
                player.Tick(10.0);
                Assert.That(player.Time, Is.EqualTo(1.5).Within(1e-12));
                Assert.That(player.MeshOf(0).vertices[2].z, Is.EqualTo(0.32f).Within(1e-7f));
            }
            finally
            {
                UnityEngine.Object.DestroyImmediate(model);
            }
        }

        [Test]
        public void AnotherFileReplacesTheFirst()
        {
            player.Load(Example());
            Assert.AreEqual(1, player.Motion.Count);
            Shown(2.0, 0.03f, 0.34f);
        }

        [Test]
        public void ADamagedFileIsRefusedAndChangesNothing()
        {
            byte[] good = Example();
            Refused("not a .glb file", new byte[10]);
            Refused("is truncated", Cut(good, good.Length - 4));
            Refused("invalid", File("{\"asset\":", Factors, 2));
            Refused("schema 'xormables', version 1; expected twin-deformables", File(Text().Replace("twin-def", "x"), Factors, 2));
            Refused("'liver': accessor 3 has 3 elements of type SCALAR", File(Text().Replace("\"POSITION\":0", "\"POSITION\":3"), Factors, 2));
            Refused("'liver': accessor 5 refers to vertex 7 of 3", File(Text(), Factors, 7));
            Refused("'liver': 3 numbers for its colour, expected 4", File(Text().Replace("0.1,1]", "0.1]"), Factors, 2));
            Refused("'liver': 2 indices of triangles, expected a multiple of 3", File(Text().Replace("5125,\"count\":3", "5125,\"count\":2"), Factors, 2));
            Refused("is not within its buffer view", File(Text().Replace("\"count\":3,\"type\":\"VEC3\"", "\"count\":30,\"type\":\"VEC3\""), Factors, 2));
            Refused("interpolation 'STEP'", File(Text().Replace("LINEAR", "STEP"), Factors, 2));
            Refused("no animation moves its 2 shapes", File(Text().Replace("weights", "scale"), Factors, 2));
            Refused("there is no mesh -1", File(Text().Replace("\"mesh\":0", "\"x\":0"), Factors, 2));
            float[] infinite = (float[])Factors.Clone();
            infinite[2] = float.NaN;
            Refused("not finite", File(Text(), infinite, 2));
            Assert.AreEqual(3.0, player.Motion.Duration);
            Shown(1.0, 0.04f, 0.3f);
        }

        [Test]
        public void AFaultOfADescriptionIsNamed()
        {
            DescriptionRefused("'liver' has 3 bytes of triangles, expected a multiple of 12", "AAAA", "1,1,1");
            DescriptionRefused("'liver' has 2 numbers for its colour, expected 3", "", "1,1");
        }

        [Test]
        public void NothingIsPlayedWithoutAFile()
        {
            var empty = new GameObject("empty").AddComponent<DeformablePlayer>();
            empty.Tick(1.0);
            empty.Seek(1.0);
            Assert.Throws<InvalidOperationException>(empty.Play);
        }

        private void Shown(double time, float x, float z)
        {
            player.Seek(time);
            Vector3 wanted = Frames.ToUnity(new Vector3(x, 0f, z), Convention.GltFast);
            Assert.That(Vector3.Distance(player.MeshOf(0).vertices[2], wanted), Is.LessThan(1e-7f));
        }

        private void Refused(string expected, byte[] file)
        {
            var error = Assert.Throws<FormatException>(() => player.Load(file));
            StringAssert.Contains(expected, error.Message);
        }

        private static void DescriptionRefused(string expected, string triangles, string color)
        {
            string field = "{\"name\":\"liver\",\"triangles\":\"" + triangles + "\",\"color\":[" + color + "]}";
            var error = Assert.Throws<FormatException>(() => SceneDescription.Parse(
                "{\"schema\":\"twin-scene\",\"version\":1,\"fields\":[" + field + "]}"));
            Assert.AreEqual("scene.json, fields: " + expected, error.Message);
        }

        /// <summary>Return the bytes of a file with one deformable.</summary>
        public static byte[] Example()
        {
            return File(Text(), Factors, 2);
        }

        private static string Text()
        {
            return "{\"asset\":{\"version\":\"2.0\",\"extras\":{\"schema\":\"twin-deformables\",\"version\":1}},"
                + "\"nodes\":[{\"name\":\"organs\",\"children\":[1]},{\"name\":\"liver\",\"mesh\":0}],"
                + "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":5,\"material\":0,"
                + "\"targets\":[{\"POSITION\":1},{\"POSITION\":2}]}]}],"
                + "\"materials\":[{\"pbrMetallicRoughness\":{\"baseColorFactor\":[0.5,0.2,0.1,1]}}],"
                + "\"animations\":[{\"channels\":[{\"sampler\":0,\"target\":{\"node\":1,\"path\":\"weights\"}}],"
                + "\"samplers\":[{\"input\":3,\"output\":4,\"interpolation\":\"LINEAR\"}]}],"
                + "\"accessors\":[" + Accessor(0, 0, 3, "VEC3") + "," + Accessor(0, 36, 3, "VEC3") + ","
                + Accessor(0, 72, 3, "VEC3") + "," + Accessor(1, 0, 3, "SCALAR") + "," + Accessor(1, 12, 6, "SCALAR")
                + ",{\"bufferView\":2,\"byteOffset\":0,\"componentType\":5125,\"count\":3,\"type\":\"SCALAR\"}],"
                + "\"bufferViews\":[{\"byteOffset\":0,\"byteLength\":108,\"byteStride\":12},"
                + "{\"byteOffset\":108,\"byteLength\":36},{\"byteOffset\":144,\"byteLength\":12}]}";
        }

        private static string Accessor(int view, int at, int count, string type)
        {
            return "{\"bufferView\":" + view + ",\"byteOffset\":" + at + ",\"componentType\":5126,\"count\":" + count
                + ",\"type\":\"" + type + "\"}";
        }

        private static byte[] File(string json, float[] factors, int corner)
        {
            byte[] text = Encoding.UTF8.GetBytes(json.PadRight((json.Length + 3) / 4 * 4));
            using (var stream = new MemoryStream())
            using (var writer = new BinaryWriter(stream))
            {
                writer.Write(0x46546C67u);
                writer.Write(2u);
                writer.Write((uint)(28 + text.Length + 156));
                writer.Write((uint)text.Length);
                writer.Write(0x4E4F534Au);
                writer.Write(text);
                writer.Write(156u);
                writer.Write(0x004E4942u);
                foreach (float[] numbers in new[] { Rest, AlongX, AlongZ, Times, factors })
                {
                    foreach (float number in numbers)
                    {
                        writer.Write(number);
                    }
                }

                writer.Write(0);
                writer.Write(1);
                writer.Write(corner);
                return stream.ToArray();
            }
        }

        private static byte[] Cut(byte[] from, int length)
        {
            var copy = new byte[length];
            Array.Copy(from, copy, length);
            return copy;
        }
    }
}
