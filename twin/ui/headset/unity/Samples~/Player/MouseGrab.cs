using UnityEngine;

namespace Twin.Player.Samples
{
    /// <summary>Drags the link under the mouse in the plane of the screen. The right button drags
    /// the tool, without rotation.</summary>
    /// <remarks>It uses the old Input class: set Player Settings, Active Input Handling to "Both" or "Old". With XR
    /// Interaction Toolkit or MRTK, call the same methods of <see cref="Grab"/> in the select events.</remarks>
    public sealed class MouseGrab : MonoBehaviour
    {
        public Grab grab;

        private Plane plane;

        private void Update()
        {
            Camera eye = Camera.main;
            if (eye == null || grab == null || grab.stream == null || grab.stream.Binding == null)
            {
                return;
            }

            Ray ray = eye.ScreenPointToRay(Input.mousePosition);
            if (Input.GetMouseButtonDown(0) || Input.GetMouseButtonDown(1))
            {
                Begin(ray, eye, Input.GetMouseButtonDown(1));
            }

            float distance;
            bool down = Input.GetMouseButton(0) || Input.GetMouseButton(1);
            if (!down)
            {
                grab.End();
            }
            else if (grab.IsHolding && plane.Raycast(ray, out distance))
            {
                grab.Move(ray.GetPoint(distance), Quaternion.identity);
            }
        }

        private void Begin(Ray ray, Camera eye, bool tool)
        {
            Renderer nearest = null;
            float best = float.PositiveInfinity;
            foreach (Renderer part in grab.stream.GetComponentsInChildren<Renderer>())
            {
                float distance;
                if (part.bounds.IntersectRay(ray, out distance) && distance < best)
                {
                    best = distance;
                    nearest = part;
                }
            }

            if (nearest == null)
            {
                return;
            }

            Vector3 point = ray.GetPoint(best);
            plane = new Plane(eye.transform.forward, point);
            if (tool)
            {
                grab.BeginTool(point, Quaternion.identity);
            }
            else
            {
                grab.BeginLink(nearest.transform, point);
            }
        }
    }
}
