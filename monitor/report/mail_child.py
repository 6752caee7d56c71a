"""The child process that draws the picture of a mail; what it imports is imported after its settings are made."""

from __future__ import annotations

import base64
import os
import sys
from pathlib import Path

from models.platform.portable import lower_priority


def child() -> None:
    """Draw the picture of the JSON argument, :class:`monitor.report.mail_picture.Wanted`; print it in base64."""
    lower_priority(10)
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    if "MPLCONFIGDIR" not in os.environ and not os.access(cache, os.W_OK):
        # A service without a home would search all fonts anew for each mail.
        import json

        os.environ["MPLCONFIGDIR"] = str(Path(json.loads(sys.argv[1])["store"]).parent / "matplotlib")
    from monitor.report.mail_picture import Wanted, draw

    print(base64.b64encode(draw(Wanted.of_json(sys.argv[1]))).decode("ascii"), flush=True)
