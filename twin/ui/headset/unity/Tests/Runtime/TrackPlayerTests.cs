using System;
using System.Collections.Generic;
using NUnit.Framework;
using UnityEngine;

namespace Twin.Player.Tests
{
    [TestFixture]
    public sealed class TrackPlayerTests
    {
        private GameObject model;
        private TrackPlayer player;
        private List<string> phases;

        [SetUp]
        public void Make()
        {
            Golden golden = Golden.Load();
            model = golden.Model(Convention.GltFast);
            player = model.AddComponent<TrackPlayer>();
            phases = new List<string>();
            player.onPhase.AddListener(phases.Add);
            player.Load(golden.track);
        }

        [TearDown]
        public void Destroy()
        {
            UnityEngine.Object.DestroyImmediate(model);
        }

        [Test]
        public void ItBeginsPausedAtTheBeginning()
        {
            Assert.IsFalse(player.IsPlaying);
            Assert.AreEqual(0.0, player.Time);
            player.Tick(1.0);
            Assert.AreEqual(0.0, player.Time);
            Assert.AreEqual(new List<string> { "approach" }, phases);
        }

        [Test]
        public void SpeedScalesTime()
        {
            player.speed = 2f;
            player.Play();
            player.Tick(0.25);
            Assert.That(player.Time, Is.EqualTo(0.5).Within(1e-12));
            player.Pause();
            player.Tick(1.0);
            Assert.That(player.Time, Is.EqualTo(0.5).Within(1e-12));
        }

        [Test]
        public void SeekPastTheEndIsHeld()
        {
            player.Seek(1e6);
            Assert.AreEqual(player.Duration, player.Time);
            Vector3 wanted;
            Quaternion turn;
            player.Track.Key(player.Track.frames - 1, 5, out wanted, out turn);
            Vector3 shown = player.Binding.Link(5).localPosition;
            Assert.That(Vector3.Distance(shown, Frames.ToUnity(wanted, Convention.GltFast)), Is.LessThan(1e-6f));
            player.Seek(-1.0);
            Assert.AreEqual(0.0, player.Time);
            player.Seek(double.NaN);
            Assert.AreEqual(0.0, player.Time);
        }

        [Test]
        public void ALoopBeginsAgainWithWhatIsLeft()
        {
            player.loop = true;
            player.Play();
            player.Seek(player.Duration - 0.1);
            player.Tick(0.35);
            Assert.That(player.Time, Is.EqualTo(0.25).Within(1e-9));
            Assert.IsTrue(player.IsPlaying);
            player.speed = -1f;
            player.Tick(0.5);
            Assert.That(player.Time, Is.EqualTo(player.Duration - 0.25).Within(1e-9));
        }

        [Test]
        public void WithoutLoopItEndsOnceAndPlaysAgain()
        {
            int ends = 0;
            player.onEnd.AddListener(() => ends++);
            player.loop = false;
            player.Play();
            player.Tick(1000.0);
            player.Tick(1.0);
            Assert.AreEqual(1, ends);
            Assert.IsFalse(player.IsPlaying);
            Assert.AreEqual(player.Duration, player.Time);
            player.Play();
            Assert.AreEqual(0.0, player.Time);
            player.speed = -1f;
            player.Tick(0.5);
            Assert.AreEqual(2, ends);
            Assert.AreEqual(0.0, player.Time);
        }

        [Test]
        public void EachPhaseIsToldOnce()
        {
            player.Play();
            player.loop = false;
            for (int i = 0; i < 2000; i++)
            {
                player.Tick(0.01);
            }

            Assert.AreEqual(new List<string>(player.Track.phases), phases);
            Assert.AreEqual("home", player.Phase);
        }

        [Test]
        public void JointsFollow()
        {
            int joint = player.Track.JointIndex("q1");
            player.Seek(player.Track.times[2]);
            float wanted = player.Track.positions[2 * player.Track.joints.Length + joint];
            Assert.That(player.Joint(joint), Is.EqualTo(wanted).Within(1e-7f));
        }

        [Test]
        public void NothingLoadedCannotPlay()
        {
            var empty = new GameObject("empty");
            try
            {
                var other = empty.AddComponent<TrackPlayer>();
                other.Seek(1.0);
                other.Tick(1.0);
                Assert.Throws<InvalidOperationException>(other.Play);
            }
            finally
            {
                UnityEngine.Object.DestroyImmediate(empty);
            }
        }
    }
}
