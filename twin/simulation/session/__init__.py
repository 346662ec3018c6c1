"""Sessions at a surgeon's console: recording to a file every second, replay, and measures.

`tape` collects the signals of a World; `file` writes and reads a session; `run` runs a World and writes its session, or
replays a session; `movement` has measures of one motion, `measures` has measures of a whole session; `play` is what
the kinds of tasks have in common.
"""
