using System;
using System.Collections.Generic;
using System.Globalization;
using UnityEngine;

namespace Twin.Player
{
    /// <summary>One comparison with the golden vectors.</summary>
    public sealed class CheckResult
    {
        public string Name = "";

        /// <summary>The largest difference; NaN after an exception.</summary>
        public double Worst;

        public double Tolerance;
        public string Unit = "";

        /// <summary>Count of compared numbers.</summary>
        public int Count;

        /// <summary>Type and message of the exception, or "".</summary>
        public string Fault = "";

        public bool Passed
        {
            get { return Fault == "" && Count > 0 && Worst <= Tolerance; }
        }

        public override string ToString()
        {
            string text = (Passed ? "ok    " : "FAILED ") + Name;
            if (Fault != "")
            {
                return text + ": " + Fault;
            }

            return text + ": " + Worst.ToString("0.0e+0", CultureInfo.InvariantCulture) + " " + Unit + " of "
                + Tolerance.ToString("0.0e+0", CultureInfo.InvariantCulture) + ", " + Count + " compared";
        }
    }

    /// <summary>The comparisons of the self test. They use the engine's Transforms, JSON reader and physics, and
    /// therefore test the machine on which they run.</summary>
    public static class SelfChecks
    {
        private delegate void Comparison(CheckResult result);

        /// <summary>Return the result of every check; an exception in a check becomes its fault.</summary>
        public static List<CheckResult> Run()
        {
            var results = new List<CheckResult>();
            Golden golden = null;
            results.Add(Check("golden vectors are read", 0.0, "", r =>
            {
                golden = Golden.Load();
                r.Count = golden.track.poses.Length;
            }));
            if (golden == null)
            {
                return results;
            }

            foreach (Convention convention in new[] { Convention.GltFast, Convention.UrdfImporter })
            {
                Convention c = convention;
                results.Add(Check(c + ": points on links", 1e-6, "m", r => Points(golden, c, r)));
                results.Add(Check(c + ": conversion and inverse", 1e-6, "", r => Back(golden, c, r)));
                results.Add(Check(c + ": grab of the tool", 2e-6, "", r => GrabTool(golden, c, r)));
                results.Add(Check(c + ": grab of a link", 2e-6, "m", r => GrabLink(golden, c, r)));
            }

            results.Add(Check("between keys", 1e-6, "", r => Between(golden, r)));
            results.Add(Check("rotations, quaternions of either sign", 1e-6, "", r => Turns(golden, r)));
            results.Add(Check("joint values", 1e-6, "m, rad", r => Joints(golden, r)));
            results.Add(Check("drive targets", 1e-4, "deg, m", r => Drives(golden, r)));
            results.Add(Check("phases", 0.0, "", r => Phases(golden, r)));
            results.Add(Check("frame of the stream", 0.0, "", r => Stream(golden, r)));
            return results;
        }

        private static CheckResult Check(string name, double tolerance, string unit, Comparison compare)
        {
            var result = new CheckResult { Name = name, Tolerance = tolerance, Unit = unit };
            try
            {
                compare(result);
            }
            catch (Exception error)
            {
                result.Worst = double.NaN;
                result.Fault = error.GetType().Name + ": " + error.Message;
            }

            return result;
        }

        // Compare a mesh vertex of every link, on Transforms that the player moves, in a model that is moved, rotated
        // and scaled.
        private static void Points(Golden golden, Convention convention, CheckResult result)
        {
            GameObject model = golden.Model(convention);
            try
            {
                var player = model.AddComponent<TrackPlayer>();
                player.convention = convention;
                player.Load(golden.track);
                for (int i = 0; i < golden.point_link.Length; i++)
                {
                    player.Seek(golden.track.times[golden.point_key[i]]);
                    Vector3 point = Golden.Vector(golden.Points(convention), i);
                    Vector3 shown = player.Binding.Link(golden.point_link[i]).TransformPoint(point);
                    Compare(result, shown, Golden.Vector(golden.World(convention), i));
                }
            }
            finally
            {
                UnityEngine.Object.DestroyImmediate(model);
            }
        }

