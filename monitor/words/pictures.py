"""The kinds of pictures of a channel: sections of a report, and answers of the page; one row each."""

from __future__ import annotations

from typing import NamedTuple


class PictureKind(NamedTuple):
    """A kind of picture in a report.

    Attributes:
        section: by which ``[report]`` includes it or leaves it out.
        drawn: ``module:function`` below ``monitor.report.figures``; the function takes a
            :class:`monitor.report.verdict.ChannelContext` and returns a picture, a list of them, or None.
    """

    section: str
    drawn: str


PICTURES = (
    PictureKind("trends", "trends:trends"),
    PictureKind("final_stage", "trends:final_stage"),
    PictureKind("envelope", "spectrum:envelope"),
    PictureKind("raw", "raw_block:raw_block"),
    PictureKind("raw", "ias:ias_picture"),
    PictureKind("cyclic", "cyclic:block_coherence"),
    PictureKind("waterfall", "waterfall:waterfall"),
    PictureKind("kurtogram", "kurtogram:kurtograms"),
    PictureKind("damage", "damage:damaged_volume"),
    PictureKind("path", "map_path:map_path"),
    PictureKind("posterior", "map_path:posterior"),
    PictureKind("law", "damage:fitted_law"),
    PictureKind("forecast", "damage:forecasts"),
)
"""In the order of the report."""
VIEWS = {
    "records": "api:records",
    "spectrum": "spectra_view:spectrum",
    "raw": "spectra_view:raw_spectrum",
    "ias": "spectra_view:ias",
    "cyclic": "spectra_view:cyclic",
    "waveform": "spectra_view:waveform",
    "waterfall": "spectra_view:waterfall",
    "kurtogram": "spectra_view:kurtogram",
    "map": "map_view:map_of",
}
"""Last part of the address of each answer of a channel, and ``module:function`` below ``monitor.web`` that gives it."""
