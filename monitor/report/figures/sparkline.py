"""A trend as small as a word, for tables."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup, escape
from numpy.typing import NDArray

from monitor.report.figures.drawing import BLUE, thin

_WIDTH, _HEIGHT, _BINS = 120, 26, 60
_LEAST_SPAN = np.log(2.0)
"""What changes by less than a factor of two fills less than the height: noise is to look small."""
_STROKE = f'fill="none" stroke="{BLUE}" stroke-width="1.2"'
_DOT = f'fill="{BLUE}"'
"""For where style sheets do not reach into pictures; the page's own has the last word."""


def sparkline(time: NDArray[np.float64], values: NDArray[np.float64], label: str) -> Markup:
    """Return inline SVG of positive values on a logarithmic scale; nothing where fewer than two are known."""
    known = np.isfinite(time) & np.isfinite(values) & (values > 0)
    if known.sum() < 2 or np.ptp(time[known]) == 0.0:
        return Markup("")
    x, y = thin(time[known], np.log(values[known]), _BINS)
    span = max(float(np.ptp(y)), _LEAST_SPAN)
    across = (x - x[0]) / (x[-1] - x[0]) * (_WIDTH - 4) + 2
    down = (_HEIGHT - 4) * (1.0 - (y - y.min()) / span) + 2
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(across, down, strict=True))
    return Markup(
        f'<svg class="spark" viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" aria-label="{escape(label)}">'
        f'<polyline points="{points}" {_STROKE}/><circle {_DOT} cx="{across[-1]:.1f}" cy="{down[-1]:.1f}" r="2"/></svg>'
    )
