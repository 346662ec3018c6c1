"""Limits for reading untrusted files, which may be designed to exhaust memory or time.

admit      all checks of a file: first by counts, then by its native parser
budget     table of limits by format: bytes, depth, count, files of an archive; seconds and memory of native parsers
once       reader that opens each file once and shares its bytes
text       readers of text, JSON and XML within their limits
gltf       counts of parts before a library reads the file
guard      test run of a native parser in a separate process with limits
consent    the user's consent to the Python expressions of a xacro
xacro_process   the program that `guard` runs for a xacro; it uses ros_packages and xml_lines
"""
