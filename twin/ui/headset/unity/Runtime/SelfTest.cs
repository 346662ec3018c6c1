using System.Collections.Generic;
using System.Text;
using UnityEngine;

namespace Twin.Player
{
    /// <summary>Compares results of the package on a device with golden vectors. Add it to an empty object of a scene
    /// and build the scene for the device; the result appears in the view and in the log.</summary>
    /// <remarks>It runs at the start, and again by its button or its context menu. The log has one line for each
    /// check, after "twin self test".</remarks>
    [AddComponentMenu("Twin/Self Test")]
    public sealed class SelfTest : MonoBehaviour
    {
        [Tooltip("Optional: an imported GLB of twin, which is checked too.")]
        public Transform model;

        [Tooltip("Optional: a track of the same bundle.")]
        public TextAsset track;

        [Tooltip("Optional: a 3D text that shows the result in a headset.")]
        public TextMesh text;

        public bool runOnStart = true;

        /// <summary>The displayed text; "" before the first run.</summary>
        public string Result { get; private set; }

        public bool Passed { get; private set; }

        /// <summary>Run every check, show and log the result.</summary>
        [ContextMenu("Run")]
        public void Run()
        {
            List<CheckResult> results = SelfChecks.Run();
            if (model != null && track != null)
            {
                results.Add(Model());
            }

            int failed = results.FindAll(r => !r.Passed).Count;
            Passed = failed == 0;
            var lines = new StringBuilder();
            lines.Append(Passed ? "PASSED " : "FAILED ").Append(results.Count - failed).Append(" of ")
                .Append(results.Count).Append(" checks, Unity ").Append(Application.unityVersion).Append(", ")
                .Append(Application.platform).Append('\n');
            foreach (CheckResult result in results)
            {
                lines.Append(result).Append('\n');
            }

            Result = lines.ToString();
            Debug.Log("twin self test: " + Result, this);
            if (text != null)
            {
                text.text = Result;
            }
        }

        // Check the imported model: all links exist, below one node with the rotation of the convention.
        private CheckResult Model()
        {
            var result = new CheckResult { Name = "the imported model", Tolerance = 1e-5 };
            try
            {
                var binding = new LinkBinding(model, Track.Parse(track.text).links, Convention.GltFast);
                Quaternion turn = binding.Root.localRotation;
                Quaternion wanted = Frames.RootRotation(Convention.GltFast);
                result.Worst = 1.0 - Mathf.Abs(Quaternion.Dot(turn, wanted));
                result.Count = 1;
            }
            catch (System.Exception error)
            {
                result.Fault = error.Message;
            }

            return result;
        }

        private void Start()
        {
            if (runOnStart)
            {
                Run();
            }
        }

        private void OnGUI()
        {
            if (GUI.Button(new Rect(10f, 10f, 200f, 40f), "Run the twin self test"))
            {
                Run();
            }

            GUI.Label(new Rect(10f, 60f, Screen.width - 20f, Screen.height - 70f), Result ?? "");
        }
    }
}
