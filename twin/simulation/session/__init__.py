"""Sessions at a surgeon's console: recording to a file every second, replay, and measures.

`tape` collects the signals of a World; `session_file` writes and reads a session; `session_run` runs a World and writes
its session, or replays a session; `movement` has measures of one motion, `measures` has measures of a whole session;
`task_play` is what the kinds of tasks have in common.
"""
