using UnityEngine;

namespace Twin.Player
{
    /// <summary>Draws the deformable bodies of a scene, such as soft organs, from the frames of a Stream Client.</summary>
    /// <remarks>Each deformable becomes a child of this object, with a mesh whose vertices are those of the displayed
    /// frame. Place this object at the origin of the scene's world, rotated as the root of the models: for glTFast by
    /// -90 degrees about x.</remarks>
    [AddComponentMenu("Twin/Deformables")]
    [DisallowMultipleComponent]
    public sealed class Deformables : MonoBehaviour
    {
        [Tooltip("The Stream Client of one robot of the scene.")]
        public StreamClient stream;

        [Tooltip("The importer of the models; it sets the axes.")]
        public Convention convention = Convention.GltFast;

        [Tooltip("Material of the deformables; each one gets a copy with its own colour.")]
        public Material material;

        private RobotDescription described;
        private StreamFrame shown;
        private uint sequence;
        private DeformableMesh[] meshes = new DeformableMesh[0];
        private string reported = "";

        /// <summary>Number of deformables of the scene.</summary>
        public int Count
        {
            get { return meshes.Length; }
        }

        /// <summary>Return the mesh of a deformable by its index in scene.json.</summary>
        public Mesh MeshOf(int index)
        {
            return meshes[index].Mesh;
        }

        /// <summary>Show the vertices of the stream's newest frame; LateUpdate calls this method in each frame,
        /// after `stream` has taken the frame.</summary>
        public void Tick()
        {
            if (stream == null || stream.Robot == null || stream.Frame == null)
            {
                return;
            }

            if (!ReferenceEquals(described, stream.Robot))
            {
                described = stream.Robot;
                shown = null;
                Build(described.deformables);
            }

            StreamFrame frame = stream.Frame;
            if (ReferenceEquals(shown, frame) && sequence == frame.Sequence)
            {
                return;
            }

            shown = frame;
            sequence = frame.Sequence;
            for (int i = 0; i < meshes.Length && i < frame.Fields.Length; i++)
            {
                if (frame.Fields[i].Length > 0) // else it is unknown at this time
                {
                    Report(meshes[i].Show(frame.Fields[i], convention));
                }
            }
        }

        private void Build(DeformableDescription[] found)
        {
            DeformableMesh.Destroy(meshes);
            meshes = new DeformableMesh[found.Length];
            for (int i = 0; i < found.Length; i++)
            {
                float[] c = found[i].color;
                var color = new Color(c[0], c[1], c[2], found[i].opacity);
                meshes[i] = new DeformableMesh(transform, found[i].name, found[i].Corners(), color, material);
            }
        }

        private void Report(string fault)
        {
            if (fault != "" && reported != fault) // report an error once, not in each frame
            {
                reported = fault;
                Debug.LogError("Deformables: " + fault, this);
            }
        }

        private void LateUpdate()
        {
            Tick();
        }

        private void OnDestroy()
        {
            DeformableMesh.Destroy(meshes);
        }
    }
}
