"""The gallery: a counterpart of every figure of the thesis' chapters 4 and 5 that the simulation can make.

python -m benchmarks.gallery [--source ceruti] [--out build/gallery] [--only 45 ...] [--data FOLDER] [--page FILE]

``--source`` names one of the sources of the other models (``benchmarks.gallery_models``) instead of the thesis. For
each figure, write a picture (SVG, or PNG where that would be large) into the folder ``--out``, which git ignores, and a
JSON file with what is drawn and with what the print says of it into ``--data``; then write the page from all JSON
files. Everything is computed from the model; two runs of one version on one kind of machine give the same files. The
pictures in KEPT are copied beside the page, which shows them.
"""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Callable
from pathlib import Path

from benchmarks import gallery_histories, gallery_rig, gallery_seeded, gallery_volumes
from benchmarks.gallery_models import PAGE as MODELS_PAGE
from benchmarks.gallery_models import SOURCES
from benchmarks.gallery_models import page as models_page
from benchmarks.gallery_page import Entry, Source, counted, make, section, table
from benchmarks.gallery_plate import Plate

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "build" / "gallery"
DATA = ROOT / "benchmarks" / "results" / "gallery"
PAGE = ROOT / "docs" / "evidence" / "gallery.md"
KEPT = {"49": "fig49.png", "55": "fig55.png", "61": "fig61.png"}
"""Pictures that the page shows; they stand in the folder ``gallery`` beside it."""
FIGURES: dict[str, Callable[[], Plate]] = {
    **gallery_rig.FIGURES,
    **gallery_seeded.FIGURES,
    **gallery_histories.FIGURES,
    **gallery_volumes.FIGURES,
}
"""What makes each figure, by its number in the thesis."""


_SCHEME = "a drawing of the method, no result"
_MEASURED = "measured on the test rig; the signals are not at hand and no value is printed"
_SEARCH = "results of the optimisation against the measured signals, which are not at hand"
ENTRIES = (
    Entry("29", "Scheme of the lumped-parameter model", _SCHEME),
    Entry("30", "Geometry of the defect and displacement of a ball over it", _SCHEME, ("53",)),
    Entry("31", "Measured waveforms of D1 to D3 at two loads", _MEASURED, ("47",)),
    Entry("32", "Measured spectrum of D2 at 2000 N and 30 Hz", _MEASURED, ("48", "49")),
    Entry("33", "Measured RMS and A* against speed", _MEASURED, ("45",)),
    Entry("34", "Measured RMS and A* against the width", _MEASURED, ("46",)),
    Entry("35", "Finite-element model of the shaft", "a mesh; its result k_i = 75 MN/m is taken as a datum"),
    Entry("36", "Stiffness of the healthy bearing while the balls pass"),
    Entry("37", "Stiffness of the bearing with D3 while the balls pass"),
    Entry("38", "Natural frequency of the resonator over its mass and stiffness"),
    Entry("39", "First four natural frequencies over mass and stiffness of the resonator"),
    Entry("40", "Admitted damping of the contacts"),
    Entry("41", "Pareto front of the optimisation", _SEARCH),
    Entry("42", "Parameters along the Pareto front", _SEARCH),
    Entry("43", "Natural frequencies of the parameters found"),
    Entry("44", "Pareto fronts of one defect at a time", _SEARCH),
    Entry("45", "RMS and A* against speed, simulated and measured"),
    Entry("46", "RMS and A* against the width, simulated and measured"),
    Entry("47", "Simulated waveforms of D1 to D3 at two loads"),
    Entry("48", "Simulated spectrum of D2 at 2000 N and 30 Hz"),
    Entry("49", "Spectra with slip"),
    Entry("50", "Waveforms with slip"),
    Entry("51", "RMS and A* against speed with slip"),
    Entry("52", "Angles at which a ball meets the floor", _SCHEME, ("53",)),
    Entry("53", "Ways of a ball over a localised and an extended defect"),
    Entry("54", "Final stage of a life", "a sketch of an RMS history", ("57", "60")),
    Entry("55", "Steps of the tracker"),
    Entry(
        "56",
        "Flowchart of the tracker",
        "a flowchart; in words: [tracking](tracking.md)",
    ),
    Entry("57", "RMS over six whole lives"),
    Entry("58", "H_or over six whole lives"),
    Entry("59", "Envelope spectra before and in the final stage"),
    Entry("60", "RMS in six final stages"),
    Entry("61", "RMS maps at four loads"),
    Entry("62", "Tracked volumes"),
    Entry("63", "Histories under other loads (first prognostic model)"),
    Entry("64", "Volumes below the threshold"),
    Entry("65", "Fitted quadratics"),
    Entry("66", "Forecasts of the time to the threshold"),
    Entry("67", "Forecasts to other thresholds"),
)
"""All figures of chapters 4 and 5."""

