"""The command ``spallwatch``, also as ``python -m spallwatch``."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line."""
    from monitor.cli import main as run

    run()


if __name__ == "__main__":
    # Messages of usage name the command, not this file.
    sys.argv[0] = "spallwatch"
    main()
