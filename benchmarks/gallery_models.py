"""The gallery of the other models: a counterpart of every figure of their sources that the simulation can make.

``python -m benchmarks.gallery --source ceruti`` (marin, beat, thibault) makes the figures of one source; the page is
written from the stored data of all.
"""

from __future__ import annotations

import textwrap
from pathlib import Path

from benchmarks import gallery_beat, gallery_ceruti, gallery_marin, gallery_thibault
from benchmarks.gallery_page import Entry, Source, counted, section, table

PAGE = Path(__file__).resolve().parents[1] / "docs" / "evidence" / "gallery-models.md"
_FOLDER = "gallery-models"
_SCHEME = "a drawing of the method, no result"
_MEASURED = "measured on the source's test rig; the signals are not at hand and no value is printed"

_CERUTI = (
    Entry("2.1-2.6", "Parts, contacts and geometry of a bearing", _SCHEME),
    Entry("2.7", "Load over displacement, discrete and continuous"),
    Entry("2.8", "Linearized stiffness over displacement"),
    Entry("2.9-2.15", "Frames, displacements and shapes of the defects", _SCHEME),
    Entry("3.1-3.5", "Rotor, frames, whirl and internal damping", _SCHEME),
    Entry("4.1", "Faults of the shaft (section 4.1; Fig. 4.1 is the scheme of the envelope)"),
    Entry("4.2", "Envelope analysis", _SCHEME, ("6.3",)),
    Entry("5.1-5.9", "Rotor on two bearings, flowcharts of the program", _SCHEME),
    Entry("6.1", "Acceleration of C, healthy"),
    Entry("6.2", "Spectrum of C"),
    Entry("6.3", "Band-passed acceleration of C and its envelope"),
    Entry("6.4", "Spectrum of the envelope of C"),
    Entry("6.5", "First angle of the balls", _SCHEME),
    Entry("6.6", "C in four coordinates, balls 12.85° apart"),
    Entry("6.7", "C in four coordinates, balls 25.7° apart"),
    Entry("6.8", "Envelope of C, balls 12.85° apart"),
    Entry("6.9", "Envelope of C, balls 25.7° apart"),
    Entry("6.10", "Accelerations on an elastic shaft"),
    Entry("6.11", "Orbits of A, B and C on an elastic shaft"),
    Entry("6.12", "Envelopes of B and C on an elastic shaft"),
    Entry("6.13", "Outer race, rigid shaft of 0.2 m: signals"),
    Entry("6.14", "Outer race, rigid shaft of 0.8 m: signals"),
    Entry("6.15", "Outer race, rigid shaft of 0.8 m: envelopes"),
    Entry("6.16", "Outer race, elastic shaft of 0.2 m: signals"),
    Entry("6.17", "Outer race, elastic shaft of 0.1 m: signals"),
    Entry("6.18", "Outer race, elastic shaft of 0.1 m: envelopes"),
    Entry("6.19", "Inner race, rigid shaft: signals"),
    Entry("6.20", "Inner race, rigid shaft: envelopes"),
    Entry("6.21", "Inner race, elastic shaft: signals"),
    Entry("6.22", "Inner race, elastic shaft: envelopes"),
    Entry("6.23", "Ball, rigid shaft: signals"),
    Entry("6.24", "Ball, rigid shaft: envelopes"),
    Entry("6.25", "Ball, elastic shaft: signals"),
    Entry("6.26", "Ball, elastic shaft: envelopes"),
    Entry("6.27", "C with three eccentricities, rigid shaft"),
    Entry("6.28", "Orbits of C with three eccentricities, rigid shaft"),
    Entry("6.29", "Envelopes of C with two eccentricities, rigid shaft"),
    Entry("6.30", "C with three eccentricities, elastic shaft"),
    Entry("6.31", "Orbits of C with three eccentricities, elastic shaft"),
    Entry("6.32", "Envelopes of C with three eccentricities, elastic shaft"),
    Entry("L", "Peak value and RMS over the length of the shaft (text of section 6.2)"),
)

