using System;
using NUnit.Framework;
using UnityEngine;

namespace Twin.Player.Tests
{
    [TestFixture]
    public sealed class FramesTests
    {
        [Test]
        public void GltFastMirrorsX()
        {
            Vector3 p = Frames.ToUnity(new Vector3(1f, 2f, 3f), Convention.GltFast);
            Assert.AreEqual(new Vector3(-1f, 2f, 3f), p);
        }

        [Test]
        public void UrdfImporterTurnsForwardLeftUpIntoRightUpForward()
        {
            Vector3 p = Frames.ToUnity(new Vector3(1f, 2f, 3f), Convention.UrdfImporter);
            Assert.AreEqual(new Vector3(-2f, 3f, 1f), p);
        }

        [TestCase(Convention.GltFast)]
        [TestCase(Convention.UrdfImporter)]
        public void UpIsUpInBoth(Convention convention)
        {
            Vector3 up = Frames.RootRotation(convention) * Frames.ToUnity(new Vector3(0f, 0f, 1f), convention);
            Assert.That(up.y, Is.EqualTo(1f).Within(1e-6f));
        }

        [TestCase(Convention.GltFast)]
        [TestCase(Convention.UrdfImporter)]
        public void ARotatedPointIsTheSameOnBothSides(Convention convention)
        {
            var q = new Quaternion(0.5f, -0.1f, 0.7f, 0.5f);
            var p = new Vector3(0.2f, -0.4f, 0.9f);
            Vector3 turnedFirst = Frames.ToUnity(q * p, convention);
            Vector3 turnedLater = Frames.ToUnity(q, convention) * Frames.ToUnity(p, convention);
            Assert.That(Vector3.Distance(turnedFirst, turnedLater), Is.LessThan(1e-6f));
        }

        [Test]
        public void BothConventionsDifferByAQuarterTurnAboutTheVertical()
        {
            var p = new Vector3(0.3f, -0.2f, 0.5f);
            Vector3 a = Frames.RootRotation(Convention.GltFast) * Frames.ToUnity(p, Convention.GltFast);
            Vector3 b = Frames.ToUnity(p, Convention.UrdfImporter);
            Assert.That(a.y, Is.EqualTo(b.y).Within(1e-6f));
            Assert.That(a.x * b.x + a.z * b.z, Is.EqualTo(0f).Within(1e-6f));
        }

        [Test]
        public void SlerpTakesTheShortWayWhateverTheSign()
        {
            Quaternion a = Quaternion.AngleAxis(10f, Vector3.right);
            Quaternion b = Quaternion.AngleAxis(70f, Vector3.right);
            Quaternion half = Frames.Slerp(a, new Quaternion(-b.x, -b.y, -b.z, -b.w), 0.5);
            Assert.That(Math.Abs(Quaternion.Dot(half, Quaternion.AngleAxis(40f, Vector3.right))),
                Is.EqualTo(1f).Within(1e-6f));
        }

        [Test]
        public void SlerpEndsWhereItShould()
        {
            Quaternion a = Quaternion.AngleAxis(10f, Vector3.right);
            Quaternion b = Quaternion.AngleAxis(170f, new Vector3(0f, 1f, 0f));
            Assert.That(Quaternion.Dot(Frames.Slerp(a, b, 0.0), a), Is.EqualTo(1f).Within(1e-6f));
            Assert.That(Math.Abs(Quaternion.Dot(Frames.Slerp(a, b, 1.0), b)), Is.EqualTo(1f).Within(1e-6f));
        }
    }
}
