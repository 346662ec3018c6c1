using System;

namespace Twin.Player
{
    /// <summary>Moves a robot by a grabbed point or by its tool on the device, without a server.</summary>
    /// <remarks>Damped least squares on the mechanism with closed loops; derivatives are differences of closed states.
    /// A step is clamped to the limits of the joints, and halved until the loops close, no passive joint passes its
    /// limit, and the distance to the target decreases. Lengths in m; angles count as lengths at 0.1 m.</remarks>
    public sealed class KinematicGrab
    {
        private const double Radius = 0.1; // m: a rotation by 1 rad counts as this length
        private const double Difference = 1e-6; // m or rad
        private const double Damping = 1e-8; // relative to the sum of squares of the Jacobian
        private const double Stride = 0.02; // m: largest motion of a joint in a step
        private const double There = 1e-7; // m: the target is reached
        private const int Halvings = 6;

        private readonly IRobotKinematics robot;
        private readonly double[] start;
        private readonly double[] trial;
        private readonly double[] joints;
        private readonly double[] step;
        private readonly double[] misfit = new double[6];
        private readonly double[] moved = new double[6];
        private readonly double[] goal = new double[12];
        private readonly double[] point = new double[3];
        private readonly double[] jacobian;
        private readonly double[] system = new double[6 * 7];
        private int link = -1;
        private int rows;

        public KinematicGrab(IRobotKinematics robot)
        {
            if (robot == null)
            {
                throw new ArgumentNullException("robot");
            }

            this.robot = robot;
            int n = robot.Joints.Length;
            start = new double[n];
            trial = new double[n];
            joints = new double[n];
            step = new double[n];
            jacobian = new double[6 * n];
            Reason = "";
        }

        /// <summary>Why the last motion ended before its target, or "".</summary>
        public string Reason { get; private set; }

        /// <summary>Move a point of a link (its coordinates on the link, m) towards a point in the base frame.</summary>
        /// <returns>The remaining distance in m.</returns>
        public double Point(int link, double[] onLink, double[] target, int steps)
        {
            this.link = link;
            rows = 3;
            Array.Copy(onLink, point, 3);
            for (int i = 0; i < 3; i++)
            {
                goal[4 * i + 3] = target[i];
            }

            return Run(steps);
        }

        /// <summary>Move the tool towards T_base_tool (3, 4).</summary>
        /// <returns>The remaining distance in m; rotations count as lengths at 0.1 m.</returns>
        public double Tool(double[] T_base_tool, int steps)
        {
            link = -1;
            rows = 6;
            Array.Copy(T_base_tool, goal, 12);
            return Run(steps);
        }

        /// <summary>Move one active joint towards a value in m or rad.</summary>
        /// <returns>The remaining difference.</returns>
        public double Joint(int joint, double value, int steps)
        {
            Reason = "";
            double reach = robot.Angles[joint] ? Stride / Radius : Stride;
            for (int s = 0; s < steps; s++)
            {
                Array.Copy(robot.Q, start, start.Length);
                Array.Copy(robot.Q, trial, trial.Length);
                double left = value - start[joint];
                if (Math.Abs(left) < 1e-12)
                {
                    break;
                }

                trial[joint] = start[joint] + Math.Max(-reach, Math.Min(reach, left));
                robot.Clamp(trial);
                if (!Accepted(trial, start))
                {
                    break;
                }

                if (Math.Abs(robot.Q[joint] - start[joint]) < 1e-12)
                {
                    Reason = "a limit is reached";
                    break;
                }
            }

            return Math.Abs(value - robot.Q[joint]);
        }

        private double Run(int steps)
        {
            Reason = "";
            double distance = Misfit(misfit);
            for (int s = 0; s < steps && distance > There; s++)
            {
                Array.Copy(robot.Q, start, start.Length);
                Linearize();
                if (!Solve())
                {
                    Reason = "the tool cannot be moved from here";
                    break;
                }

                double closer = Step(distance);
                if (!(closer < distance))
                {
                    break;
                }

                distance = closer;
            }

            return distance;
        }

        // Take a step, halved until it is accepted and comes closer; return the new distance, or the old one.
        private double Step(double distance)
        {
            double part = 1.0;
            double largest = 0.0;
            for (int i = 0; i < step.Length; i++)
            {
                largest = Math.Max(largest, Math.Abs(step[i]));
            }

            if (largest > Stride)
            {
                part = Stride / largest;
            }

            for (int h = 0; h <= Halvings; h++)
            {
                for (int i = 0; i < trial.Length; i++)
                {
                    trial[i] = start[i] + part * step[i] * Scale(i);
                }

                robot.Clamp(trial);
                if (Accepted(trial, start))
                {
                    double closer = Misfit(misfit);
                    if (closer < distance)
                    {
                        Reason = "";
                        return closer;
                    }

                    Reason = "no joint motion comes closer";
                    robot.MoveTo(start);
                }

                part *= 0.5;
            }

            Misfit(misfit);
            return distance;
        }

