using System;
using System.Collections.Generic;
using MixedReality.Toolkit;
using MixedReality.Toolkit.SpatialManipulation;
using MixedReality.Toolkit.UX;
using UnityEngine;

namespace Twin.Player.Samples
{
    /// <summary>A menu beside the palm with the two modules Simulation and Interaction.</summary>
    /// <remarks>Simulation: play, pause, steps through the track, scale. Interaction: an active joint in steps, a
    /// dimension of the mechanism by a slider, scale. The menu is made of cubes and texts, so that it needs no prefab.
    /// </remarks>
    public sealed class HandMenu : MonoBehaviour
    {
        private const float Wide = 0.075f; // m
        private const float High = 0.028f;
        private const float Gap = 0.004f;
        private const double AngleStep = 2.0 * Math.PI / 180.0; // rad
        private const double LengthStep = 0.005; // m
        private const double TimeStep = 0.1; // s
        private const float Change = 0.2f; // largest change of a dimension, as a fraction

        private readonly List<GameObject> simulation = new List<GameObject>();
        private readonly List<GameObject> interaction = new List<GameObject>();
        private HeadsetDemo demo;
        private Transform board;
        private TextMesh said;
        private TextMesh jointName;
        private TextMesh distanceName;
        private Slider dimension;
        private int joint;
        private int distance;
        private bool setting;

        /// <summary>Make the menu for a scene.</summary>
        public void Build(HeadsetDemo scene)
        {
            demo = scene;
            var menu = new GameObject("hand menu");
            menu.AddComponent<SolverHandler>();
            menu.AddComponent<HandConstraintPalmUp>();
            board = new GameObject("board").transform;
            board.SetParent(menu.transform, false);
            said = Text(board, new Vector3(0f, Row(-1), 0f), "");

            Button(null, 0, 0, "Simulation", () => Choose(true));
            Button(null, 1, 0, "Interaction", () => Choose(false));
            Slide(null, 1, "Scale", 0.1f, 2f, 1f, demo.Rescale);

            Button(simulation, 0, 2, "Play", () => demo.Player.Play());
            Button(simulation, 1, 2, "Pause", () => demo.Player.Pause());
            Button(simulation, 0, 3, "Step back", () => Step(-TimeStep));
            Button(simulation, 1, 3, "Step", () => Step(TimeStep));

            jointName = Text(Part(interaction, new Vector3(0f, Row(2), 0f)), Vector3.zero, "");
            Button(interaction, 0, 3, "Next joint", NextJoint);
            Button(interaction, 1, 3, "Home", () => demo.Device.ResetDesign());
            Button(interaction, 0, 4, "Joint -", () => MoveJoint(-1));
            Button(interaction, 1, 4, "Joint +", () => MoveJoint(1));
            distanceName = Text(Part(interaction, new Vector3(0f, Row(5), 0f)), Vector3.zero, "");
            Button(interaction, 0, 6, "Next dimension", NextDistance);
            dimension = Slide(interaction, 7, "Dimension", 1f - Change, 1f + Change, 1f, Resize);
            Choose(false);
        }

        private static float Row(int row)
        {
            return -(High + Gap) * row;
        }

        private void Choose(bool simulates)
        {
            demo.Choose(simulates);
            foreach (GameObject part in simulation)
            {
                part.SetActive(demo.Simulates);
            }

            foreach (GameObject part in interaction)
            {
                part.SetActive(!demo.Simulates);
            }

            Name();
        }

        private void Step(double seconds)
        {
            demo.Player.Pause();
            demo.Player.Seek(demo.Player.Time + seconds);
        }

        private void NextJoint()
        {
            joint = (joint + 1) % demo.Device.Kinematics.Joints.Length;
            Name();
        }

        private void MoveJoint(int sign)
        {
            IRobotKinematics robot = demo.Device.Kinematics;
            double step = robot.Angles[joint] ? AngleStep : LengthStep;
            demo.Device.MoveJoint(joint, robot.Q[joint] + sign * step);
            Name();
        }

