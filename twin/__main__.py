"""`python -m twin`."""

import sys

if not sys.flags.safe_path:
    # The working directory is first on the path: a `numpy.py` that lies there must not be taken for NumPy. Where twin
    # itself comes from there, the package knows its own folder by now.
    del sys.path[0]

from twin.cli import main

if __name__ == "__main__":
    sys.exit(main())