        // Move to joint values, unless a joint passes its limit there that does not at the values before; then go back.
        private bool Accepted(double[] wanted, double[] back)
        {
            string beyond = robot.Violated(wanted);
            if (beyond != "" && robot.Violated(back) == "")
            {
                Reason = beyond;
                return false;
            }

            string outside = robot.PassiveViolated();
            if (!robot.MoveTo(wanted))
            {
                Reason = robot.Reason;
                return false;
            }

            string violated = robot.PassiveViolated();
            if (violated != "" && outside == "")
            {
                Reason = violated;
                robot.MoveTo(back);
                return false;
            }

            return true;
        }

        private double Scale(int joint)
        {
            return robot.Angles[joint] ? 1.0 / Radius : 1.0;
        }

        // Fill the Jacobian by differences of closed states, and return to the start.
        private void Linearize()
        {
            int n = start.Length;
            for (int j = 0; j < n; j++)
            {
                double h = Difference;
                Array.Copy(start, joints, n);
                joints[j] += h;
                if (!robot.MoveTo(joints))
                {
                    h = -Difference;
                    joints[j] = start[j] + h;
                    if (!robot.MoveTo(joints))
                    {
                        h = double.PositiveInfinity; // this joint cannot move: its column is zero
                        robot.MoveTo(start);
                    }
                }

                Misfit(moved);
                for (int r = 0; r < rows; r++)
                {
                    jacobian[r * n + j] = (misfit[r] - moved[r]) / h * Scale(j);
                }
            }

            robot.MoveTo(start);
        }

        // Solve (J J^T + damping) y = misfit by elimination, and set the step to J^T y.
        private bool Solve()
        {
            int n = start.Length;
            double trace = 0.0;
            for (int i = 0; i < rows * n; i++)
            {
                trace += jacobian[i] * jacobian[i];
            }

            for (int r = 0; r < rows; r++)
            {
                for (int c = 0; c < rows; c++)
                {
                    double sum = r == c ? Damping * trace + 1e-18 : 0.0;
                    for (int j = 0; j < n; j++)
                    {
                        sum += jacobian[r * n + j] * jacobian[c * n + j];
                    }

                    system[r * 7 + c] = sum;
                }

                system[r * 7 + 6] = misfit[r];
            }

            if (!Eliminate())
            {
                return false;
            }

            for (int j = 0; j < n; j++)
            {
                step[j] = 0.0;
                for (int r = 0; r < rows; r++)
                {
                    step[j] += jacobian[r * n + j] * system[r * 7 + 6];
                }
            }

            return true;
        }

        // The matrix is symmetric and positive definite: no pivots are needed.
        private bool Eliminate()
        {
            for (int k = 0; k < rows; k++)
            {
                double pivot = system[k * 7 + k];
                if (!(pivot > 0.0))
                {
                    return false;
                }

                for (int r = k + 1; r < rows; r++)
                {
                    double factor = system[r * 7 + k] / pivot;
                    for (int c = k; c < rows; c++)
                    {
                        system[r * 7 + c] -= factor * system[k * 7 + c];
                    }

                    system[r * 7 + 6] -= factor * system[k * 7 + 6];
                }
            }

            for (int k = rows - 1; k >= 0; k--)
            {
                double sum = system[k * 7 + 6];
                for (int c = k + 1; c < rows; c++)
                {
                    sum -= system[k * 7 + c] * system[c * 7 + 6];
                }

                system[k * 7 + 6] = sum / system[k * 7 + k];
            }

            return true;
        }

        // Write what is missing to the target (m), and return its norm.
        private double Misfit(double[] missing)
        {
            double[] pose = link < 0 ? robot.Tool : robot.Poses;
            int at = link < 0 ? 0 : 12 * link;
            double square = 0.0;
            for (int i = 0; i < 3; i++)
            {
                int row = at + 4 * i;
                double place = pose[row + 3];
                if (link >= 0)
                {
                    place += pose[row] * point[0] + pose[row + 1] * point[1] + pose[row + 2] * point[2];
                }

                missing[i] = goal[4 * i + 3] - place;
                square += missing[i] * missing[i];
            }

            if (rows == 6)
            {
                square += Turn(pose, missing);
            }

            return Math.Sqrt(square);
        }

        // Half the sum of the cross products of present and wanted axes: the sine of the angle, along the axis.
        private double Turn(double[] pose, double[] missing)
        {
            for (int i = 3; i < 6; i++)
            {
                missing[i] = 0.0;
            }

            for (int axis = 0; axis < 3; axis++)
            {
                double x = pose[axis], y = pose[4 + axis], z = pose[8 + axis];
                double u = goal[axis], v = goal[4 + axis], w = goal[8 + axis];
                missing[3] += 0.5 * Radius * (y * w - z * v);
                missing[4] += 0.5 * Radius * (z * u - x * w);
                missing[5] += 0.5 * Radius * (x * v - y * u);
            }

            return missing[3] * missing[3] + missing[4] * missing[4] + missing[5] * missing[5];
        }
    }
}
