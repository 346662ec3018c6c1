using System.Reflection;
using NUnit.Framework;
using UnityEngine;

namespace Twin.Player.Editor.Tests
{
    /// <summary>In the editor, what is destroyed is gone at once; in a running scene, at the end of the frame.</summary>
    [TestFixture]
    public sealed class DeformableLifetimeTests
    {
        private GameObject root;
        private GameObject robot;
        private DeformablePlayer player;

        [SetUp]
        public void Make()
        {
            root = new GameObject("model");
            robot = new GameObject("robot");
            robot.transform.SetParent(root.transform, false);
            player = root.AddComponent<DeformablePlayer>();
            player.material = new Material(Shader.Find("Sprites/Default"));
            player.Load(Twin.Player.Tests.DeformableTests.Example());
        }

        [TearDown]
        public void Destroy()
        {
            Object.DestroyImmediate(player.material);
            Object.DestroyImmediate(root);
        }

        [Test]
        public void TheColourOfTheMaterialIsSrgb()
        {
            Color color = Drawn().sharedMaterial.color; // linear: 0.5, 0.2, 0.1
            Assert.That(color.r, Is.EqualTo(0.7354f).Within(1e-3f));
            Assert.That(color.g, Is.EqualTo(0.4845f).Within(1e-3f));
            Assert.That(color.b, Is.EqualTo(0.3492f).Within(1e-3f));
            Assert.AreEqual(1f, color.a);
        }

        [Test]
        public void AnotherFileReplacesWhatTheFirstMadeAndNothingElse()
        {
            MeshRenderer drawn = Drawn();
            Mesh mesh = player.MeshOf(0);
            Material material = drawn.sharedMaterial;
            player.Load(Twin.Player.Tests.DeformableTests.Example());
            Assert.IsTrue(drawn.gameObject == null);
            Assert.IsTrue(mesh == null);
            Assert.IsTrue(material == null);
            Assert.IsTrue(robot != null);
            Assert.IsTrue(player.material != null);
            Assert.IsTrue(player.MeshOf(0) != null);
        }

        [Test]
        public void APlayerThatIsRemovedLeavesNothing()
        {
            MeshRenderer drawn = Drawn();
            Mesh mesh = player.MeshOf(0);
            Material material = drawn.sharedMaterial;
            Call("OnDestroy"); // in the editor, Unity does not call it
            Assert.IsTrue(drawn.gameObject == null);
            Assert.IsTrue(mesh == null);
            Assert.IsTrue(material == null);
            Assert.IsTrue(robot != null);
        }

        [Test]
        public void APausedTrackMovesNothingAndThePlayerFollowsIt()
        {
            Golden golden = Golden.Load();
            GameObject model = golden.Model(Convention.GltFast);
            try
            {
                player.player = model.AddComponent<TrackPlayer>();
                player.player.Load(golden.track);
                player.player.Seek(1.5);
                Call("LateUpdate"); // after Update of the track player
                Vector3[] shown = player.MeshOf(0).vertices;
                player.MeshOf(0).vertices = new Vector3[3];
                Call("LateUpdate");
                Assert.AreEqual(Vector3.zero, player.MeshOf(0).vertices[2]);
                player.player.Seek(0.5);
                Call("LateUpdate");
                player.player.Seek(1.5);
                Call("LateUpdate");
                Assert.AreEqual(shown[2], player.MeshOf(0).vertices[2]);
            }
            finally
            {
                Object.DestroyImmediate(model);
            }
        }

        private MeshRenderer Drawn()
        {
            return root.GetComponentsInChildren<MeshRenderer>()[0];
        }

        private void Call(string method)
        {
            MethodInfo found = typeof(DeformablePlayer).GetMethod(method, BindingFlags.Instance | BindingFlags.NonPublic);
            Assert.IsNotNull(found, method);
            found.Invoke(player, null);
        }
    }
}