        private static void Back(Golden golden, Convention convention, CheckResult result)
        {
            for (int i = 0; i < golden.point_link.Length; i++)
            {
                Vector3 robot = Golden.Vector(golden.point_robot, i);
                Compare(result, Frames.ToUnity(robot, convention), Golden.Vector(golden.Points(convention), i));
                Compare(result, Frames.FromUnity(Golden.Vector(golden.Points(convention), i), convention), robot);
            }

            for (int i = 0; i < golden.turn_share.Length; i++)
            {
                Quaternion q = Golden.Rotation(golden.turn_a, 4 * i);
                Compare(result, Frames.FromUnity(Frames.ToUnity(q, convention), convention), q);
            }
        }

        private static void GrabTool(Golden golden, Convention convention, CheckResult result)
        {
            Held(golden, convention, (grab, sent) =>
            {
                Vector3 hand;
                Quaternion turn;
                Track.ReadPose(golden.grab_hands, 0, out hand, out turn);
                grab.BeginTool(hand, turn);
                Track.ReadPose(golden.grab_hands, Track.PoseSize, out hand, out turn);
                grab.Move(hand, turn);
                grab.End();
                Same(result, sent.Count, 3);
                var drag = JsonUtility.FromJson<Sent>(sent[1]);
                Vector3 position, wanted;
                Quaternion rotation, wantedTurn;
                Track.ReadPose(drag.pose, 0, out position, out rotation);
                Track.ReadPose(golden.GrabWant(convention), 0, out wanted, out wantedTurn);
                Compare(result, position, wanted);
                Compare(result, rotation, wantedTurn);
            });
        }

        private static void GrabLink(Golden golden, Convention convention, CheckResult result)
        {
            Held(golden, convention, (grab, sent) =>
            {
                for (int i = 0; i < golden.point_link.Length; i++)
                {
                    if (golden.point_key[i] != golden.grab_key)
                    {
                        continue;
                    }

                    Vector3 world = Golden.Vector(golden.World(convention), i);
                    sent.Clear();
                    grab.BeginLink(grab.stream.Binding.Link(golden.point_link[i]), world);
                    grab.Move(world, Quaternion.identity);
                    var taken = JsonUtility.FromJson<Sent>(sent[0]);
                    var drag = JsonUtility.FromJson<Sent>(sent[1]);
                    Compare(result, Golden.Vector(taken.point, 0), Golden.Vector(golden.point_robot, i));
                    Vector3 position;
                    Quaternion rotation;
                    golden.track.Key(golden.grab_key, golden.point_link[i], out position, out rotation);
                    Compare(result, Golden.Vector(drag.point, 0), position + rotation * Golden.Vector(taken.point, 0));
                    grab.End();
                }
            });
        }

        private static void Held(Golden golden, Convention convention, Action<Grab, List<string>> use)
        {
            GameObject model = golden.Model(convention);
            try
            {
                model.SetActive(false); // no connection: the test supplies the frames
                var stream = model.AddComponent<StreamClient>();
                stream.convention = convention;
                stream.connectOnEnable = false;
                stream.Use(golden.Robot());
                var frame = new StreamFrame();
                int stride = golden.track.links.Length * Track.PoseSize;
                frame.Poses = new float[stride];
                Array.Copy(golden.track.poses, golden.grab_key * stride, frame.Poses, 0, stride);
                stream.Show(frame);
                var grab = model.AddComponent<Grab>();
                grab.stream = stream;
                var sent = new List<string>();
                grab.Outgoing = (json, replaces) =>
                {
                    sent.Add(json);
                    return true;
                };
                use(grab, sent);
            }
            finally
            {
                UnityEngine.Object.DestroyImmediate(model);
            }
        }

        private static void Between(Golden golden, CheckResult result)
        {
            for (int i = 0; i < golden.between_time.Length; i++)
            {
                Vector3 position, wanted;
                Quaternion rotation, wantedTurn;
                golden.track.Sample(golden.between_time[i], golden.between_link[i], out position, out rotation);
                Track.ReadPose(golden.between_pose, i * Track.PoseSize, out wanted, out wantedTurn);
                Compare(result, position, wanted);
                Compare(result, rotation, wantedTurn);
            }
        }

