"""Sessions at a surgeon's console: recorded second by second, replayed, and measured.

`tape` collects the signals of a World; `file` writes and reads a session; `run` runs a World and writes its session, or
replays a session; `movement` has measures of one motion, `measures` those of a whole session; `touch` finds the targets
that were touched.
"""
