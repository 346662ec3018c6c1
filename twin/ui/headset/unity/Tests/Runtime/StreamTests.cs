using System;
using NUnit.Framework;
using UnityEngine;

namespace Twin.Player.Tests
{
    [TestFixture]
    public sealed class StreamTests
    {
        private byte[] data;
        private StreamFrame frame;

        [SetUp]
        public void Read()
        {
            data = Convert.FromBase64String(Golden.Load().stream);
            frame = new StreamFrame();
        }

        [Test]
        public void FlagsAreRead()
        {
            Accepted();
            Assert.IsTrue(frame.Has(StreamFrame.FlagGhost));
            Assert.IsTrue(frame.Has(StreamFrame.FlagPlaying));
            Assert.IsFalse(frame.Has(StreamFrame.FlagRefused));
            Assert.IsTrue(frame.Has(StreamFrame.FlagHeld));
            Assert.AreEqual(17, frame.LinkCount);
        }

        [Test]
        public void ABufferMayBeLargerThanTheMessage()
        {
            int count = data.Length;
            Array.Resize(ref data, count + 500);
            string fault;
            Assert.IsTrue(frame.Read(data, count, out fault), fault);
        }

        [Test]
        public void AFrameWithoutGhostForgetsTheLastOne()
        {
            Accepted();
            Assert.AreNotEqual(0f, frame.Ghost[0]);
            data[28] = 2;
            Array.Resize(ref data, data.Length - 28);
            Accepted();
            Assert.AreEqual(0f, frame.Ghost[0]);
        }

        [Test]
        public void WhatIsNoWholeFrameIsRefusedAndChangesNothing()
        {
            Accepted();
            uint sequence = frame.Sequence;
            Refused("expected at least 32", new byte[31]);
            Refused("17 links and 6 joints require", Cut(data, data.Length - 1));
            Refused("not with TWN1", Put(data, 0, 0));
            Refused("18 links", Put(data, 24, 18));
            byte[] infinite = Put(data, 4, 1);
            infinite[34] = 0x80;
            infinite[35] = 0x7F;
            Refused("not finite, at byte 32", infinite);
            Assert.AreEqual(sequence, frame.Sequence);
        }

        [Test]
        public void SequenceGoesRound()
        {
            Assert.IsTrue(StreamFrame.IsNewer(5, 4));
            Assert.IsFalse(StreamFrame.IsNewer(4, 4));
            Assert.IsFalse(StreamFrame.IsNewer(4, 5));
            Assert.IsTrue(StreamFrame.IsNewer(0, uint.MaxValue));
            Assert.IsFalse(StreamFrame.IsNewer(uint.MaxValue, 0));
        }

        [Test]
        public void AnAddressIsNeeded()
        {
            Assert.Throws<FormatException>(() => new StreamConnection("no address"));
            Assert.Throws<FormatException>(() => new StreamConnection("ftp://there/"));
        }

        [Test]
        public void RequestsAreWhatTheServerReads()
        {
            Assert.AreEqual("{\"type\":\"play\",\"on\":true}", Requests.Play(true));
            Assert.AreEqual("{\"type\":\"seek\",\"t\":1.5}", Requests.Seek(1.5));
            Assert.AreEqual("{\"type\":\"speed\",\"value\":0.25}", Requests.Speed(0.25));
            Assert.AreEqual("{\"type\":\"loop\",\"on\":false}", Requests.Loop(false));
            Assert.AreEqual("{\"type\":\"protocol\",\"name\":\"table2\"}", Requests.Protocol("table2"));
            Assert.AreEqual("{\"type\":\"posture\",\"name\":\"home\"}", Requests.Posture("home"));
            Assert.AreEqual("{\"type\":\"release\"}", Requests.Release());
            Assert.AreEqual(
                "{\"type\":\"grab\",\"target\":\"joint\",\"name\":\"a\\u0022b\"}", Requests.GrabJoint("a\"b"));
            Assert.Throws<ArgumentException>(() => Requests.DragValue(double.NaN));
        }

        [Test]
        public void NumbersDoNotDependOnTheLanguage()
        {
            var before = System.Threading.Thread.CurrentThread.CurrentCulture;
            try
            {
                System.Threading.Thread.CurrentThread.CurrentCulture = new System.Globalization.CultureInfo("de-DE");
                Assert.AreEqual("{\"type\":\"drag\",\"value\":0.125}", Requests.DragValue(0.125));
            }
            finally
            {
                System.Threading.Thread.CurrentThread.CurrentCulture = before;
            }
        }

        [Test]
        public void ADescriptionIsChecked()
        {
            const string Good = "{\"schema\":\"twin-robot\",\"version\":1,\"frame\":\"z-up right-handed\","
                + "\"links\":[\"a\",\"b\"],\"joints\":[{\"lower\":null}],"
                + "\"tool\":{\"link\":\"b\",\"T_link_tool\":[0,0,0,0,0,0,1]}}";
            Assert.AreEqual(2, RobotDescription.Parse(Good).links.Length);
            Wrong(Good.Replace("twin-robot", "x"), "schema twin-robot");
            Wrong(Good.Replace("z-up", "y-up"), "frame is 'y-up");
            Wrong(Good.Replace("\"link\":\"b\"", "\"link\":\"c\""), "on an unknown link");
            Wrong(Good.Replace("[\"a\",\"b\"]", "[]"), "links is empty");
            Wrong("<html>", "not JSON");
        }

        [Test]
        public void AModelWithoutTheLinksIsRefused()
        {
            var model = new GameObject("empty");
            try
            {
                model.SetActive(false);
                var client = model.AddComponent<StreamClient>();
                Assert.Throws<ArgumentException>(() => client.Use(Golden.Load().Robot()));
                Assert.AreEqual(double.PositiveInfinity, client.Age);
                Assert.IsFalse(client.Send(Requests.Release(), false));
                client.Tick();
            }
            finally
            {
                UnityEngine.Object.DestroyImmediate(model);
            }
        }

        private void Accepted()
        {
            string fault;
            Assert.IsTrue(frame.Read(data, data.Length, out fault), fault);
            Assert.AreEqual("", fault);
        }

        private void Refused(string expected, byte[] message)
        {
            string fault;
            Assert.IsFalse(frame.Read(message, message.Length, out fault));
            StringAssert.Contains(expected, fault);
        }

        private static byte[] Cut(byte[] from, int length)
        {
            var copy = new byte[length];
            Array.Copy(from, copy, length);
            return copy;
        }

        private static byte[] Put(byte[] from, int at, byte value)
        {
            byte[] copy = Cut(from, from.Length);
            copy[at] = value;
            return copy;
        }

        private static void Wrong(string json, string expected)
        {
            var error = Assert.Throws<FormatException>(() => RobotDescription.Parse(json));
            StringAssert.Contains(expected, error.Message);
        }
    }
}
