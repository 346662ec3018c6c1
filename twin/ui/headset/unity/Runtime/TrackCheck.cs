using System;
using System.Collections.Generic;
using System.Globalization;

namespace Twin.Player
{
    /// <summary>Finds the faults that make a track unusable.</summary>
    public static class TrackCheck
    {
        private const double UnitTolerance = 1e-5;

        /// <summary>Throw an exception if a track has faults.</summary>
        /// <exception cref="FormatException">The track has faults; the message has one line for each.</exception>
        public static void Require(Track track)
        {
            List<string> faults = Faults(track);
            if (faults.Count > 0)
            {
                throw new FormatException(
                    "track '" + track.robot + "/" + track.protocol + "': " + string.Join("\n", faults.ToArray()));
            }
        }

        /// <summary>Return the text of every fault; empty for a valid track.</summary>
        public static List<string> Faults(Track t)
        {
            var faults = new List<string>();
            Word(faults, "schema", t.schema, Track.Schema);
            if (t.version != Track.Version)
            {
                faults.Add("version is " + t.version + ", this package reads " + Track.Version
                    + ": use the package of the bundle that contains the track");
            }

            if (faults.Count > 0)
            {
                return faults; // another kind of file: its fields are not checked
            }

            Word(faults, "frame", t.frame, "z-up right-handed");
            Word(faults, "length_unit", t.length_unit, "m");
            Word(faults, "angle_unit", t.angle_unit, "rad");
            Word(faults, "quaternion_order", t.quaternion_order, "xyzw");
            Lengths(faults, t);
            if (faults.Count > 0)
            {
                return faults; // the checks below require these lengths
            }

            Times(faults, t);
            Unique(faults, "links", t.links);
            Unique(faults, "joints", t.joints);
            Poses(faults, t);
            Joints(faults, t);
            Phases(faults, t);
            Names(faults, t);
            return faults;
        }

        private static void Lengths(List<string> faults, Track t)
        {
            if (t.frames < 1)
            {
                faults.Add("frames is " + t.frames + ", expected at least 1");
            }

            if (t.links.Length < 1)
            {
                faults.Add("links is empty");
            }

            Length(faults, "times", t.times.Length, t.frames, "frames");
            Length(faults, "poses", t.poses.Length, t.frames * t.links.Length * Track.PoseSize, "frames * links * 7");
            Length(faults, "positions", t.positions.Length, t.frames * t.joints.Length, "frames * joints");
            Length(faults, "joint_types", t.joint_types.Length, t.joints.Length, "joints");
            Length(faults, "joint_active", t.joint_active.Length, t.joints.Length, "joints");
            Length(faults, "joint_lower", t.joint_lower.Length, t.joints.Length, "joints");
            Length(faults, "joint_upper", t.joint_upper.Length, t.joints.Length, "joints");
            Length(faults, "phase_start", t.phase_start.Length, t.phases.Length, "phases");
            Length(faults, "phase_end", t.phase_end.Length, t.phases.Length, "phases");
            Length(faults, "phase_has_rcm", t.phase_has_rcm.Length, t.phases.Length, "phases");
            Length(faults, "phase_rcm", t.phase_rcm.Length, t.phases.Length * 3, "phases * 3");
            Length(faults, "tool_frame", t.tool_frame.Length, Track.PoseSize, "one pose");
            Length(faults, "frame_links", t.frame_links.Length, t.frame_names.Length, "frame_names");
            Length(
                faults, "frames_local", t.frames_local.Length, t.frame_names.Length * Track.PoseSize, "frame_names * 7");
            if (t.rcm.Length != 0)
            {
                Length(faults, "rcm", t.rcm.Length, 3, "x y z, or none");
            }
        }

        private static void Times(List<string> faults, Track t)
        {
            for (int k = 0; k < t.frames; k++)
            {
                double step = k == 0 ? 1.0 : t.times[k] - t.times[k - 1];
                if (!(step > 0.0) || double.IsInfinity(t.times[k]))
                {
                    faults.Add("times[" + k + "] is " + Text(t.times[k]) + ", expected more than the time before it");
                    return;
                }
            }

            if (!(t.rate > 0.0))
            {
                faults.Add("rate is " + Text(t.rate) + ", expected a positive number of frames per second");
            }
        }

