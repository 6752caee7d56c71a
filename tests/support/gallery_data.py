"""Comparison of what a figure of the gallery draws now with what was kept of it, and links of its pages."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest


def same(found: Any, kept: Any) -> None:
    """Compare what is drawn now with what was kept to four figures, one of which may be lost to other processors."""
    if isinstance(kept, dict):
        assert set(found) == set(kept)
        for key in kept:
            same(found[key], kept[key])
    elif isinstance(kept, list):
        if kept and all(isinstance(value, int | float) for value in kept):
            scale = float(np.max(np.abs(kept)))
            assert np.allclose(found, kept, rtol=2e-3, atol=2e-3 * scale)
            return
        assert len(found) == len(kept)
        for one, other in zip(found, kept, strict=True):
            same(one, other)
    else:
        assert found == (pytest.approx(kept, rel=2e-3) if isinstance(kept, float) else kept)


def check_links(text: str, folder: Path) -> None:
    """Check that files which a page in a folder links to are there, and so are its own anchors."""
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", text):
        assert (folder / target).exists(), target
    for anchor in re.findall(r"\]\(#([^)]+)\)", text):
        assert f'<a id="{anchor}"></a>' in text
