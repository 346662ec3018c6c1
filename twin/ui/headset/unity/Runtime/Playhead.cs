using System;

namespace Twin.Player
{
    /// <summary>The displayed time of a motion: it plays, loops, or stops at the end.</summary>
    internal sealed class Playhead
    {
        private readonly double start;
        private readonly double end;

        /// <summary>Begin at the start, paused; times in s.</summary>
        public Playhead(double start, double end)
        {
            this.start = start;
            this.end = end;
            Time = start;
        }

        /// <summary>Displayed time in s.</summary>
        public double Time { get; private set; }

        public bool IsPlaying { get; private set; }

        /// <summary>Start or resume; if a motion that does not loop has ended, restart it.</summary>
        public void Play(float speed, bool loop)
        {
            if (!loop && speed >= 0f && Time >= end)
            {
                Time = start;
            }

            IsPlaying = true;
        }

        public void Pause()
        {
            IsPlaying = false;
        }

        /// <summary>Go to a time (s), which is clamped to start and end; NaN changes nothing.</summary>
        public void Seek(double time)
        {
            if (!double.IsNaN(time))
            {
                Time = Math.Max(start, Math.Min(end, time));
            }
        }

        /// <summary>Advance by `passed` s times the speed; return whether the motion has ended and stopped.</summary>
        public bool Tick(double passed, float speed, bool loop)
        {
            double length = end - start;
            double to = Time + passed * speed;
            bool over = to > end || to < start;
            if (over && loop && length > 0.0)
            {
                double along = (to - start) % length;
                Seek(start + (along < 0.0 ? along + length : along));
                return false;
            }

            Seek(to);
            IsPlaying = !over;
            return over;
        }
    }
}
