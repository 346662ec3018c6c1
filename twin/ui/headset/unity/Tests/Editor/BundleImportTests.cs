using System;
using System.Collections.Generic;
using System.IO;
using NUnit.Framework;
using UnityEngine;

namespace Twin.Player.Editor.Tests
{
    [TestFixture]
    public sealed class BundleImportTests
    {
        private string folder;
        private string bundle;
        private string assets;

        [SetUp]
        public void Make()
        {
            folder = Path.Combine(Path.GetTempPath(), Path.GetRandomFileName());
            bundle = Path.Combine(folder, "export");
            assets = Path.Combine(folder, "Assets");
            Directory.CreateDirectory(Path.Combine(bundle, "tracks"));
            File.WriteAllText(Path.Combine(bundle, "sils.glb"), "glTF");
            Track("table2");
            File.WriteAllText(Path.Combine(bundle, "tracks/track.schema.json"), "{}");
            File.WriteAllText(Path.Combine(bundle, "tracks/table2.csv"), "");
        }

        [TearDown]
        public void Remove()
        {
            Directory.Delete(folder, true);
        }

        [Test]
        public void ModelAndTracksAreCopied()
        {
            List<string> files = BundleImport.Copy(bundle, assets);
            Assert.AreEqual(2, files.Count);
            Assert.AreEqual(Path.Combine(assets, "Twin/sils/sils.glb"), files[0].Replace('\\', '/'));
            Assert.AreEqual("table2.json", Path.GetFileName(files[1]));
            Assert.AreEqual(2, Directory.GetFiles(Path.Combine(assets, "Twin/sils")).Length);
            BundleImport.Copy(bundle, assets); // again, over the first
        }

        [Test]
        public void AFolderThatIsNoBundleIsRefused()
        {
            Refused("contains 0 GLB files", assets);
            File.WriteAllText(Path.Combine(bundle, "other.glb"), "");
            Refused("contains 2 GLB files", bundle);
        }

        [Test]
        public void ADamagedTrackStopsTheImport()
        {
            File.WriteAllText(Path.Combine(bundle, "tracks/broken.json"), "{\"schema\":");
            Refused("broken.json: the track is not JSON", bundle);
            Assert.IsFalse(Directory.Exists(assets));
        }

        [Test]
        public void ATrackOfAnotherRobotStopsTheImport()
        {
            File.Move(Path.Combine(bundle, "sils.glb"), Path.Combine(bundle, "pa10.glb"));
            Refused("the track is for robot 'sils', not 'pa10'", bundle);
        }

        [Test]
        public void ASceneIsCopiedWithItsOrgansAndRobots()
        {
            string scene = Path.Combine(folder, "scene");
            Directory.CreateDirectory(scene);
            Directory.Move(bundle, Path.Combine(scene, "arm"));
            File.WriteAllText(Path.Combine(scene, "arm/proof.json"), "{}");
            File.WriteAllText(Path.Combine(scene, "scene.json"), "{\"scene\":\"theatre\"}");
            Directory.CreateDirectory(Path.Combine(scene, "usd"));
            List<string> files = BundleImport.Copy(scene, assets);
            Assert.AreEqual(2, files.Count);
            Assert.AreEqual(Path.Combine(assets, "Twin/theatre/arm/sils.glb"), files[0].Replace('\\', '/'));
            File.WriteAllBytes(Path.Combine(scene, "organs.glb"), Twin.Player.Tests.DeformableTests.Example());
            files = BundleImport.Copy(scene, assets);
            Assert.AreEqual(Path.Combine(assets, "Twin/theatre/organs.bytes"), files[0].Replace('\\', '/'));
            File.WriteAllText(Path.Combine(scene, "organs.glb"), "glTF");
            Directory.Delete(assets, true);
            Refused("organs.glb: not a .glb file", scene);
            File.WriteAllText(Path.Combine(scene, "scene.json"), "{\"scene\":\"../x\"}");
            Refused("scene '../x' is not a name", scene);
            Assert.IsFalse(Directory.Exists(assets));
        }

        [Test]
        public void ASceneWithoutOrgansAndRobotsIsRefused()
        {
            string scene = Path.Combine(folder, "scene");
            Directory.CreateDirectory(Path.Combine(scene, "usd"));
            File.WriteAllText(Path.Combine(scene, "scene.json"), "{\"scene\":\"theatre\"}");
            Refused(scene + " contains scene.json, but neither organs.glb nor the folder of a robot", scene);
            Refused("twin export <scene>", scene);
            Assert.IsFalse(Directory.Exists(assets));
        }

        private void Track(string name)
        {
            string golden = Resources.Load<TextAsset>("twin-golden").text;
            int from = golden.IndexOf("\"track\":", StringComparison.Ordinal) + 8;
            int to = golden.IndexOf("},\n\"place\"", StringComparison.Ordinal) + 1;
            File.WriteAllText(Path.Combine(bundle, "tracks/" + name + ".json"), golden.Substring(from, to - from));
        }

        private void Refused(string expected, string from)
        {
            var error = Assert.Throws<FormatException>(() => BundleImport.Copy(from, assets));
            StringAssert.Contains(expected, error.Message);
        }
    }
}
