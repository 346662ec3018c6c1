// Runs the kinematics that twin exports for a device, without Unity, and prints what they compute.
//
//     Device.exe <class> <file>     each line of the file is a command:
//     move q...                     MoveTo: "good|bad" and the poses of all links
//     inverse T(16)                 Inverse: joint values
//     check                         Check
//     distance <index> <m>          SetDistance
//     parameter <index> <value>     SetParameter
//     grab <link> point(3) goal(3) <steps>   KinematicGrab.Point: remaining distance, joints
//     tool T(12) <steps>            KinematicGrab.Tool
//     joint <index> <value> <steps> KinematicGrab.Joint
//     time <repetitions> q...       least of eight rounds, microseconds: MoveTo between q and here, Inverse, Check, Tool
using System;
using System.Diagnostics;
using System.Globalization;
using System.IO;
using System.Text;
using Twin.Player;

public static class Device
{
    public static void Main(string[] arguments)
    {
        var robot = (IRobotKinematics)Activator.CreateInstance(Type.GetType("Twin.Robots." + arguments[0], true));
        var grab = new KinematicGrab(robot);
        foreach (string line in File.ReadAllLines(arguments[1]))
        {
            string[] words = line.Split(' ');
            var x = new double[words.Length - 1];
            for (int i = 0; i < x.Length; i++)
            {
                x[i] = double.Parse(words[i + 1], CultureInfo.InvariantCulture);
            }

            Console.WriteLine(Answer(robot, grab, words[0], x));
        }
    }

    private static string Answer(IRobotKinematics robot, KinematicGrab grab, string command, double[] x)
    {
        switch (command)
        {
            case "move":
                return Said(robot.MoveTo(x), robot) + Text(robot.Poses) + Text(robot.Tool);
            case "inverse":
                var q = new double[robot.Joints.Length];
                return Said(robot.Inverse(x, q), robot) + Text(q);
            case "check":
                return "good|" + robot.Check();
            case "distance":
                return Said(robot.SetDistance((int)x[0], x[1]), robot) + Text(robot.Poses) + Text(robot.Tool);
            case "parameter":
                robot.SetParameter((int)x[0], x[1]);
                return "good|";
            case "grab":
                double left = grab.Point((int)x[0], Part(x, 1, 3), Part(x, 4, 3), (int)x[7]);
                return "good|" + grab.Reason + "|" + Text(new[] { left }) + Text(robot.Q);
            case "tool":
                left = grab.Tool(Part(x, 0, 12), (int)x[12]);
                return "good|" + grab.Reason + "|" + Text(new[] { left }) + Text(robot.Q);
            case "joint":
                left = grab.Joint((int)x[0], x[1], (int)x[2]);
                return "good|" + grab.Reason + "|" + Text(new[] { left }) + Text(robot.Q);
            case "time":
                return "good||" + Text(Times(robot, grab, (int)x[0], Part(x, 1, x.Length - 1)));
            default:
                throw new ArgumentException(command);
        }
    }

    private static double[] Times(IRobotKinematics robot, KinematicGrab grab, int repetitions, double[] there)
    {
        var here = (double[])robot.Q.Clone();
        var pose = new double[16];
        Array.Copy(robot.Tool, pose, 12);
        pose[15] = 1.0;
        var q = new double[here.Length];
        var times = new double[4];
        var least = new[] { double.MaxValue, double.MaxValue, double.MaxValue, double.MaxValue };
        for (int round = 0; round < 8; round++) // the first round compiles; other programs disturb some of the others
        {
            var watch = Stopwatch.StartNew();
            for (int i = 0; i < repetitions; i++)
            {
                robot.MoveTo(i % 2 == 0 ? there : here);
            }

            times[0] = watch.Elapsed.TotalMilliseconds * 1e3 / repetitions;
            watch.Restart();
            for (int i = 0; i < repetitions; i++)
            {
                robot.Inverse(pose, q);
            }

            times[1] = watch.Elapsed.TotalMilliseconds * 1e3 / repetitions;
            watch.Restart();
            for (int i = 0; i < repetitions; i++)
            {
                robot.Check();
            }

            times[2] = watch.Elapsed.TotalMilliseconds * 1e3 / repetitions;
            robot.MoveTo(here);
            double[] tool = (double[])robot.Tool.Clone();
            watch.Restart();
            for (int i = 0; i < repetitions; i++)
            {
                tool[11] += i % 2 == 0 ? 1e-3 : -1e-3;
                grab.Tool(tool, 1);
            }

            times[3] = watch.Elapsed.TotalMilliseconds * 1e3 / repetitions;
            robot.MoveTo(here);
            for (int i = 0; i < times.Length; i++)
            {
                least[i] = Math.Min(least[i], times[i]);
            }
        }

        return least;
    }

    private static double[] Part(double[] x, int start, int count)
    {
        var part = new double[count];
        Array.Copy(x, start, part, 0, count);
        return part;
    }

    private static string Said(bool good, IRobotKinematics robot)
    {
        return (good ? "good|" : "bad|") + robot.Reason + "|";
    }

    private static string Text(double[] numbers)
    {
        var text = new StringBuilder();
        foreach (double x in numbers)
        {
            text.Append(x.ToString("R", CultureInfo.InvariantCulture)).Append(' ');
        }

        return text.ToString();
    }
}
