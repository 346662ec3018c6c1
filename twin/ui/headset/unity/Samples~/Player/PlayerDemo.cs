using UnityEngine;

namespace Twin.Player.Samples
{
    /// <summary>Builds a scene: the imported robot plays a track, or shows the stream of `twin serve`.</summary>
    /// <remarks>Assign the imported GLB and a track to the two fields, and press Play. With an address, the stream is
    /// shown instead, and the mouse drags links.</remarks>
    public sealed class PlayerDemo : MonoBehaviour
    {
        [Tooltip("The model imported by glTFast from <robot>.glb.")]
        public GameObject robot;

        [Tooltip("tracks/<protocol>.json.")]
        public TextAsset track;

        [Tooltip("Address printed by `twin serve`; empty: play the track.")]
        public string address = "";

        [Tooltip("Display scale of the robot.")]
        public float scale = 1f;

        private GameObject shown;
        private TrackPlayer player;
        private StreamClient stream;

        private void Start()
        {
            shown = Instantiate(robot);
            shown.name = robot.name;
            shown.transform.localScale = new Vector3(scale, scale, scale);
            // Animation clips of the GLB would overwrite the poses of the player.
            foreach (Animation baked in shown.GetComponentsInChildren<Animation>())
            {
                baked.enabled = false;
            }

            if (address == "")
            {
                player = shown.AddComponent<TrackPlayer>();
                player.onPhase.AddListener(phase => Debug.Log("phase " + phase));
                player.Load(track.text);
                player.Play();
                return;
            }

            shown.SetActive(false); // the address must be set before the stream is enabled
            stream = shown.AddComponent<StreamClient>();
            stream.url = address;
            shown.SetActive(true);
            var grab = gameObject.AddComponent<Grab>();
            grab.stream = stream;
            gameObject.AddComponent<MouseGrab>().grab = grab;
        }

        private void OnGUI()
        {
            if (player != null)
            {
                if (GUI.Button(new Rect(10f, 10f, 80f, 30f), player.IsPlaying ? "Pause" : "Play"))
                {
                    Toggle();
                }

                float now = (float)player.Time;
                float to = GUI.HorizontalSlider(new Rect(100f, 20f, 300f, 30f), now, 0f, (float)player.Duration);
                if (to != now)
                {
                    player.Seek(to);
                }

                GUI.Label(new Rect(410f, 15f, 300f, 30f), now.ToString("0.00") + " s  " + player.Phase);
            }
            else if (stream != null && stream.Connection != null)
            {
                string line = stream.Connection.State + "  age " + (1000.0 * stream.Age).ToString("0") + " ms  "
                    + stream.State.phase + "  " + stream.State.reason + "  " + stream.Refusal;
                GUI.Label(new Rect(10f, 10f, 800f, 30f), line);
                GUI.Label(new Rect(10f, 35f, 800f, 30f), stream.Connection.LastError);
            }
        }

        private void Toggle()
        {
            if (player.IsPlaying)
            {
                player.Pause();
            }
            else
            {
                player.Play();
            }
        }
    }
}
