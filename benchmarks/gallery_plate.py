"""What the figures of the gallery share: a picture with its data and with what the print says of it."""

from __future__ import annotations

import io
import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure, FigureBase
from PIL import Image

from monitor.report.figures.drawing import BLUE, GREEN, STYLE, VERMILION, WIDTH

MOST_BYTES = 200_000
"""A picture of the gallery is smaller than this: drawn with lines where that is possible, else with dots."""
DEFECTS = {"D1": (BLUE, "o"), "D2": (VERMILION, "s"), "D3": (GREEN, "^")}
"""Colour and marker of each seeded defect."""
CLOSE = 0.03
"""What counts as close: the rule of docs/evidence/published-figures.md."""
_FRACTION = re.compile(r"(\.\d\d)\d+")
_PLACES = re.compile(r'\b(?:d|x|y|points)="[^"]*"')
_DPI = (120, 105, 90, 75)


@dataclass(frozen=True)
class Claim:
    """One thing that the print says of a figure, and what is obtained.

    Attributes:
        what: is said.
        printed: the value or the words of the print.
        obtained: ours.
        verdict: "agrees", "close", "differs", or "not comparable" where it is another machine.
    """

    what: str
    printed: str
    obtained: str
    verdict: str


@dataclass(frozen=True, eq=False)
class Plate:
    """A figure of the gallery.

    Attributes:
        caption: what is seen.
        label: the same for those who cannot see it.
        height: in inches.
        draw: draws it.
        data: what is drawn; units end the names.
        claims: what the print says of it.
        machine: "" where it is the thesis' own scene, otherwise what it is instead.
    """

    caption: str
    label: str
    height: float
    draw: Callable[[FigureBase], None]
    data: Mapping[str, Any]
    claims: Sequence[Claim] = field(default_factory=tuple)
    machine: str = ""


def number(what: str, printed: float, obtained: float, unit: str, half: float = 0.0) -> Claim:
    """Return a claim of one number: it agrees within half a unit of the last printed digit, and is close within 3 %."""
    off = abs(obtained - printed)
    verdict = "agrees" if off <= half * (1 + 1e-9) else "close" if off <= CLOSE * abs(printed) else "differs"
    ours = f"{obtained:.{4 if abs(obtained) >= 1 else 3}g} {unit}".rstrip()
    return Claim(what, f"{printed:g} {unit}".rstrip(), f"{ours} ({100 * (obtained / printed - 1):+.2f} %)", verdict)


def words(what: str, cases: Sequence[bool], printed: str = "in words") -> Claim:
    """Return a claim in words that holds in so many cases: it agrees where it holds in all of them."""
    held = sum(cases)
    verdict = "agrees" if held == len(cases) else "differs" if held == 0 else "in part"
    return Claim(what, printed, f"{held} of {len(cases)}", verdict)


@mpl.rc_context({**STYLE, "svg.fonttype": "path"})
def save_plate(plate: Plate, number: str, pictures: Path, data: Path) -> Path:
    """Write the picture and the JSON file of a figure into their folders; return the picture's path.

    The picture is SVG, or PNG where that would be large.

    Raises:
        ValueError: no picture of it is small enough.
    """
    made = Figure(figsize=(WIDTH, plate.height), layout="constrained")
    FigureCanvasAgg(made)
    plate.draw(made)
    suffix, content = _encoded(made, number)
    for folder in (pictures, data):
        folder.mkdir(parents=True, exist_ok=True)
    for old in (".svg", ".png"):
        (pictures / f"fig{number}{old}").unlink(missing_ok=True)
    path = pictures / f"fig{number}{suffix}"
    path.write_bytes(content)
    stored = {
        "figure": number,
        "picture": path.name,
        "caption": plate.caption,
        "label": plate.label,
        "machine": plate.machine,
        "claims": [asdict(claim) for claim in plate.claims],
        "data": plain(plate.data),
    }
    text = json.dumps(stored, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    # One quantity a line: what changed between two runs is seen.
    text = re.sub(r',(?="[a-zA-Z_][^"]*":)', ",\n", text)
    (data / f"fig{number}.json").write_text(text + "\n", encoding="utf-8")
    return path


def _encoded(made: Figure, number: str) -> tuple[str, bytes]:
    """Return the ending and the bytes of the first kind of picture that is small enough."""
    content = _drawn(made, "svg", 100)
    content = _PLACES.sub(lambda match: _FRACTION.sub(r"\1", match[0]), content.decode()).encode()
    if len(content) < MOST_BYTES:
        return ".svg", content
    for dpi in _DPI:
        content = _drawn(made, "png", dpi)
        for picture in (content, _few_colours(content)):
            if len(picture) < MOST_BYTES:
                return ".png", picture
    raise ValueError(f"figure {number}: {len(content)} bytes, a picture of the gallery has less than {MOST_BYTES}")


def _drawn(made: Figure, kind: str, dpi: int) -> bytes:
    buffer = io.BytesIO()
    made.set(dpi=dpi, facecolor="white")
    # Figure.savefig would draw everything twice, the first time for the layout, which drawing makes anyway.
    if kind == "svg":
        FigureCanvasSVG(made).print_svg(buffer, metadata={"Date": None})
    else:
        FigureCanvasAgg(made).print_png(buffer)
    return buffer.getvalue()


def _few_colours(picture: bytes) -> bytes:
    """Return a PNG with a palette of its own, which is smaller and looks the same."""
    reduced = io.BytesIO()
    with Image.open(io.BytesIO(picture)) as image:
        palette = image.convert("RGB").quantize(256, kmeans=2, dither=Image.Dither.NONE)
        palette.save(reduced, "PNG", optimize=True)
    return reduced.getvalue()


def plain(value: Any) -> Any:
    """Return a value as JSON can hold it: four figures a number, null where there is none."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return float(f"{value:.4g}") if math.isfinite(value) else None
    return value


def letter(axes: Axes, place: int, text: str) -> None:
    """Title a panel as print does: (a), (b) and so on."""
    axes.set_title(f"({chr(ord('a') + place)}) {text}", loc="left", fontsize=9.5)
