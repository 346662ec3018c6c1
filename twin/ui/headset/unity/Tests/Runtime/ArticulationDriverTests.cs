using System;
using NUnit.Framework;
using UnityEngine;

namespace Twin.Player.Tests
{
    [TestFixture]
    public sealed class ArticulationDriverTests
    {
        private GameObject root;
        private GameObject link;
        private Track track;
        private ArticulationDriver driver;

        [SetUp]
        public void Make()
        {
            track = Golden.Load().track;
            root = new GameObject("root");
            root.AddComponent<ArticulationBody>();
            link = new GameObject("link");
            link.transform.SetParent(root.transform, false);
            driver = root.AddComponent<ArticulationDriver>();
        }

        [TearDown]
        public void Destroy()
        {
            UnityEngine.Object.DestroyImmediate(link);
            UnityEngine.Object.DestroyImmediate(root);
        }

        [Test]
        public void ARevoluteDriveTakesDegreesAndKeepsTheRest()
        {
            ArticulationBody body = Body(ArticulationJointType.RevoluteJoint);
            ArticulationDrive drive = body.xDrive;
            drive.stiffness = 123f;
            body.xDrive = drive;
            driver.driven.Add(new DrivenJoint { joint = "rf1", body = body, sign = -1f });
            driver.Apply(track, track.times[3]);
            float radians = track.Joint(track.times[3], track.JointIndex("rf1"));
            Assert.That(body.xDrive.target, Is.EqualTo(-radians * 180f / (float)Math.PI).Within(1e-4f));
            Assert.AreEqual(123f, body.xDrive.stiffness);
        }

        [Test]
        public void APrismaticDriveTakesMetres()
        {
            ArticulationBody body = Body(ArticulationJointType.PrismaticJoint);
            driver.driven.Add(new DrivenJoint { joint = "q1", body = body, offset = -0.1f });
            driver.Apply(track, track.times[3]);
            float metres = track.Joint(track.times[3], track.JointIndex("q1"));
            Assert.That(body.xDrive.target, Is.EqualTo(metres - 0.1f).Within(1e-6f));
        }

        [Test]
        public void TargetsStayWithinTheLimits()
        {
            int joint = track.JointIndex("q1");
            var entry = new DrivenJoint { joint = "q1" };
            Assert.AreEqual(track.joint_upper[joint], driver.Target(track, joint, 9f, entry));
            Assert.AreEqual(track.joint_lower[joint], driver.Target(track, joint, -9f, entry));
            driver.clamp = false;
            Assert.AreEqual(9f, driver.Target(track, joint, 9f, entry));
        }

        [Test]
        public void AConfigurableJointIsDrivenTheOtherWay()
        {
            var joint = link.AddComponent<ConfigurableJoint>();
            driver.driven.Add(new DrivenJoint { joint = "q1", configurable = joint });
            driver.Apply(track, track.times[3]);
            float metres = track.Joint(track.times[3], track.JointIndex("q1"));
            Assert.That(joint.targetPosition.x, Is.EqualTo(-metres).Within(1e-6f));
            driver.driven[0] = new DrivenJoint { joint = "rf1", configurable = joint };
            driver.Apply(track, track.times[3]);
            float radians = track.Joint(track.times[3], track.JointIndex("rf1"));
            Assert.That(joint.targetRotation.x, Is.EqualTo(-(float)Math.Sin(radians / 2.0)).Within(1e-6f));
        }

        [Test]
        public void WhatWasReachedCountsLikeTheRobot()
        {
            int joint = track.JointIndex("rf1");
            var entry = new DrivenJoint { joint = "rf1", sign = -1f, offset = 0.25f };
            float target = driver.Target(track, joint, 0.5f, entry) * Mathf.Deg2Rad;
            Assert.That(target, Is.EqualTo(-0.75f).Within(1e-6f));
            Assert.That(ArticulationDriver.Value(entry, target), Is.EqualTo(0.5f).Within(1e-6f));
        }

        [Test]
        public void WrongEntriesAreNamed()
        {
            Refused("no joint 'x'", new DrivenJoint { joint = "x", body = Body(ArticulationJointType.PrismaticJoint) });
            Refused("'q1' has neither a body nor", new DrivenJoint { joint = "q1" });
            var body = link.GetComponent<ArticulationBody>();
            Refused("has sign 0.5", new DrivenJoint { joint = "q1", body = body, sign = 0.5f });
            Refused("'rf1' is revolute, but its body is a PrismaticJoint", new DrivenJoint { joint = "rf1", body = body });
        }

        [Test]
        public void ActiveJointsThatNothingDrivesAreListed()
        {
            driver.driven.Add(new DrivenJoint { joint = "q2" });
            Assert.AreEqual(new[] { "q1", "q3", "q4", "q5", "q6" }, driver.Undriven(track).ToArray());
        }

        private ArticulationBody Body(ArticulationJointType type)
        {
            var body = link.AddComponent<ArticulationBody>();
            body.jointType = type;
            return body;
        }

        private void Refused(string expected, DrivenJoint entry)
        {
            driver.driven.Clear();
            driver.driven.Add(entry);
            var error = Assert.Throws<ArgumentException>(() => driver.Apply(track, 0.0));
            StringAssert.Contains(expected, error.Message);
        }
    }
}
