using System;
using UnityEngine;

namespace Twin.Player
{
    /// <summary>Plays the deformables of an exported scene, such as soft organs, from the file organs.glb.</summary>
    /// <remarks>Each deformable becomes a child of this object. Place this object at the origin of the scene's world,
    /// rotated as the root of the models: for glTFast by -90 degrees about x.</remarks>
    [AddComponentMenu("Twin/Deformable Player")]
    [DisallowMultipleComponent]
    public sealed class DeformablePlayer : MonoBehaviour
    {
        [Tooltip("organs.bytes: the file organs.glb of `twin export <scene>`, renamed; the import menu does this.")]
        public TextAsset motionFile;

        [Tooltip("The player whose time is displayed, so that organs and robot move together; empty: play alone.")]
        public TrackPlayer player;

        [Tooltip("The importer of the models; it sets the axes.")]
        public Convention convention = Convention.GltFast;

        [Tooltip("Material of the deformables; each one gets a copy with its own colour.")]
        public Material material;

        public bool playOnStart = true;

        [Tooltip("1 is real time; negative plays backwards.")]
        public float speed = 1f;

        public bool loop = true;

        private Playhead head = new Playhead(0.0, 0.0);
        private DeformableMesh[] meshes = new DeformableMesh[0];
        private float[][] vertices = new float[0][];

        /// <summary>The loaded motion, or null.</summary>
        public DeformableMotion Motion { get; private set; }

        /// <summary>Displayed time in s since the start of the motion.</summary>
        public double Time
        {
            get { return head.Time; }
        }

        public bool IsPlaying
        {
            get { return head.IsPlaying; }
        }

        /// <summary>Return the mesh of a deformable.</summary>
        public Mesh MeshOf(int index)
        {
            return meshes[index].Mesh;
        }

        /// <summary>Load the bytes of a file organs.glb, and show its first key, paused.</summary>
        /// <exception cref="FormatException">The file is not one of deformables, or it is damaged.</exception>
        public void Load(byte[] glb)
        {
            DeformableMotion motion = DeformableMotion.Parse(glb);
            DeformableMesh.Destroy(meshes);
            Motion = motion;
            meshes = new DeformableMesh[motion.Count];
            vertices = new float[motion.Count][];
            for (int i = 0; i < motion.Count; i++)
            {
                float[] c = motion.ColorOf(i);
                meshes[i] = new DeformableMesh(
                    transform, motion.NameOf(i), motion.TrianglesOf(i), new Color(c[0], c[1], c[2], c[3]), material);
                vertices[i] = new float[motion.SizeOf(i)];
            }

            head = new Playhead(0.0, motion.Duration);
            Show();
        }

        /// <summary>Start or resume playing; if the motion has ended, restart it.</summary>
        public void Play()
        {
            if (Motion == null)
            {
                throw new InvalidOperationException("DeformablePlayer: no motion is loaded");
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
            if (Motion != null)
            {
                head.Seek(time);
                Show();
            }
        }

        /// <summary>Advance the time by `passed` s times the speed while playing, or show the time of `player`; LateUpdate
        /// calls this method in each frame, after `player` has advanced its time.</summary>
        public void Tick(double passed)
        {
            if (player != null)
            {
                double before = head.Time;
                head.Seek(player.Time);
                if (head.Time != before)
                {
                    Show();
                }
            }
            else if (IsPlaying)
            {
                head.Tick(passed, speed, loop);
                Show();
            }
        }

        private void Show()
        {
            for (int i = 0; i < meshes.Length; i++)
            {
                Motion.Sample(i, head.Time, vertices[i]);
                meshes[i].Show(vertices[i], convention);
            }
        }

        private void Start()
        {
            if (Motion == null && motionFile != null)
            {
                Load(motionFile.bytes);
                if (playOnStart)
                {
                    Play();
                }
            }
        }

        private void LateUpdate()
        {
            Tick(UnityEngine.Time.deltaTime);
        }

        private void OnDestroy()
        {
            DeformableMesh.Destroy(meshes);
        }
    }
}
