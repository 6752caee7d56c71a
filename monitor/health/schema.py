"""The variables of a health record: those of the table of features, lines of spectra, marks and statuses.

netCDF attributes, the report and docs/reference/records.md come from here. The integers that stand for words in netCDF
files follow from the order of the words: append to a tuple of words, never reorder it.
"""

from __future__ import annotations

from dataclasses import replace

from monitor.health.gears.naming import KINDS as GEAR_KINDS
from monitor.health.gears.naming import STATUSES as GEAR_STATUSES
from monitor.health.gears.values import UNNAMED
from monitor.health.onset import STAGES
from monitor.health.rest.trend import LEVEL_SOURCES, TtaStatus
from monitor.health.signal.condition import SOURCES as CONDITION_SOURCES
from monitor.health.signal.quality import FLAGS, REJECTIONS
from monitor.health.signal.velocity import VELOCITY_STATUSES
from monitor.health.size import EdvStatus, TtStatus
from monitor.words.features import ACCELERATION, FEATURES, GABRIELLI, PURE, ROTATION, Variable
from monitor.words.parts import FAULTS
from monitor.words.statuses import UNDECIDED
from monitor.words.zones import ZONES
from streams.types.times import TIME_SOURCES

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
QUANTITIES = ("acceleration", "velocity")
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

_LINES = ("band", "fault", "harmonic")
_SEARCH, _ONSET, _GEARS = "monitor/health/signal/lines.py", "monitor/health/onset", "monitor/health/gears"
_CONDITION, _SHAFT = "monitor/health/signal/condition.py", "monitor/health/signal/shaft.py"
_CLOCK, _DERIVATIVE = "streams/dates/clock.py", "monitor/health/signal/differentiate.py"
_TREND, _ZONES, _ORDERS = "monitor/health/rest/trend", "ISO 20816-3:2022, Tables A.1 and A.2", "docs/decisions/0021"
_NO_YES = ("no", "yes")


def _float(
    name: str,
    long_name: str,
    units: str | None = PURE,
    symbol: str = "",
    source: str = "",
    dims: tuple[str, ...] = (),
) -> Variable:
    return Variable(name, dims, units, long_name, symbol, source)


def _flag(name: str, words: tuple[str, ...], long_name: str, source: str = "", dims: tuple[str, ...] = ()) -> Variable:
    return Variable(name, dims, None, long_name, "", source, "flag", words)


def _mask(name: str, words: tuple[str, ...], long_name: str) -> Variable:
    return Variable(name, (), None, long_name, kind="mask", values=words)


def _int(name: str, long_name: str, source: str = "") -> Variable:
    return Variable(name, (), PURE, long_name, "", source, "int")


def _optional(*variables: Variable) -> tuple[Variable, ...]:
    """Return variables that files leave out where no record has them."""
    return tuple(replace(variable, optional=True) for variable in variables)