SOURCE = Source("fig", ENTRIES, FIGURES, KEPT, "gallery", "simulated lives")

_HEAD = """# Gallery: the figures of the thesis' chapters 4 and 5

For every figure of the two chapters of A. Gabrielli's doctoral thesis (University of Ferrara, 2022) on the model and
on the methods: what this program computes from its own simulation, whether it agrees with the print, and why some
figures have no counterpart.

`python -m benchmarks.gallery` draws all pictures into `build/gallery` (one or two minutes), writes the data under them
to `benchmarks/results/gallery/fig*.json`, and renews this page; `--only 45 61` draws some. Three of the pictures are
shown here.

Verdicts: a number *agrees* within half a unit of the last printed digit (or within the bound that the text gives) and
is *close* within 3 %. A statement in words agrees where it holds in every case and holds *in part* where it holds in
some; the count is given. Bounds for statements in words are ours. Printed numbers are compared in
[published figures](published-figures.md). The sources of the other models have [their own page](gallery-models.md).

Figures of chapter 5 rest on six run-to-failure tests whose signals are not available. Their counterparts are six
**simulated lives** on another machine: each has the load, speed, onset and end of a test (Tables 3 and 20), and its
true volume follows the quadratic of Table 22 up to 0.05 mm³/mm. Chosen here: from there the volume grows faster, to
0.5 mm³/mm at the end; extent and depth grow in proportion (50° to 32 µm); the rough floor differs from those of the
maps; the sensor adds white noise of 0.5 m/s². These values are *not comparable* with printed ones.

"""


def page(data: Path) -> str:
    """Return the page from the JSON files of all figures that have a counterpart.

    Raises:
        OSError: a file is missing.
    """
    stored = SOURCE.stored(data)
    lives = sum(bool(figure["machine"]) for figure in stored.values())
    text = f"{len(stored)} of {len(ENTRIES)} figures have a counterpart, {lives} of them from simulated lives."
    lines = [f"{_HEAD}**{text} {counted(stored)}**", *table(SOURCE, stored)]
    for chapter, title in (
        ("4", "Chapter 4: the model and its parameters"),
        ("5", "Chapter 5: tracking and forecasts"),
    ):
        lines += ["", f"## {title}"]
        for entry in ENTRIES:
            if entry.number in stored and (int(entry.number) >= 52) == (chapter == "5"):
                lines += section(SOURCE, entry, stored[entry.number])
    return "\n".join(lines) + "\n"


def _keep(source: Source, pictures: Path, folder: Path) -> None:
    """Copy the pictures that the page shows into a folder."""
    folder.mkdir(exist_ok=True)
    for number, name in source.kept.items():
        if (made := pictures / f"fig{number}{Path(name).suffix}").exists():
            shutil.copyfile(made, folder / name)


def main() -> None:
    """Make figures and the page."""
    parser = argparse.ArgumentParser(description="The gallery of the figures of the sources.")
    parser.add_argument("--source", choices=["thesis", *SOURCES], default="thesis", help="whose figures")
    parser.add_argument("--out", type=Path, default=PICTURES, metavar="FOLDER", help="for pictures")
    parser.add_argument("--data", type=Path, default=DATA, metavar="FOLDER", help="for JSON files")
    parser.add_argument("--only", nargs="+", default=[], metavar="NUMBER", help="make these figures only")
    parser.add_argument("--page", type=Path, metavar="FILE", help="the page")
    options = parser.parse_args()
    thesis = options.source == "thesis"
    source = SOURCE if thesis else SOURCES[options.source]
    out, data = (folder if thesis else folder / source.anchor for folder in (options.out, options.data))
    kept_page = PAGE if thesis else MODELS_PAGE
    target = options.page or kept_page
    try:
        make(source, out, data, options.only)
        if target == kept_page:
            _keep(source, out, target.parent / source.folder)
        target.write_text(page(options.data) if thesis else models_page(options.data), encoding="utf-8")
    except ValueError as error:
        parser.error(str(error))
    except FileNotFoundError as error:
        parser.error(f"{error.filename} is missing: the page needs every figure, make all of them first")
    print(target)


if __name__ == "__main__":
    main()
