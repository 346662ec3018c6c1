namespace Twin.Player
{
    /// <summary>The keys of a motion: their times in s, in increasing order.</summary>
    internal static class Keys
    {
        /// <summary>Find the interval between keys that contains a time.</summary>
        /// <param name="times">Times of the keys; at least one.</param>
        /// <param name="time">Time in s, which is clamped to the times of the keys.</param>
        /// <param name="first">The key at or before the time.</param>
        /// <param name="share">Elapsed fraction of the interval, 0..1; 0 at the key `first`.</param>
        public static void Locate(double[] times, double time, out int first, out double share)
        {
            int last = times.Length - 1;
            if (!(time > times[0]) || last == 0)
            {
                first = 0;
                share = 0.0;
                return;
            }

            if (time >= times[last])
            {
                first = last - 1;
                share = 1.0;
                return;
            }

            int low = 0;
            int high = last;
            while (high - low > 1)
            {
                int middle = (low + high) / 2;
                if (times[middle] <= time)
                {
                    low = middle;
                }
                else
                {
                    high = middle;
                }
            }

            first = low;
            share = (time - times[low]) / (times[low + 1] - times[low]);
        }
    }
}