_MARIN = (
    Entry("1-5", "Bearing, coordinates and defect", _SCHEME),
    Entry("6", "Signals with three balls at five speeds"),
    Entry("7", "Envelopes with three balls at five speeds"),
    Entry("8", "Signals with nine balls at five speeds"),
    Entry("9", "Envelopes with nine balls at five speeds"),
    Entry("10-11", "Test rig and bearings", "photographs"),
    Entry("12-13", "Signals and envelopes of a test", _MEASURED, ("6", "7")),
    Entry("14", "Signal with three balls at 20 Hz; (a) measured, (b) simulated"),
    Entry("15", "Envelope with three balls at 20 Hz; (a) measured, (b) simulated"),
    Entry("16", "Power over the speed"),
)
_BEAT = (
    Entry("1-4", "Load, defect and shock of a ball", _SCHEME),
    Entry("5", "Pulses of a defect of each part"),
    Entry("6-7", "Masses and springs, direction of the sensor", _SCHEME),
    Entry("8", "Responses without and with noise"),
    Entry("9", "Response of the outer race, measured and simulated"),
    Entry("10", "Spectrum of the outer race"),
    Entry("11", "Envelope of the outer race, measured and simulated"),
    Entry("12", "Envelope of the inner race, measured and simulated"),
)
_THIBAULT = (
    Entry("1-4", "Geometry, rolling resistance and spall", _SCHEME),
    Entry("5", "Pressure of a contact over a spall"),
    Entry("6", "Flowchart", _SCHEME),
    Entry("7", "Forces and contact angles of each ball"),
    Entry("8", "Shaft on two bearings", _SCHEME),
    Entry("9", "Spectra of acceleration and angular speed"),
    Entry("10", "Angular speed, reference run"),
    Entry("11", "Angular speed, 6000 and 20,000 rpm"),
    Entry("12", "Force of balls on the inner race, two speeds"),
    Entry("13", "Angular speed, 200 and 1000 N axially"),
    Entry("14", "Angular speed, spall of the radially loaded bearing"),
    Entry("15", "Angular speed, the spall at two speeds"),
    Entry("16", "Force of a ball over a spall, two speeds"),
    Entry("17", "Angular speed, spall of the axially loaded bearing"),
)
SOURCES: dict[str, Source] = {
    "ceruti": Source(
        "ceruti",
        _CERUTI,
        gallery_ceruti.FIGURES,
        {"4.1": "ceruti-4.1.png", "6.15": "ceruti-6.15.svg", "6.28": "ceruti-6.28.png", "6.31": "ceruti-6.31.png"},
        _FOLDER,
        "with masses at the ends",
    ),
    "marin": Source("marin", _MARIN, gallery_marin.FIGURES, {"16": "marin-16.svg"}, _FOLDER),
    "beat": Source("beat", _BEAT, gallery_beat.FIGURES, {"12": "beat-12.svg"}, _FOLDER, "with chosen films"),
    "thibault": Source(
        "thibault",
        _THIBAULT,
        gallery_thibault.FIGURES,
        {"7": "thibault-7.svg", "11": "thibault-11.svg", "16": "thibault-16.svg"},
        _FOLDER,
        "with chosen parameters",
    ),
}
"""The sources by the names that ``--source`` takes."""
_TITLES = {
    "ceruti": "Ceruti: a rotor on two bearings (`rotor`)",
    "marin": "Marin, Rubio, Garcia-Prada and Reinoso: balls with inertia (`ball_inertia`)",
    "beat": "Sassi, Badri and Thomas: impacts on rings (`ring_impact`)",
    "thibault": "Thibault, Bourdon, Remond and Lecouvreur: a shaft and its angular speed (`angular`)",
}
_NOTES = {
    "ceruti": (
        "Master thesis, Politecnico di Torino, 2021. Peak values (half the range) come from the source's procedure: "
        "steps of 0.1°, from the middle of the clearance, without the first turn of the cage. The ends of its elastic "
        "shaft have no mass and so no acceleration ([models](models.md)): where A and B are shown on one, an end has "
        "0.2 kg."
    ),
    "marin": (
        "Journal of Testing and Evaluation 42(1), 2014. Depth and length of the defect are not printed: 20 µm and 1 mm "
        "here. With three balls the motion is chaotic, so that its course cannot be compared point by point."
    ),
    "beat": (
        "Journal of Vibration and Control 13(11), 2007. Films, sections of the rings and level of the noise are not "
        "printed. Fig. 12 beside a recording of the same test rig is a test, `tests/published/test_sassi.py`."
    ),
    "thibault": (
        "Tribology International, 2022. Groove radii, clearance, inertias, torque and damping are not printed: grooves "
        "of 0.51 D and 35 µm here, the others as in `models/solve/angular/rig.py`. Levels are therefore not compared."
    ),
}
_HEAD = """# Gallery: the figures of the other models' sources

For every figure of the four sources of the [other models](models.md): what this program computes, whether it agrees
with the print, and why some figures have no counterpart. The figures of the thesis are in [gallery](gallery.md).

`python -m benchmarks.gallery --source ceruti` (`marin`, `beat`, `thibault`; half a minute to three) draws the
pictures of a source into `build/gallery`, writes the data under them to `benchmarks/results/gallery`, and renews this
page; `--only 6.28 6.31` draws some. Some of the pictures are shown here.

Verdicts: a number *agrees* within half a unit of the last printed digit (a line of a spectrum: within the printed
resolution; otherwise within the bound that the text gives) and is *close* within 3 %. A statement in words agrees where
it holds in every case and holds *in part* where it holds in some; the count is given. Bounds for statements in words
are ours. A line *stands out* where it is five times (Marín: three times) the median below the end of the picture.
[Published figures](published-figures.md#acceptance-table-of-the-other-models) has the printed numbers by status.
"""


def page(data: Path) -> str:
    """Return the page from the JSON files of all sources, each in a folder of its own.

    Raises:
        OSError: a file is missing.
    """
    stored = {name: source.stored(data / name) for name, source in SOURCES.items()}
    lines = [_HEAD]
    for name, source in SOURCES.items():
        found = stored[name]
        lines += [
            f"## {_TITLES[name]}",
            "",
            textwrap.fill(_NOTES[name], 120),
            "",
            f"**{counted(found)}**",
            *table(source, found),
        ]
        for entry in source.entries:
            if entry.number in found:
                lines += section(source, entry, found[entry.number])
        lines.append("")
    return "\n".join(lines)
