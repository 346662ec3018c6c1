using System;
using NUnit.Framework;
using UnityEngine;

namespace Twin.Player.Tests
{
    [TestFixture]
    public sealed class TrackTests
    {
        private Track track;

        [SetUp]
        public void Read()
        {
            track = Golden.Load().track;
        }

        [Test]
        public void EveryFieldIsRead()
        {
            Assert.AreEqual("sils", track.robot);
            Assert.AreEqual("table2", track.protocol);
            StringAssert.StartsWith("sha256:", track.model_hash);
            Assert.AreEqual(track.frames * track.links.Length * 7, track.poses.Length);
            Assert.AreEqual(6, Array.FindAll(track.joint_active, a => a == 1).Length);
            Assert.AreEqual("platform", track.tool_link);
        }

        [Test]
        public void AKeyIsHitExactly()
        {
            for (int k = 0; k < track.frames; k++)
            {
                Vector3 shown, wanted;
                Quaternion turn, wantedTurn;
                track.Sample(track.times[k], track.links.Length - 1, out shown, out turn);
                track.Key(k, track.links.Length - 1, out wanted, out wantedTurn);
                Assert.That(Vector3.Distance(shown, wanted), Is.LessThan(1e-7f), "key " + k);
                Assert.That(Math.Abs(Quaternion.Dot(turn, wantedTurn)), Is.EqualTo(1f).Within(1e-6f), "key " + k);
            }
        }

        [Test]
        public void LocateFindsTheKeysRoundATime()
        {
            int key;
            double share;
            track.Locate(track.times[4], out key, out share);
            Assert.AreEqual(4, key);
            Assert.AreEqual(0.0, share);
            track.Locate(0.5 * (track.times[4] + track.times[5]), out key, out share);
            Assert.AreEqual(4, key);
            Assert.That(share, Is.EqualTo(0.5).Within(1e-9));
        }

        [Test]
        public void TimesOutsideAreHeld()
        {
            int key;
            double share;
            track.Locate(-3.0, out key, out share);
            Assert.AreEqual(0, key);
            Assert.AreEqual(0.0, share);
            track.Locate(1e9, out key, out share);
            Assert.AreEqual(track.frames - 2, key);
            Assert.AreEqual(1.0, share);
            track.Locate(double.NaN, out key, out share);
            Assert.AreEqual(0, key);
        }

        [Test]
        public void ATrackOfOneKeyIsStill()
        {
            int stride = track.links.Length * 7;
            track.frames = 1;
            track.times = new[] { 0.0 };
            Array.Resize(ref track.poses, stride);
            Array.Resize(ref track.positions, track.joints.Length);
            TrackCheck.Require(track);
            Vector3 position;
            Quaternion rotation;
            track.Sample(5.0, 2, out position, out rotation);
            Assert.AreEqual(track.poses[14], position.x);
            Assert.AreEqual(track.positions[1], track.Joint(5.0, 1));
        }

        [Test]
        public void PhasesBeginWhereTheySay()
        {
            Assert.AreEqual(-1, track.PhaseAt(-1.0));
            Assert.AreEqual(0, track.PhaseAt(0.0));
            Assert.AreEqual(1, track.PhaseAt(track.phase_start[1]));
            Assert.AreEqual(0, track.PhaseAt(track.phase_start[1] - 1e-6));
            Assert.AreEqual(track.phases.Length - 1, track.PhaseAt(1e9));
        }

        [Test]
        public void FaultsAreNamed()
        {
            Fault("schema is 'x'", t => t.schema = "x");
            Fault("version is 2, this package reads 1", t => t.version = 2);
            Fault("frame is 'y-up'", t => t.frame = "y-up");
            Fault("length_unit is 'mm', expected 'm'", t => t.length_unit = "mm");
            Fault("angle_unit is 'deg'", t => t.angle_unit = "deg");
            Fault("quaternion_order is 'wxyz', expected 'xyzw'", t => t.quaternion_order = "wxyz");
            Fault("frames is 0", t => t.frames = 0);
            Fault("poses has 3 numbers", t => Array.Resize(ref t.poses, 3));
            Fault("positions has 1 numbers", t => Array.Resize(ref t.positions, 1));
            Fault("times[3] is", t => t.times[3] = t.times[2]);
            Fault("times[2] is NaN", t => t.times[2] = double.NaN);
            Fault("rate is 0", t => t.rate = 0);
            Fault("of link 'limb1' at frame 0 has no unit quaternion", t => t.poses[13] = 2f);
            Fault("of link 'frame' at frame 0 has no unit quaternion", t => t.poses[0] = float.NaN);
            Fault("changes its sign", Flip);
            Fault("links: the name 'frame'", t => t.links[1] = "frame");
            Fault("joint 'q1' has type 'ball'", t => t.joint_types[Array.IndexOf(t.joints, "q1")] = "ball");
            Fault("joint 'q1': its limits", t => t.joint_lower[Array.IndexOf(t.joints, "q1")] = 9f);
            Fault("joint_active 7", t => t.joint_active[0] = 7);
            Fault("is not finite at frame 1", t => t.positions[t.joints.Length] = float.PositiveInfinity);
            Fault("phase 'approach' lasts from 0 to -1", t => t.phase_end[0] = -1.0);
            Fault("tool_link 'x'", t => t.tool_link = "x");
            Fault("moved_frame 'x'", t => t.moved_frame = "x");
            Fault("is on 'x'", t => t.frame_links[0] = "x");
            Fault("tool_frame has no unit", t => t.tool_frame[6] = 3f);
            Fault("rcm has 2 numbers", t => t.rcm = new float[2]);
        }

        [Test]
        public void WhatIsNoTrackIsRefused()
        {
            Assert.Throws<FormatException>(() => Track.Parse(""));
            Assert.Throws<FormatException>(() => Track.Parse("{\"schema\":\"twin-tr"));
            var other = Assert.Throws<FormatException>(() => Track.Parse("{\"schema\":\"something\"}"));
            StringAssert.Contains("schema is 'something', expected 'twin-track'", other.Message);
        }

        private static void Flip(Track t)
        {
            int at = 2 * t.links.Length * 7 + 3;
            for (int i = at; i < at + 4; i++)
            {
                t.poses[i] = -t.poses[i];
            }
        }

        private static void Fault(string expected, Action<Track> damage)
        {
            Track track = Golden.Load().track;
            damage(track);
            var error = Assert.Throws<FormatException>(() => TrackCheck.Require(track), expected);
            StringAssert.Contains(expected, error.Message);
        }
    }
}