        private void NextDistance()
        {
            int count = demo.Device.Kinematics.DistanceNames.Length;
            distance = count > 0 ? (distance + 1) % count : 0;
            IRobotKinematics robot = demo.Device.Kinematics;
            if (count > 0)
            {
                setting = true;
                dimension.Value = (float)(robot.Distances[distance] / robot.DrawnDistances[distance]);
                setting = false;
            }

            Name();
        }

        private void Resize(float factor)
        {
            IRobotKinematics robot = demo.Device.Kinematics;
            if (setting || robot.DistanceNames.Length == 0)
            {
                return;
            }

            bool good = demo.Device.SetDistance(distance, factor * robot.DrawnDistances[distance]);
            said.text = good ? "" : robot.Reason;
            Name();
        }

        private void Name()
        {
            IRobotKinematics robot = demo.Device.Kinematics;
            double value = robot.Q[joint];
            jointName.text = robot.Joints[joint] + (robot.Angles[joint]
                ? " " + (value * 180.0 / Math.PI).ToString("F1") + " deg"
                : " " + (value * 1000.0).ToString("F1") + " mm");
            distanceName.text = robot.DistanceNames.Length == 0 ? "" : robot.DistanceNames[distance] + " "
                + (robot.Distances[distance] * 1000.0).ToString("F2") + " mm";
        }

        private void Update()
        {
            if (demo == null)
            {
                return;
            }

            string reason = demo.Handles.Reason;
            if (reason != "")
            {
                said.text = reason;
            }
        }

        private Transform Part(List<GameObject> module, Vector3 place)
        {
            Transform part = new GameObject("part").transform;
            part.SetParent(board, false);
            part.localPosition = place;
            if (module != null)
            {
                module.Add(part.gameObject);
            }

            return part;
        }

        private static TextMesh Text(Transform parent, Vector3 place, string text)
        {
            var shown = new GameObject("text").AddComponent<TextMesh>();
            shown.transform.SetParent(parent, false);
            shown.transform.localPosition = place + new Vector3(0f, 0f, -0.012f);
            shown.transform.localScale = new Vector3(0.004f, 0.004f, 0.004f);
            shown.anchor = TextAnchor.MiddleCenter;
            shown.text = text;
            return shown;
        }

        private void Button(List<GameObject> module, int column, int row, string label, Action press)
        {
            Transform part = Part(module, new Vector3((column - 0.5f) * (Wide + Gap), Row(row), 0f));
            GameObject cube = GameObject.CreatePrimitive(PrimitiveType.Cube); // with a collider
            cube.transform.SetParent(part, false);
            cube.transform.localScale = new Vector3(Wide, High, 0.01f);
            cube.AddComponent<StatefulInteractable>().OnClicked.AddListener(() => press());
            Text(part, Vector3.zero, label);
        }

        private Slider Slide(
            List<GameObject> module, int row, string label, float low, float high, float value, Action<float> set)
        {
            Transform part = Part(module, new Vector3(0f, Row(row), 0f));
            Text(part, new Vector3(-Wide, 0f, 0f), label);
            Transform start = Mark(part, new Vector3(-0.03f, 0f, 0f));
            Transform end = Mark(part, new Vector3(Wide, 0f, 0f));
            GameObject knob = GameObject.CreatePrimitive(PrimitiveType.Cube);
            knob.transform.SetParent(part, false);
            knob.transform.localScale = new Vector3(0.012f, High, 0.012f);
            var slider = part.gameObject.AddComponent<Slider>();
            slider.SliderStart = start;
            slider.SliderEnd = end;
            slider.HandleTransform = knob.transform;
            slider.MinValue = low;
            slider.MaxValue = high;
            slider.Value = value;
            slider.OnValueUpdated.AddListener(data =>
            {
                knob.transform.localPosition = start.localPosition
                    + (end.localPosition - start.localPosition) * ((data.NewValue - low) / (high - low));
                set(data.NewValue);
            });
            knob.transform.localPosition = start.localPosition
                + (end.localPosition - start.localPosition) * ((value - low) / (high - low));
            return slider;
        }

        private static Transform Mark(Transform parent, Vector3 place)
        {
            Transform mark = new GameObject("end of a slider").transform;
            mark.SetParent(parent, false);
            mark.localPosition = place;
            return mark;
        }
    }
}
