"""`python -m twin`."""

import sys

if not sys.flags.safe_path:
    # The working directory is first on the path. It is removed, so that a `numpy.py` in it is not imported as NumPy. If
    # twin itself is in the working directory, the package has already stored its own folder and is still found.
    del sys.path[0]

from twin.cli import main

if __name__ == "__main__":
    sys.exit(main())
