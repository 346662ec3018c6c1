"""Limits for reading untrusted files, which may be designed to exhaust memory or time.

admit      all checks of a file: counts first, then its native parser
budget     table of limits by format: bytes, depth, count; seconds and memory of native parsers
once       reader that opens each file once and shares its bytes
text       text, JSON and XML, read within their limits
gltf, archive      parts counted before a library reads them
guard      native parsers, run first in a separate process with limits
"""