        private static void Turns(Golden golden, CheckResult result)
        {
            for (int i = 0; i < golden.turn_share.Length; i++)
            {
                Quaternion a = Golden.Rotation(golden.turn_a, 4 * i);
                Quaternion b = Golden.Rotation(golden.turn_b, 4 * i);
                Compare(result, Frames.Slerp(a, b, golden.turn_share[i]), Golden.Rotation(golden.turn_want, 4 * i));
            }
        }

        private static void Joints(Golden golden, CheckResult result)
        {
            for (int i = 0; i < golden.joint_name.Length; i++)
            {
                int joint = golden.track.JointIndex(golden.joint_name[i]);
                Same(result, golden.track.Joint(golden.joint_time, joint), golden.joint_want[i]);
            }
        }

        private static void Drives(Golden golden, CheckResult result)
        {
            var holder = new GameObject("drives");
            try
            {
                var driver = holder.AddComponent<ArticulationDriver>();
                for (int i = 0; i < golden.drive_joint.Length; i++)
                {
                    int joint = golden.track.JointIndex(golden.drive_joint[i]);
                    var entry = new DrivenJoint { joint = golden.drive_joint[i], sign = golden.drive_sign[i] };
                    float target = driver.Target(golden.track, joint, golden.drive_value[i], entry);
                    Same(result, target, golden.drive_target[i]);
                }
            }
            finally
            {
                UnityEngine.Object.DestroyImmediate(holder);
            }
        }

        private static void Phases(Golden golden, CheckResult result)
        {
            for (int i = 0; i < golden.phase_time.Length; i++)
            {
                int phase = golden.track.PhaseAt(golden.phase_time[i]);
                Same(result, phase >= 0 && golden.track.phases[phase] == golden.phase_name[i] ? 0.0 : 1.0, 0.0);
            }
        }

        private static void Stream(Golden golden, CheckResult result)
        {
            byte[] data = Convert.FromBase64String(golden.stream);
            var frame = new StreamFrame();
            string fault;
            if (!frame.Read(data, data.Length, out fault))
            {
                throw new FormatException(fault);
            }

            Same(result, frame.Sequence, double.Parse(golden.stream_sequence, CultureInfo.InvariantCulture));
            Same(result, frame.ServerTime, golden.stream_server_time);
            Same(result, frame.ClipTime, golden.stream_clip_time);
            Same(result, frame.Flags, golden.stream_flags);
            int stride = golden.track.links.Length * Track.PoseSize;
            for (int i = 0; i < stride; i++)
            {
                Same(result, frame.Poses[i], golden.track.poses[golden.stream_key * stride + i]);
            }

            for (int i = 0; i < golden.stream_joints.Length; i++)
            {
                Same(result, frame.Joints[i], golden.stream_joints[i]);
            }

            for (int i = 0; i < Track.PoseSize; i++)
            {
                Same(result, frame.Ghost[i], golden.stream_ghost[i]);
            }
        }

        private static void Compare(CheckResult result, Vector3 shown, Vector3 wanted)
        {
            Same(result, shown.x, wanted.x);
            Same(result, shown.y, wanted.y);
            Same(result, shown.z, wanted.z);
        }

        // q and -q are the same rotation.
        private static void Compare(CheckResult result, Quaternion shown, Quaternion wanted)
        {
            float dot = shown.x * wanted.x + shown.y * wanted.y + shown.z * wanted.z + shown.w * wanted.w;
            float sign = dot < 0f ? -1f : 1f;
            Same(result, sign * shown.x, wanted.x);
            Same(result, sign * shown.y, wanted.y);
            Same(result, sign * shown.z, wanted.z);
            Same(result, sign * shown.w, wanted.w);
        }

        private static void Same(CheckResult result, double shown, double wanted)
        {
            double off = Math.Abs(shown - wanted);
            result.Count++;
            if (!(off <= result.Worst))
            {
                result.Worst = double.IsNaN(off) ? double.PositiveInfinity : off;
            }
        }

        /// <summary>A request, parsed from its JSON text.</summary>
        [Serializable]
        private sealed class Sent
        {
            public float[] pose = new float[0];
            public float[] point = new float[0];
        }
    }
}
