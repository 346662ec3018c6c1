"""Limits for reading untrusted files, which may be made to exhaust memory or time.

admit      the way in: counts first, then the native parser
budget     the table of limits by format: bytes, depth, count; seconds and memory of native parsers
text       text, JSON and XML read within their limits
gltf, ply, usda      counted before a library reads them
guard      native parsers tried in a separate process with limits
"""
