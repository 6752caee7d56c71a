"""The variables of a health record: those of the table of features, lines of spectra, marks and statuses.

netCDF attributes, the report and docs/reference/records.md come from here. The integers that stand for words in netCDF
files follow from the order of the words: append to a tuple of words, never reorder it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from monitor.health.gears.naming import KINDS as GEAR_KINDS
from monitor.health.gears.naming import STATUSES as GEAR_STATUSES
from monitor.health.gears.values import UNNAMED
from monitor.health.onset import STAGES
from monitor.health.rest.trend import LEVEL_SOURCES, TtaStatus
from monitor.health.signal.condition import SOURCES as CONDITION_SOURCES
from monitor.health.signal.quality import FLAGS, REJECTIONS
from monitor.health.signal.velocity import VELOCITY_STATUSES
from monitor.health.size import EdvStatus, TtStatus
from monitor.words.features import ACCELERATION, FEATURES, GABRIELLI, ROTATION
from monitor.words.parts import FAULTS
from monitor.words.statuses import UNDECIDED
from monitor.words.zones import ZONES

SCHEMA_VERSION = 1
"""Version of the record schema and of the store; a higher one is refused."""

HINT, VERDICT = "hint", "verdict"
"""What a name is: a hint without a baseline or before t_fs, a verdict since it."""
NAMES = (*FAULTS, UNDECIDED)
DOMAINS = ("hertz", "order")
"""What the spectra of a block are over: time, or the angle of the shaft at its mean speed (decision 0021)."""
ROTATION_STATUSES = ("ok", "none", "too_few", "irregular", "reversed", "stopped", "cannot_tell", "too_wide")
"""Whether the angle of the shaft over a block is known, or why not."""
LEVEL_STATUSES = ("ok", "outside_conditions")
"""Whether the learned dependence of the level on speed and load applies, or why not."""
BAND_SOURCES = ("configured", "learning", "recording", "provisional")
STATUSES = ("ok", *FLAGS[:7], *REJECTIONS, *FLAGS[7:])
"""The first seven flags stand before the rejections; what came later is appended."""
EDV_STATUSES = tuple(map(str, EdvStatus))
TT_STATUSES = tuple(map(str, TtStatus))
TTA_STATUSES = tuple(map(str, TtaStatus))

DIMENSION_SIZES = {"fault": len(FAULTS), "harmonic": 5, "bpfo_harmonic": 6, "coefficient": 3}
"""Sizes of the dimensions that are the same everywhere; ``band``, ``threshold`` and ``gear``
have as many as are configured."""
OPTIONAL_DIMENSIONS = frozenset({"band", "threshold", "gear"})
"""Dimensions that a value may leave out where there is only one band, threshold or wheel."""

Kind = Literal["float", "int", "flag", "mask"]

_SEARCH = "monitor/health/signal/lines.py"
GEARS = "monitor/health/gears"


@dataclass(frozen=True)
class Variable:
    """One quantity of a health record, given for every block and channel.

    Attributes:
        dims: dimensions beyond (time, channel).
        units: UDUNITS string of the SI unit, "1" for a pure number, "time" for a moment on the record's time axis,
            None where a unit has no meaning.
        symbol: that of the source, in ASCII.
        source: where it is defined.
        comment: where it departs from its source.
        kind: "float", "int", "flag" (one word of ``values``) or "mask" (any number of words of ``values``).
        values: allowed words, in the order of their integers.
        optional: whether files leave it out where no record has it.
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
    comment: str = ""


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
    *(
        Variable(
            name=feature.name,
            dims=feature.dims,
            units=feature.units,
            long_name=feature.long_name,
            symbol=feature.symbol,
            source=feature.source,
            comment=feature.departure,
            optional=feature.optional,
        )
        for feature in FEATURES.values()
    ),
    *_floats(
        ACCELERATION,
        f"""
        envelope_amplitude | A_e,k | amplitude of a line of the envelope spectrum | {GABRIELLI}, Eqs. 94-96
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
        f"bpfo_amplitude | A_BPFO,k | amplitude of a BPFO line of the raw spectrum | {GABRIELLI}, section 4.2.3",
        ("bpfo_harmonic",),
    ),
    *_floats(ACCELERATION, "envelope_mean | | mean of the envelope |", ("band",), optional=True),
    *_floats(ACCELERATION, "rms_baseline | | learned RMS, in the final stage | monitor/health/onset", optional=True),
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
    Variable("stage", (), None, "stage of life", "", f"{GABRIELLI}, section 5.2.2", "flag", STAGES),
    *_floats(
        "time",
        f"""
        t_fs | t_fs | moment at which the final stage began | {GABRIELLI}, section 5.2.2
        t_fs_known | | moment at which the start of the final stage was known | monitor/health/onset
        t_eol | t_EOL | moment of the end of life | {GABRIELLI}, section 5.4
        """,
    ),
    Variable("t_fs_block", (), "1", "number of the block in which the final stage began", kind="int"),
    Variable("t_fs_known_block", (), "1", "number of the block in which the final stage was known", kind="int"),
    Variable("t_eol_block", (), "1", "number of the block that ended the life", kind="int"),
    Variable("fault", (), None, "damaged part; several where they cannot be told apart", kind="mask", values=NAMES),
    Variable(
        "fault_basis",
        (),
        None,
        "what the name of the damaged part is: a hint before t_fs, a verdict since",
        kind="flag",
        values=(HINT, VERDICT),
        optional=True,
    ),
    Variable(
        "fault_candidates",
        (),
        None,
        "parts between which the stated speed cannot decide",
        kind="mask",
        values=FAULTS,
        optional=True,
    ),
    Variable(
        "speed_unverified",
        (),
        None,
        "whether fault rests on a nominal speed that the signal does not show",
        kind="flag",
        values=("no", "yes"),
        optional=True,
    ),
    *_floats(
        "1",
        "speed_factor_sd | | standard deviation of speed_factor where the shaft shows it "
        "| monitor/health/signal/shaft.py",
        optional=True,
    ),
    Variable(
        "raised",
        (),
        None,
        "parts whose lines stand above their baseline",
        kind="mask",
        values=FAULTS,
        optional=True,
    ),
    Variable("edv_status", (), None, "status of v_eq", kind="flag", values=EDV_STATUSES),
    *_floats("m2", f"v_th | V_th | threshold of v_eq | {GABRIELLI}, Eq. 92", ("threshold",)),
    Variable("tt_status", ("threshold",), None, "status of tt", kind="flag", values=TT_STATUSES),
    *_floats(
        None,
        "tt_coefficients | a, b, c | V_eq = a t^2 + b t + c in SI units, t from the first point of the fit "
        f"| {GABRIELLI}, section 5.2.3.2",
        ("threshold", "coefficient"),
    ),
    *_floats("1", f"r_squared | R^2 | goodness of the fit of v_eq over time | {GABRIELLI}, Table 22", ("threshold",)),
    *_floats(
        "s",
        """
        tta | | time to the alarm level of RMS | monitor/health/rest/trend
        tta_lower | | lower end of tta | monitor/health/rest/trend
        tta_upper | | upper end of tta | monitor/health/rest/trend
        """,
        optional=True,
    ),
    *_floats(ACCELERATION, "tta_level | | RMS that tta leads to | monitor/health/rest/trend", optional=True),
    Variable(
        "tta_level_source",
        (),
        None,
        "what that level is",
        kind="flag",
        values=LEVEL_SOURCES,
        optional=True,
    ),
    Variable("tta_status", (), None, "status of tta", kind="flag", values=TTA_STATUSES, optional=True),
    *_floats(
        "m2", f"v_eq_true | V_eq | true damaged volume (simulated rigs only) | {GABRIELLI}, Eq. 90", optional=True
    ),
    *_floats(
        "s",
        f"tt_true | TT | true time to threshold (simulated rigs only) | {GABRIELLI}, Eq. 92",
        ("threshold",),
        optional=True,
    ),
    *_floats(
        "Hz",
        "speed_sd | | standard deviation of the error of speed | monitor/health/signal/condition.py",
        optional=True,
    ),
    *_floats(
        "N", "load_sd | | standard deviation of load over the block | monitor/health/signal/condition.py", optional=True
    ),
    Variable("speed_source", (), None, "where speed comes from", kind="flag", values=CONDITION_SOURCES, optional=True),
    Variable("load_source", (), None, "where load comes from", kind="flag", values=CONDITION_SOURCES, optional=True),
    Variable(
        "velocity_status", (), None, "status of velocity_rms", kind="flag", values=VELOCITY_STATUSES, optional=True
    ),
    Variable(
        "velocity_zone",
        (),
        None,
        "zone of velocity_rms for the class of the machine",
        "",
        "ISO 20816-3:2022, Tables A.1 and A.2",
        "flag",
        ZONES,
        optional=True,
    ),
    Variable(
        "domain",
        (),
        None,
        "spectra over time, or over the angle of the shaft, in Hz at the mean speed",
        "",
        "docs/decisions/0021",
        "flag",
        DOMAINS,
        optional=True,
    ),
    Variable(
        "rotation_status",
        (),
        None,
        "whether the angle of the shaft is known",
        "",
        ROTATION,
        "flag",
        ROTATION_STATUSES,
        optional=True,
    ),
    Variable(
        "level_status",
        (),
        None,
        "status of level_rms",
        "",
        "monitor/health/onset",
        "flag",
        LEVEL_STATUSES,
        optional=True,
    ),
    Variable("pulses_missing", (), "1", "pulses that were put in", "", ROTATION, "int", optional=True),
    Variable("pulses_extra", (), "1", "pulses that were left out", "", ROTATION, "int", optional=True),
    Variable(
        "gear_status",
        ("gear",),
        None,
        "whether a wheel was judged",
        "",
        GEARS,
        "flag",
        GEAR_STATUSES,
        optional=True,
    ),
    Variable(
        "gear_fault",
        ("gear",),
        None,
        "whether a wheel is named as damaged, and a hint of how",
        "",
        GEARS,
        "flag",
        (UNNAMED, *GEAR_KINDS),
        optional=True,
    ),
    *_floats(
        "1",
        f"""
        gear_score | | evidence of damage of a wheel over its threshold | {GEARS}
        gear_turns | N | turns of a wheel in its synchronous average | {GEARS}
        fm0 | FM0 | peak to peak of the average of a wheel over its mesh lines | Stewart, 1977
        fm4 | FM4 | kurtosis of the difference signal of a wheel | Stewart, 1977
        m6a | M6A | normalised sixth moment of the difference signal of a wheel | Martin, 1989
        na4 | NA4 | fourth moment of the residual of a wheel over its learned variance squared | Zakrajsek et al., 1993
        sideband_level | SLF | first sidebands of the mesh over the deviation of the average | Lebold et al., 2000
        gear_residual | | power of the residual of a wheel over that of what does not repeat with it | {GEARS}
        gear_sidebands | | power of the first sidebands of a wheel over that of its mesh | {GEARS}
        """,
        ("gear",),
        optional=True,
    ),
    *_floats("m2 s-4", f"gear_variance | | mean square of the residual of a wheel | {GEARS}", ("gear",), optional=True),
]

VARIABLES: dict[str, Variable] = {variable.name: variable for variable in _TABLE}
"""Every variable of a channel, by name."""
