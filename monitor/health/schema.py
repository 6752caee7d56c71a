"""The one table of what a health record holds: symbol, unit, long name, source equation of every variable.

Docstrings, netCDF attributes, the report and docs/records.md come from here. The integers that stand for words in
netCDF files follow from the order of the words: append to a tuple of words, never reorder it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from monitor.health.condition import SOURCES as CONDITION_SOURCES
from monitor.health.detect import STAGES
from monitor.health.quality import FLAGS, REJECTIONS

SCHEMA_VERSION = 1
"""Version of the record schema and of the store; a higher one is refused."""

FAULTS = ("outer", "inner", "ball", "cage")
BAND_SOURCES = ("configured", "learning", "recording", "provisional")
STATUSES = ("ok", *FLAGS, *REJECTIONS)
EDV_STATUSES = (
    "ok",
    "widened",
    "below_map",
    "above_map",
    "no_map",
    "no_library",
    "not_final_stage",
    "bad_block",
    "ambiguous",
    "outside_conditions",
    "outside_library",
    "no_absolute_level",
)
TT_STATUSES = (
    "ok",
    "not_final_stage",
    "too_few_points",
    "no_crossing",
    "concave",
    "crossing_in_past",
    "already_crossed",
    "beyond_horizon",
    "no_library",
    "outside_library",
    "cannot_tell",
)

DIMENSION_SIZES = {"fault": len(FAULTS), "harmonic": 5, "bpfo_harmonic": 6, "coefficient": 3}
"""Sizes of the dimensions that are the same everywhere; ``band`` and ``threshold`` have as many as are configured."""
OPTIONAL_DIMENSIONS = frozenset({"band", "threshold"})
"""Dimensions that a value may leave out where there is only one band or threshold."""

Kind = Literal["float", "int", "flag", "mask"]

ACCELERATION = "m s-2"
_THESIS = "Gabrielli, doctoral thesis, University of Ferrara, 2022"
_CERUTI = "Ceruti, Master's thesis, Politecnico di Torino, 2021"
_SEARCH = "monitor/health/spectrum/harmonics.py"
_SASSI = "Sassi et al., J. Vibration and Control 13, 2007"


@dataclass(frozen=True)
class Variable:
    """One quantity of a health record, given for every block and channel.

    Attributes:
        name: its name in records and files, lower case.
        dims: dimensions beyond (time, channel), of "band", "fault", "harmonic", "bpfo_harmonic", "threshold",
            "coefficient".
        units: UDUNITS string of the SI unit, "1" for a pure number, "time" for a moment on the record's time axis,
            None where a unit has no meaning.
        long_name: what it is, in words.
        symbol: the symbol of the source, in ASCII.
        source: where it is defined.
        kind: "float", "int", "flag" (one word of ``values``) or "mask" (any number of words of ``values``).
        values: the words allowed, in the order of their integers.
        optional: whether files leave it out where no record has it; all others are always there.
    """

    name: str
    dims: tuple[str, ...] = ()
    units: str | None = "1"
    long_name: str = ""
    symbol: str = ""
    source: str = ""
    kind: Kind = "float"
    values: tuple[str, ...] = ()
    optional: bool = False


def _floats(units: str | None, rows: str, dims: tuple[str, ...] = (), *, optional: bool = False) -> list[Variable]:
    """Make variables of one unit and shape from lines ``name | symbol | long name | source``."""
    cells = ([cell.strip() for cell in row.split("|")] for row in rows.strip().splitlines())
    return [
        Variable(
            name=name, dims=dims, units=units, long_name=long_name, symbol=symbol, source=source, optional=optional
        )
        for name, symbol, long_name, source in cells
    ]


_LINES = ("band", "fault", "harmonic")
_TABLE: list[Variable] = [
    *_floats(
        ACCELERATION,
        f"""
        rms | RMS | root mean square of the acceleration in the RMS band, mean removed | {_CERUTI}, section 4.2
        a_star | A* | root sum of squares of the first five BPFO lines of the raw spectrum | {_THESIS}, Eq. 57
        peak | peak | largest absolute acceleration | {_SASSI}, Eq. 36
        peak_half_range | peak value | half the range of the acceleration | {_CERUTI}, section 4.2
        mean | mean | mean acceleration | {_CERUTI}, section 4.2
        rms_smoothed | X_exp | trailing mean of RMS that enters the map | {_THESIS}, section 5.4.1
        """,
    ),
    *_floats(
        "1",
        f"""
        kurtosis | KV | kurtosis, 3 for Gaussian noise | {_CERUTI}, section 4.2
        crest_factor | Crf | peak over RMS | {_SASSI}, Eq. 36
        skewness | SK | skewness | {_CERUTI}, section 4.2
        shape_factor | Shf | RMS over mean absolute value | {_SASSI}, Eq. 36
        impulse_factor | Imf | peak over mean absolute value | {_SASSI}, Eq. 36
        clearance_factor | Clf | peak over squared mean of the root of the absolute value | {_CERUTI}, section 4.2
        speed_factor | s | line frequency found over the nominal one | search within 2 % around the kinematic frequency
        detect_score | score | how far RMS and H_or stand above the learned baseline | monitor/health/detect.py
        detect_threshold | threshold | score above which a block counts as abnormal | monitor/health/detect.py
        fault_snr | snr | fault lines over the noise floor under them | monitor/health/naming.py
        fault_depth | depth | root sum of squares of the fault lines over the mean envelope | monitor/health/naming.py
        fault_score | score | evidence of the best family of fault lines | monitor/health/naming.py
        """,
    ),
    *_floats(
        ACCELERATION,
        f"""
        h_or | H_or | sum of the first five outer race lines of the envelope spectrum | {_THESIS}, Eq. 96
        h_ir | H_ir | sum of the first five inner race lines of the envelope spectrum | after {_THESIS}, Eq. 96
        h_ball | H_ball | sum of the first five rolling element lines of the envelope spectrum | after {_THESIS}, Eq. 96
        h_cage | H_cage | sum of the first five cage lines of the envelope spectrum | after {_THESIS}, Eq. 96
        """,
        ("band",),
    ),
    *_floats(
        ACCELERATION,
        f"""
        envelope_amplitude | A_e,k | amplitude of a line of the envelope spectrum | {_THESIS}, Eqs. 94-96
        envelope_floor | floor | noise floor of the envelope spectrum under the line | {_SEARCH}
        """,
        _LINES,
    ),
    *_floats(
        "1",
        f"envelope_snr | snr | line over the noise floor under it | {_SEARCH}",
        dims=_LINES,
    ),
    *_floats(
        ACCELERATION,
        f"bpfo_amplitude | A_BPFO,k | amplitude of a BPFO line of the raw spectrum | {_THESIS}, section 4.2.3",
        ("bpfo_harmonic",),
    ),
    *_floats(
        "Hz",
        """
        band_lo | | lower edge of the demodulation band |
        band_hi | | upper edge of the demodulation band |
        """,
        ("band",),
    ),
    Variable("band_source", (), None, "how the demodulation band was chosen", kind="flag", values=BAND_SOURCES),
    Variable("absolute_level", (), None, "whether accelerations are in m s-2", kind="flag", values=("no", "yes")),
    Variable("quality_status", (), None, "verdict on the channel's samples", kind="flag", values=STATUSES),
    Variable("quality_flags", (), None, "all flags of the channel's samples", kind="mask", values=FLAGS),
    Variable("stage", (), None, "stage of life", "", f"{_THESIS}, section 5.2.2", "flag", STAGES),
    *_floats(
        "time",
        f"""
        t_fs | t_fs | moment at which the final stage began | {_THESIS}, section 5.2.2
        t_fs_known | | moment at which the start of the final stage was known | monitor/health/detect.py
        t_eol | t_EOL | moment of the end of life | {_THESIS}, section 5.4
        """,
    ),
    Variable("t_fs_block", (), "1", "number of the block in which the final stage began", kind="int"),
    Variable("t_fs_known_block", (), "1", "number of the block in which the final stage was known", kind="int"),
    Variable("t_eol_block", (), "1", "number of the block that ended the life", kind="int"),
    Variable("fault", (), None, "damaged part; several where they cannot be told apart", kind="mask", values=FAULTS),
    *_floats("rad", f"dphi_d | dphi_d | angular extent of the equivalent defect | {_THESIS}, section 5.2.2"),
    *_floats("m", f"h_d | h_d | depth of the equivalent defect | {_THESIS}, section 5.2.2"),
    *_floats(
        "m2",
        f"""
        v_eq | V_eq | equivalent damaged volume per unit of width | {_THESIS}, Eqs. 90-91
        v_eq_lower | V_eq | lower end of the interval of v_eq | {_THESIS}, Eqs. 90-91
        v_eq_upper | V_eq | upper end of the interval of v_eq | {_THESIS}, Eqs. 90-91
        """,
    ),
    Variable("edv_status", (), None, "status of v_eq", kind="flag", values=EDV_STATUSES),
    *_floats("m2", f"v_th | V_th | threshold of v_eq | {_THESIS}, Eq. 92", ("threshold",)),
    *_floats(
        "s",
        f"""
        tt | TT | time to threshold, as issued at this block | {_THESIS}, Eq. 92
        tt_lower | TT | lower end of the interval of tt | {_THESIS}, Eq. 92
        tt_upper | TT | upper end of the interval of tt | {_THESIS}, Eq. 92
        """,
        ("threshold",),
    ),
    Variable("tt_status", ("threshold",), None, "status of tt", kind="flag", values=TT_STATUSES),
    *_floats(
        None,
        "tt_coefficients | a, b, c | V_eq = a t^2 + b t + c in SI units, t from the first point of the fit "
        f"| {_THESIS}, section 5.2.3.2",
        ("threshold", "coefficient"),
    ),
    *_floats("1", f"r_squared | R^2 | goodness of the fit of v_eq over time | {_THESIS}, Table 22", ("threshold",)),
    *_floats(
        "1", "p_threshold | | probability that the threshold is reached within the maintenance window |", ("threshold",)
    ),
    *_floats("m2", f"v_eq_true | V_eq | true damaged volume (simulated rigs only) | {_THESIS}, Eq. 90", optional=True),
    *_floats(
        "s",
        f"tt_true | TT | true time to threshold (simulated rigs only) | {_THESIS}, Eq. 92",
        ("threshold",),
        optional=True,
    ),
    *_floats("Hz", "speed | f_s | rotation frequency of the shaft |"),
    *_floats("N", "load | P | radial load |"),
    *_floats(
        "Hz", "speed_sd | | standard deviation of the error of speed | monitor/health/condition.py", optional=True
    ),
    *_floats("N", "load_sd | | standard deviation of load over the block | monitor/health/condition.py", optional=True),
    Variable("speed_source", (), None, "where speed comes from", kind="flag", values=CONDITION_SOURCES, optional=True),
    Variable("load_source", (), None, "where load comes from", kind="flag", values=CONDITION_SOURCES, optional=True),
]

VARIABLES: dict[str, Variable] = {variable.name: variable for variable in _TABLE}
"""Every variable of a channel, by name."""
