using System;
using UnityEngine;

namespace Twin.Player.Samples
{
    /// <summary>The scene for HoloLens and other headsets: the robot moves on the device, or plays a track.</summary>
    /// <remarks>The menu "Twin > Headset > Create scene" makes a scene with it. Assign the model that glTFast imported
    /// from robot.glb, and a track.</remarks>
    public sealed class HeadsetDemo : MonoBehaviour
    {
        [Tooltip("The model imported by glTFast from <robot>.glb.")]
        public GameObject robot;

        [Tooltip("tracks/<protocol>.json, for the module Simulation.")]
        public TextAsset track;

        [Tooltip("Class that `twin export` wrote for the robot.")]
        public string kinematics = "Twin.Robots.SilsKinematics";

        [Tooltip("Place of the robot in front of the user, in m.")]
        public Vector3 place = new Vector3(0f, -0.4f, 1f);

        /// <summary>The robot that is grabbed in the module Interaction.</summary>
        public DeviceRobot Device { get; private set; }

        /// <summary>The player of the module Simulation; null without a track.</summary>
        public TrackPlayer Player { get; private set; }

        public LinkHandles Handles { get; private set; }

        public Transform Shown { get; private set; }

        /// <summary>Whether the robot plays a track (Simulation) or is grabbed (Interaction).</summary>
        public bool Simulates { get; private set; }

        private void Start()
        {
            GameObject shown = Instantiate(robot);
            shown.name = robot.name;
            Shown = shown.transform;
            Shown.SetParent(transform, false);
            Shown.localPosition = place;
            // Animation clips of the GLB would overwrite the poses of player and kinematics.
            foreach (Animation baked in shown.GetComponentsInChildren<Animation>())
            {
                baked.enabled = false;
            }

            Device = shown.AddComponent<DeviceRobot>();
            Device.Use(Made(kinematics));
            if (track != null)
            {
                Player = shown.AddComponent<TrackPlayer>();
                Player.playOnStart = false;
                Player.Load(track.text);
            }

            Handles = gameObject.AddComponent<LinkHandles>();
            Handles.Attach(Device);
            gameObject.AddComponent<HandMenu>().Build(this);
            Choose(false);
        }

        /// <summary>Choose the module: Simulation (true) or Interaction.</summary>
        public void Choose(bool simulation)
        {
            Simulates = simulation && Player != null;
            Handles.Allow(!Simulates);
            if (Simulates)
            {
                Player.Play();
                return;
            }

            if (Player != null)
            {
                Player.Pause();
            }

            Device.Show();
        }

        /// <summary>Scale the robot and everything that is shown at it.</summary>
        public void Rescale(float scale)
        {
            Shown.localScale = new Vector3(scale, scale, scale);
        }

        private static IRobotKinematics Made(string name)
        {
            Type type = typeof(DeviceRobot).Assembly.GetType(name);
            if (type == null)
            {
                throw new ArgumentException("there is no class " + name + " in the package: export the robot with "
                    + "`twin export <robot> --to unity,glb,tracks`, and write the name of its class here");
            }

            return (IRobotKinematics)Activator.CreateInstance(type);
        }
    }
}
