using System.Collections.Generic;
using System.Threading;
using System.Threading.Tasks;

namespace Twin.Player
{
    /// <summary>Queue of requests to be sent. A replaceable request (a drag) replaces the last waiting request if that
    /// is replaceable too; thus a drag never moves before a grab or a release.</summary>
    internal sealed class StreamOutbox
    {
        private const int Largest = 256;

        private readonly List<KeyValuePair<string, bool>> waiting = new List<KeyValuePair<string, bool>>();
        private readonly SemaphoreSlim any = new SemaphoreSlim(0);

        /// <summary>Add a request; false if too many requests wait.</summary>
        public bool Add(string json, bool replaces)
        {
            lock (waiting)
            {
                int last = waiting.Count - 1;
                if (replaces && last >= 0 && waiting[last].Value)
                {
                    waiting[last] = new KeyValuePair<string, bool>(json, true);
                    return true;
                }

                if (waiting.Count >= Largest)
                {
                    return false;
                }

                waiting.Add(new KeyValuePair<string, bool>(json, replaces));
            }

            any.Release();
            return true;
        }

        public void Clear()
        {
            lock (waiting)
            {
                waiting.Clear();
                while (any.Wait(0))
                {
                }
            }
        }

        /// <summary>Return the next request; null if none arrives within the given milliseconds.</summary>
        public async Task<string> NextAsync(int milliseconds, CancellationToken end)
        {
            await any.WaitAsync(milliseconds, end).ConfigureAwait(false);
            lock (waiting)
            {
                if (waiting.Count == 0)
                {
                    return null;
                }

                string json = waiting[0].Key;
                waiting.RemoveAt(0);
                return json;
            }
        }
    }
}
