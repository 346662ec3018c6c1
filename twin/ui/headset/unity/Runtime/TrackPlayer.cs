using System;
using UnityEngine;
using UnityEngine.Events;

namespace Twin.Player
{
    /// <summary>Called with the name of the phase that begins ("" before the first).</summary>
    [Serializable]
    public sealed class PhaseEvent : UnityEvent<string>
    {
    }

    /// <summary>Plays a track on the Transforms of a model, found by name.</summary>
    /// <remarks>Poses are absolute: the loops of a parallel robot are closed at every key; between keys, gaps are at
    /// most the track's `joint_gap`.</remarks>
    [AddComponentMenu("Twin/Track Player")]
    [DisallowMultipleComponent]
    public sealed class TrackPlayer : MonoBehaviour
    {
        [Tooltip("tracks/<protocol>.json of the bundle.")]
        public TextAsset trackFile;

        [Tooltip("The imported robot; empty: this object.")]
        public Transform model;

        [Tooltip("The importer of the model.")]
        public Convention convention = Convention.GltFast;

        public bool playOnStart = true;

        [Tooltip("1 is real time; negative plays backwards.")]
        public float speed = 1f;

        public bool loop = true;

        [Tooltip("Called with the name of the phase that begins.")]
        public PhaseEvent onPhase = new PhaseEvent();

        [Tooltip("Called at the end of a motion that does not loop.")]
        public UnityEvent onEnd = new UnityEvent();

        private LinkBinding binding;
        private PoseSource source;
        private int key;
        private double share;
        private int phase = -2;
        private Playhead head = new Playhead(0.0, 0.0);

        /// <summary>The loaded track, or null.</summary>
        public Track Track { get; private set; }

        /// <summary>Time in s since the start of the motion.</summary>
        public double Time
        {
            get { return head.Time; }
        }

        public bool IsPlaying
        {
            get { return head.IsPlaying; }
        }

        /// <summary>The links of the model, or null before a track is loaded.</summary>
        public LinkBinding Binding
        {
            get { return binding; }
        }

        /// <summary>Duration of the motion in s; 0 before a track is loaded.</summary>
        public double Duration
        {
            get { return Track == null ? 0.0 : Track.Duration; }
        }

        /// <summary>The name of the current phase; "" before the first phase.</summary>
        public string Phase
        {
            get { return phase < 0 ? "" : Track.phases[phase]; }
        }

        /// <summary>Load a track for a model, and show its first key, paused.</summary>
        /// <exception cref="FormatException">The text is not a valid track.</exception>
        /// <exception cref="ArgumentException">The model lacks a link of the track.</exception>
        public void Load(string json)
        {
            Load(Track.Parse(json));
        }

        /// <summary>Load a parsed track for a model, and show its first key, paused.</summary>
        public void Load(Track track)
        {
            TrackCheck.Require(track);
            var found = new LinkBinding(model == null ? transform : model, track.links, convention);
            binding = found;
            Track = track;
            source = Pose;
            phase = -2;
            head = new Playhead(track.times[0], track.Duration);
            Show();
        }

        /// <summary>Start or resume playing; if the motion has ended, restart it.</summary>
        public void Play()
        {
            if (Track == null)
            {
                throw new InvalidOperationException("TrackPlayer: no track is loaded");
            }

            head.Play(speed, loop);
            Show();
        }

        public void Pause()
        {
            head.Pause();
        }

        /// <summary>Show the motion at a time (s), which is clamped to the duration.</summary>
        public void Seek(double time)
        {
            if (Track != null)
            {
                head.Seek(time);
                Show();
            }
        }

        /// <summary>Advance the time by `passed` s times the speed while playing; Update calls this method in each
        /// frame.</summary>
        public void Tick(double passed)
        {
            if (!IsPlaying)
            {
                return;
            }

            bool ended = head.Tick(passed, speed, loop);
            Show();
            if (ended)
            {
                onEnd.Invoke();
            }
        }

        /// <summary>Return the displayed value of a joint (m or rad).</summary>
        public float Joint(int joint)
        {
            return Track.Joint(Time, joint);
        }

        private void Start()
        {
            if (Track == null && trackFile != null)
            {
                Load(trackFile.text);
                if (playOnStart)
                {
                    Play();
                }
            }
        }

        private void Update()
        {
            Tick(UnityEngine.Time.deltaTime);
        }

        private void Show()
        {
            Track.Locate(Time, out key, out share);
            binding.Apply(source);
            int now = Track.PhaseAt(Time);
            if (now != phase)
            {
                phase = now;
                onPhase.Invoke(Phase);
            }
        }

        private void Pose(int link, out Vector3 position, out Quaternion rotation)
        {
            Track.Sample(key, share, link, out position, out rotation);
        }
    }
}