_TABLE: tuple[Variable, ...] = (
    *FEATURES.values(),
    _float(
        "envelope_amplitude",
        "amplitude of a line of the envelope spectrum",
        ACCELERATION,
        "A_e,k",
        f"{GABRIELLI}, Eqs. 94-96",
        _LINES,
    ),
    _float(
        "envelope_floor", "noise floor of the envelope spectrum under the line", ACCELERATION, "floor", _SEARCH, _LINES
    ),
    _float("envelope_snr", "line over the noise floor under it", PURE, "snr", _SEARCH, _LINES),
    _float(
        "bpfo_amplitude",
        "amplitude of a BPFO line of the raw spectrum",
        ACCELERATION,
        "A_BPFO,k",
        f"{GABRIELLI}, section 4.2.3",
        ("bpfo_harmonic",),
    ),
    *_optional(
        _float("envelope_mean", "mean of the envelope", ACCELERATION, dims=("band",)),
        _float("rms_baseline", "learned RMS, in the final stage", ACCELERATION, "", _ONSET),
    ),
    _float("band_lo", "lower edge of the demodulation band", "Hz", dims=("band",)),
    _float("band_hi", "upper edge of the demodulation band", "Hz", dims=("band",)),
    _flag("band_source", BAND_SOURCES, "how the demodulation band was chosen"),
    _flag("absolute_level", _NO_YES, "whether accelerations are in m s-2"),
    _flag("quality_status", STATUSES, "verdict on the channel's samples"),
    _mask("quality_flags", FLAGS, "all flags of the channel's samples"),
    _flag("stage", STAGES, "stage of life", f"{GABRIELLI}, section 5.2.2"),
    _float("t_fs", "moment at which the final stage began", "time", "t_fs", f"{GABRIELLI}, section 5.2.2"),
    _float("t_fs_known", "moment at which the start of the final stage was known", "time", "", _ONSET),
    _float("t_eol", "moment of the end of life", "time", "t_EOL", f"{GABRIELLI}, section 5.4"),
    _int("t_fs_block", "number of the block in which the final stage began"),
    _int("t_fs_known_block", "number of the block in which the final stage was known"),
    _int("t_eol_block", "number of the block that ended the life"),
    _mask("fault", NAMES, "damaged part; several where they cannot be told apart"),
    *_optional(
        _flag(
            "fault_basis", (HINT, VERDICT), "what the name of the damaged part is: a hint before t_fs, a verdict since"
        ),
        _mask("fault_candidates", FAULTS, "parts between which the stated speed cannot decide"),
        _flag("speed_unverified", _NO_YES, "whether fault rests on a nominal speed that the signal does not show"),
        _float("speed_factor_sd", "standard deviation of speed_factor where the shaft shows it", PURE, "", _SHAFT),
        _mask("raised", FAULTS, "parts whose lines stand above their baseline"),
    ),
    _flag("edv_status", EDV_STATUSES, "status of v_eq"),
    _float("v_th", "threshold of v_eq", "m2", "V_th", f"{GABRIELLI}, Eq. 92", ("threshold",)),
    _flag("tt_status", TT_STATUSES, "status of tt", dims=("threshold",)),
    _float(
        "tt_coefficients",
        "V_eq = a t^2 + b t + c in SI units, t from the first point of the fit",
        None,
        "a, b, c",
        f"{GABRIELLI}, section 5.2.3.2",
        ("threshold", "coefficient"),
    ),
    _float("r_squared", "goodness of the fit of v_eq over time", PURE, "R^2", f"{GABRIELLI}, Table 22", ("threshold",)),
    *_optional(
        _float("tta", "time to the alarm level of RMS", "s", "", _TREND),
        _float("tta_lower", "lower end of tta", "s", "", _TREND),
        _float("tta_upper", "upper end of tta", "s", "", _TREND),
        _float("tta_level", "RMS that tta leads to", ACCELERATION, "", _TREND),
        _flag("tta_level_source", LEVEL_SOURCES, "what that level is"),
        _flag("tta_status", TTA_STATUSES, "status of tta"),
        _float("v_eq_true", "true damaged volume (simulated rigs only)", "m2", "V_eq", f"{GABRIELLI}, Eq. 90"),
        _float(
            "tt_true", "true time to threshold (simulated rigs only)", "s", "TT", f"{GABRIELLI}, Eq. 92", ("threshold",)
        ),
        _float("speed_sd", "standard deviation of the error of speed", "Hz", "", _CONDITION),
        _float("load_sd", "standard deviation of load over the block", "N", "", _CONDITION),
        _flag("speed_source", CONDITION_SOURCES, "where speed comes from"),
        _flag("load_source", CONDITION_SOURCES, "where load comes from"),
        _flag("quantity", QUANTITIES, "what the sensor measures; without it, an acceleration", _DERIVATIVE),
        _float("acceleration_limit", "frequency up to which that of a velocity is known", "Hz", "", _DERIVATIVE),
        _flag("velocity_status", VELOCITY_STATUSES, "status of velocity_rms"),
        _flag("velocity_zone", ZONES, "zone of velocity_rms for the class of the machine", _ZONES),
        _flag("domain", DOMAINS, "spectra over time, or over the angle of the shaft, in Hz at the mean speed", _ORDERS),
        _flag("rotation_status", ROTATION_STATUSES, "whether the angle of the shaft is known", ROTATION),
        _flag("level_status", LEVEL_STATUSES, "status of level_rms", _ONSET),
        _int("pulses_missing", "pulses that were put in", ROTATION),
        _int("pulses_extra", "pulses that were left out", ROTATION),
        _flag("gear_status", GEAR_STATUSES, "whether a wheel was judged", _GEARS, dims=("gear",)),
        _flag(
            "gear_fault",
            (UNNAMED, *GEAR_KINDS),
            "whether a wheel is named as damaged, and a hint of how",
            _GEARS,
            dims=("gear",),
        ),
        _float("gear_score", "evidence of damage of a wheel over its threshold", PURE, "", _GEARS, ("gear",)),
        _float("gear_turns", "turns of a wheel in its synchronous average", PURE, "N", _GEARS, ("gear",)),
        _float(
            "fm0", "peak to peak of the average of a wheel over its mesh lines", PURE, "FM0", "Stewart, 1977", ("gear",)
        ),
        _float("fm4", "kurtosis of the difference signal of a wheel", PURE, "FM4", "Stewart, 1977", ("gear",)),
        _float(
            "m6a", "normalised sixth moment of the difference signal of a wheel", PURE, "M6A", "Martin, 1989", ("gear",)
        ),
        _float(
            "na4",
            "fourth moment of the residual of a wheel over its learned variance squared",
            PURE,
            "NA4",
            "Zakrajsek et al., 1993",
            ("gear",),
        ),
        _float(
            "sideband_level",
            "first sidebands of the mesh over the deviation of the average",
            PURE,
            "SLF",
            "Lebold et al., 2000",
            ("gear",),
        ),
        _float(
            "gear_residual",
            "power of the residual of a wheel over that of what does not repeat with it",
            PURE,
            "",
            _GEARS,
            ("gear",),
        ),
        _float(
            "gear_sidebands",
            "power of the first sidebands of a wheel over that of its mesh",
            PURE,
            "",
            _GEARS,
            ("gear",),
        ),
        _float("gear_variance", "mean square of the residual of a wheel", "m2 s-4", "", _GEARS, ("gear",)),
        _float("duration", "length of the block", "s"),
        _float("time_uncertainty_s", "uncertainty of the time", "s", "", _CLOCK),
        _flag("time_source", TIME_SOURCES, "what dates the block", _CLOCK),
        _float("time_stated", "stated time that is not believed", "time", "", _CLOCK),
    ),
)

VARIABLES: dict[str, Variable] = {variable.name: variable for variable in _TABLE}
"""Every variable of a channel, by name."""
