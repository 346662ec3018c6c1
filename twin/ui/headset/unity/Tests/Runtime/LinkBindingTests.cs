using System;
using NUnit.Framework;
using UnityEngine;

namespace Twin.Player.Tests
{
    [TestFixture]
    public sealed class LinkBindingTests
    {
        private GameObject model;

        [SetUp]
        public void Make()
        {
            model = new GameObject("model");
        }

        [TearDown]
        public void Destroy()
        {
            UnityEngine.Object.DestroyImmediate(model);
        }

        [Test]
        public void AMissingLinkIsNamed()
        {
            Child(model.transform, "a");
            var error = Assert.Throws<ArgumentException>(
                () => new LinkBinding(model.transform, new[] { "a", "b" }, Convention.GltFast));
            StringAssert.Contains("no Transform named b", error.Message);
        }

        [Test]
        public void ANameThatIsThereTwiceIsRefused()
        {
            Child(Child(model.transform, "a"), "a");
            var error = Assert.Throws<ArgumentException>(
                () => new LinkBinding(model.transform, new[] { "a" }, Convention.GltFast));
            StringAssert.Contains("more than one Transform named a", error.Message);
        }

        [Test]
        public void NoModelIsRefused()
        {
            Assert.Throws<ArgumentException>(() => new LinkBinding(null, new[] { "a" }, Convention.GltFast));
        }

        [Test]
        public void APartBelongsToItsLink()
        {
            Transform a = Child(model.transform, "a");
            Transform part = Child(Child(a, "mesh"), "submesh");
            Child(model.transform, "b");
            var binding = new LinkBinding(model.transform, new[] { "b", "a" }, Convention.GltFast);
            Assert.AreEqual(1, binding.LinkOf(part));
            Assert.AreEqual(-1, binding.LinkOf(model.transform));
        }

        [Test]
        public void LinksInsideOneAnotherArePlacedInTheWorld()
        {
            Transform outer = Child(model.transform, "outer");
            Transform inner = Child(Child(outer, "between"), "inner");
            model.transform.localPosition = new Vector3(1f, 2f, 3f);
            model.transform.localRotation = Quaternion.AngleAxis(30f, new Vector3(0f, 1f, 0f));
            var binding = new LinkBinding(model.transform, new[] { "inner", "outer" }, Convention.UrdfImporter);
            var p = new[] { new Vector3(0.1f, 0.2f, 0.3f), new Vector3(-1f, 0.5f, 0.25f) };
            var q = new[] { new Quaternion(0.5f, 0.5f, 0.5f, 0.5f), new Quaternion(0f, 0.6f, 0f, 0.8f) };
            binding.Apply(delegate(int link, out Vector3 position, out Quaternion rotation)
            {
                position = p[link];
                rotation = q[link];
            });
            var at = new[] { inner, outer };
            for (int i = 0; i < 2; i++)
            {
                Vector3 position = p[i];
                Quaternion rotation = q[i];
                binding.ToWorld(ref position, ref rotation);
                Assert.That(Vector3.Distance(at[i].position, position), Is.LessThan(1e-6f));
                Assert.That(Math.Abs(Quaternion.Dot(at[i].rotation, rotation)), Is.EqualTo(1f).Within(1e-6f));
                binding.FromWorld(ref position, ref rotation);
                Assert.That(Vector3.Distance(position, p[i]), Is.LessThan(1e-6f));
                Assert.That(Math.Abs(Quaternion.Dot(rotation, q[i])), Is.EqualTo(1f).Within(1e-6f));
            }
        }

        private static Transform Child(Transform parent, string name)
        {
            Transform child = new GameObject(name).transform;
            child.SetParent(parent, false);
            return child;
        }
    }
}
