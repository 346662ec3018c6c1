using NUnit.Framework;

namespace Twin.Player.Tests
{
    /// <summary>All checks of the self test, as one test for each check.</summary>
    [TestFixture]
    public sealed class GoldenTests
    {
        [Test]
        public void EveryCheckOfTheSelfTestPasses()
        {
            var results = SelfChecks.Run();
            Assert.AreEqual(15, results.Count);
            foreach (CheckResult result in results)
            {
                Assert.IsTrue(result.Passed, result.ToString());
            }
        }

        [Test]
        public void EveryLinkIsCompared()
        {
            Golden golden = Golden.Load();
            for (int link = 0; link < golden.track.links.Length; link++)
            {
                Assert.Contains(link, golden.point_link);
                Assert.Contains(link, golden.between_link);
            }
        }

        [Test]
        public void VectorsThatAreWrongAreSeen()
        {
            var result = new CheckResult { Name = "n", Tolerance = 1e-6, Worst = 1e-5, Count = 1 };
            Assert.IsFalse(result.Passed);
            StringAssert.StartsWith("FAILED", result.ToString());
            Assert.IsFalse(new CheckResult { Tolerance = 1.0 }.Passed, "nothing was compared");
            Assert.IsFalse(new CheckResult { Tolerance = 1.0, Count = 1, Fault = "thrown" }.Passed);
        }
    }
}
