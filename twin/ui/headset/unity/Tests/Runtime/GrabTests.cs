using System.Collections.Generic;
using NUnit.Framework;
using UnityEngine;

namespace Twin.Player.Tests
{
    [TestFixture]
    public sealed class GrabTests
    {
        private GameObject model;
        private Grab grab;
        private List<string> sent;
        private List<bool> replaced;
        private bool open;

        [SetUp]
        public void Make()
        {
            Golden golden = Golden.Load();
            model = golden.Model(Convention.GltFast);
            model.SetActive(false);
            var stream = model.AddComponent<StreamClient>();
            stream.Use(golden.Robot());
            var frame = new StreamFrame();
            frame.Poses = golden.track.poses;
            stream.Show(frame);
            grab = model.AddComponent<Grab>();
            grab.stream = stream;
            sent = new List<string>();
            replaced = new List<bool>();
            open = true;
            grab.Outgoing = (json, replaces) =>
            {
                if (open)
                {
                    sent.Add(json);
                    replaced.Add(replaces);
                }

                return open;
            };
        }

        [TearDown]
        public void Destroy()
        {
            UnityEngine.Object.DestroyImmediate(model);
        }

        [Test]
        public void AToolIsGrabbedDraggedAndReleased()
        {
            Assert.IsTrue(grab.BeginTool(Vector3.zero, Quaternion.identity));
            Assert.IsTrue(grab.IsHolding);
            grab.Move(Vector3.one, Quaternion.identity);
            grab.End();
            grab.End();
            Assert.AreEqual(3, sent.Count);
            Assert.AreEqual("{\"type\":\"grab\",\"target\":\"tool\"}", sent[0]);
            StringAssert.StartsWith("{\"type\":\"drag\",\"pose\":[", sent[1]);
            Assert.AreEqual("{\"type\":\"release\"}", sent[2]);
            Assert.AreEqual(new[] { false, true, false }, replaced.ToArray());
        }

        [Test]
        public void AHandThatDoesNotMoveMovesNothing()
        {
            var hand = new Vector3(0.4f, 1.2f, 0.3f);
            Quaternion turn = Quaternion.AngleAxis(50f, Vector3.right);
            Vector3 wanted = Dragged(hand, turn, hand, turn);
            Vector3 position;
            Quaternion rotation;
            RobotDescription robot = grab.stream.Robot;
            grab.stream.Frame.Link(robot.links.Length - 1, out position, out rotation);
            var onLink = new Vector3(robot.tool.T_link_tool[0], robot.tool.T_link_tool[1], robot.tool.T_link_tool[2]);
            Assert.That(Vector3.Distance(wanted, position + rotation * onLink), Is.LessThan(2e-6f));
        }

        [Test]
        public void AHandThatRisesLiftsTheTool()
        {
            model.transform.localRotation = Quaternion.identity;
            Vector3 before = Dragged(Vector3.zero, Quaternion.identity, Vector3.zero, Quaternion.identity);
            Vector3 after = Dragged(
                Vector3.zero, Quaternion.identity, new Vector3(0f, 0.01f, 0f), Quaternion.identity);
            // The model is displayed at half size: 1 cm of the hand is 2 cm of the robot.
            Assert.That(after.z - before.z, Is.EqualTo(0.02f).Within(2e-6f));
            Assert.That(after.x, Is.EqualTo(before.x).Within(2e-6f));
        }

        [Test]
        public void ALinkIsHeldAtAPointOfItsOwn()
        {
            Transform part = new GameObject("mesh").transform;
            part.SetParent(grab.stream.Binding.Link(1), false);
            Assert.IsTrue(grab.BeginLink(part, part.position));
            StringAssert.StartsWith("{\"type\":\"grab\",\"target\":\"link\",\"name\":\"limb1\",\"point\":[", sent[0]);
            Assert.IsFalse(grab.MoveJoint(1f));
            Assert.IsFalse(grab.BeginLink(model.transform, Vector3.zero), "no link");
            Assert.IsFalse(grab.IsHolding);
        }

        [Test]
        public void AJointIsLedByItsValue()
        {
            Assert.IsTrue(grab.BeginJoint("q1"));
            Assert.IsTrue(grab.MoveJoint(0.25f));
            Assert.IsFalse(grab.Move(Vector3.zero, Quaternion.identity));
            Assert.AreEqual("{\"type\":\"drag\",\"value\":0.25}", sent[1]);
        }

        [Test]
        public void WithoutConnectionNothingIsHeld()
        {
            open = false;
            Assert.IsFalse(grab.BeginTool(Vector3.zero, Quaternion.identity));
            Assert.IsFalse(grab.IsHolding);
            grab.stream = null;
            Assert.IsFalse(grab.BeginTool(Vector3.zero, Quaternion.identity));
            Assert.IsFalse(grab.BeginLink(model.transform, Vector3.zero));
        }

        private Vector3 Dragged(Vector3 from, Quaternion turn, Vector3 to, Quaternion turned)
        {
            sent.Clear();
            grab.BeginTool(from, turn);
            grab.Move(to, turned);
            grab.End();
            string[] numbers = sent[1].Substring(sent[1].IndexOf('[') + 1).Split(',');
            var culture = System.Globalization.CultureInfo.InvariantCulture;
            return new Vector3(
                float.Parse(numbers[0], culture), float.Parse(numbers[1], culture), float.Parse(numbers[2], culture));
        }
    }
}
