"""Files that somebody else has made may be built to cost without end: what reading one may cost, and how that is held.

admit      the way in: counts first, then the native parser
budget     the table of limits by format: bytes, depth, count; seconds and memory of native parsers
text       text, JSON and XML read within their limits
gltf, ply, usda      counted before a library reads them
guard      native parsers tried in a process of their own, which the system stops at its limits
"""
