namespace Twin.Player
{
    /// <summary>Kinematics of one robot that runs on the device; `twin export` writes a class for each robot.</summary>
    /// <remarks>SI units, right-handed, z up. Poses are T_base_x, (3, 4) row by row unless stated. Arrays that a
    /// property returns are read only; methods that return false leave the state unchanged and set Reason.</remarks>
    public interface IRobotKinematics
    {
        string Robot { get; }

        /// <summary>Names of the active joints, in the order of Q.</summary>
        string[] Joints { get; }

        /// <summary>Whether each active joint is an angle.</summary>
        bool[] Angles { get; }

        string[] Links { get; }

        /// <summary>The link that carries the tool, and T_link_tool.</summary>
        string ToolLink { get; }

        double[] ToolFrame { get; }

        string[] DistanceNames { get; }

        /// <summary>Distances of two joints in m.</summary>
        double[] Distances { get; }

        double[] DrawnDistances { get; }

        string[] ParameterNames { get; }

        /// <summary>Parameters of the equations in SI units.</summary>
        double[] Parameters { get; }

        /// <summary>Joint values of the posture "home".</summary>
        double[] Home { get; }

        /// <summary>All joints, in the tree and in loops; the arrays below have an entry for each.</summary>
        string[] AllJoints { get; }

        /// <summary>"fixed", "revolute", "prismatic", "cylindrical", "spherical" or "free".</summary>
        string[] JointTypes { get; }

        /// <summary>Whether a joint closes a loop, so that it is not in the tree.</summary>
        bool[] InLoops { get; }

        /// <summary>Indices in Links.</summary>
        int[] JointParents { get; }

        int[] JointChildren { get; }

        /// <summary>Index in Q of an active joint, else -1.</summary>
        int[] JointActive { get; }

        /// <summary>T_parent_joint and T_child_joint (3, 4), 24 numbers for each joint; the axis is z.</summary>
        double[] JointFrames { get; }

        /// <summary>Lower and upper limit in m or rad, 2 numbers for each joint; infinite without a limit.</summary>
        double[] JointLimits { get; }

        /// <summary>Masses of the links in kg; 0: unknown.</summary>
        double[] LinkMasses { get; }

        bool HasEquations { get; }

        /// <summary>Joint values of the present state.</summary>
        double[] Q { get; }

        /// <summary>Poses of all links in the present state, 12 numbers each.</summary>
        double[] Poses { get; }

        double[] Tool { get; }

        /// <summary>Gap of the loops in m, misalignment in rad, margin (1 as drawn, 0 at a singularity).</summary>
        double[] Gaps { get; }

        string Reason { get; }

        /// <summary>Move the joints, with closed loops.</summary>
        bool MoveTo(double[] joints);

        /// <summary>Compute joint values from T_base_tool (4, 4) by the equations.</summary>
        bool Inverse(double[] T_base_tool, double[] result);

        /// <summary>Move the tool to T_base_tool (4, 4) by the equations.</summary>
        bool MoveTool(double[] T_base_tool);

        /// <summary>Return the first limit that joint values violate, or "".</summary>
        string Violated(double[] joints);

        /// <summary>Return the first limit of a passive joint that the present state violates, or "".</summary>
        string PassiveViolated();

        /// <summary>Move joint values into their limits.</summary>
        void Clamp(double[] joints);

        /// <summary>Return what is wrong with the present state: a limit, or a singularity that is near; or "".</summary>
        string Check();

        /// <summary>Change a distance of two joints in m.</summary>
        bool SetDistance(int index, double metres);

        /// <summary>Change a parameter of the equations.</summary>
        void SetParameter(int index, double value);

        /// <summary>Undo all changes of the design, and move to the posture "home".</summary>
        bool Reset();
    }
}