        private static void Poses(List<string> faults, Track t)
        {
            int stride = t.links.Length * Track.PoseSize;
            for (int i = 0; i < t.poses.Length; i += Track.PoseSize)
            {
                string where = " of link '" + t.links[i % stride / Track.PoseSize] + "' at frame " + i / stride;
                if (!UnitPose(t.poses, i))
                {
                    faults.Add("the pose" + where + " has no unit quaternion, or is not finite (norm "
                        + Text(Norm(t.poses, i + 3)) + "): do not edit or round a track");
                    return;
                }

                if (i >= stride && Dot(t.poses, i + 3, i + 3 - stride) < 0.0)
                {
                    faults.Add("the quaternion" + where + " changes its sign: players that interpolate "
                        + "components would rotate the link by up to 180 degrees");
                    return;
                }
            }

            if (!UnitPose(t.tool_frame, 0))
            {
                faults.Add("tool_frame has no unit quaternion, or is not finite");
            }

            for (int i = 0; i < t.frame_names.Length; i++)
            {
                if (!UnitPose(t.frames_local, i * Track.PoseSize))
                {
                    faults.Add("frame '" + t.frame_names[i] + "' has no unit quaternion, or is not finite");
                }
            }
        }

        private static void Joints(List<string> faults, Track t)
        {
            for (int j = 0; j < t.joints.Length; j++)
            {
                string joint = "joint '" + t.joints[j] + "'";
                if (t.joint_types[j] != "revolute" && t.joint_types[j] != "prismatic")
                {
                    faults.Add(joint + " has type '" + t.joint_types[j] + "', expected revolute or prismatic");
                }

                if (t.joint_active[j] != 0 && t.joint_active[j] != 1)
                {
                    faults.Add(joint + " has joint_active " + t.joint_active[j] + ", expected 0 or 1");
                }

                if (!(t.joint_lower[j] < t.joint_upper[j]))
                {
                    faults.Add(joint + ": its limits " + Text(t.joint_lower[j]) + " .. " + Text(t.joint_upper[j])
                        + " are not ordered");
                }
            }

            for (int i = 0; i < t.positions.Length; i++)
            {
                if (float.IsNaN(t.positions[i]) || float.IsInfinity(t.positions[i]))
                {
                    faults.Add("joint '" + t.joints[i % t.joints.Length] + "' is not finite at frame "
                        + i / t.joints.Length);
                    return;
                }
            }
        }

        private static void Phases(List<string> faults, Track t)
        {
            for (int i = 0; i < t.phases.Length; i++)
            {
                bool ordered = i == 0 || t.phase_start[i] >= t.phase_start[i - 1];
                if (!ordered || !(t.phase_end[i] >= t.phase_start[i]))
                {
                    faults.Add("phase '" + t.phases[i] + "' lasts from " + Text(t.phase_start[i]) + " to "
                        + Text(t.phase_end[i]) + " s: phases must be in order and end after they start");
                }
            }
        }

        private static void Names(List<string> faults, Track t)
        {
            if (t.LinkIndex(t.tool_link) < 0)
            {
                faults.Add("tool_link '" + t.tool_link + "' is not a link");
            }

            if (Array.IndexOf(t.frame_names, t.moved_frame) < 0)
            {
                faults.Add("moved_frame '" + t.moved_frame + "' is not a named frame");
            }

            for (int i = 0; i < t.frame_links.Length; i++)
            {
                if (t.LinkIndex(t.frame_links[i]) < 0)
                {
                    faults.Add("frame '" + t.frame_names[i] + "' is on '" + t.frame_links[i]
                        + "', which is not a link");
                }
            }
        }

        private static void Word(List<string> faults, string field, string value, string expected)
        {
            if (value != expected)
            {
                faults.Add(field + " is '" + value + "', expected '" + expected + "'");
            }
        }

        private static void Length(List<string> faults, string field, int length, int expected, string why)
        {
            if (length != expected)
            {
                faults.Add(field + " has " + length + " numbers, expected " + expected + " (" + why + ")");
            }
        }

        private static void Unique(List<string> faults, string field, string[] names)
        {
            var seen = new HashSet<string>();
            foreach (string name in names)
            {
                if (string.IsNullOrEmpty(name) || !seen.Add(name))
                {
                    faults.Add(field + ": the name '" + name + "' is empty or duplicated");
                }
            }
        }

        private static bool UnitPose(float[] pose, int at)
        {
            double sum = (double)pose[at] + pose[at + 1] + pose[at + 2];
            return Math.Abs(Norm(pose, at + 3) - 1.0) < UnitTolerance && !double.IsNaN(sum) && !double.IsInfinity(sum);
        }

        private static double Norm(float[] q, int at)
        {
            return Math.Sqrt(Dot(q, at, at));
        }

        private static double Dot(float[] q, int a, int b)
        {
            return (double)q[a] * q[b] + (double)q[a + 1] * q[b + 1] + (double)q[a + 2] * q[b + 2]
                + (double)q[a + 3] * q[b + 3];
        }

        private static string Text(double value)
        {
            return value.ToString("G9", CultureInfo.InvariantCulture);
        }
    }
}
