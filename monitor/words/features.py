"""The one table of features: every number that a block gives for a channel, inside and for people.

Schema, alarm levels, trends, events, metrics and page read it. It stands in the lowest room of the monitor because
configuration, health stages and events read it as well as records. To add a feature, append a row here and a function
to ``monitor.health.signal.features.FUNCTIONS``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from monitor.words.numbers import duration, times_first, volume
from monitor.words.parts import PARTS
from streams.types.block import STANDARD_GRAVITY

ACCELERATION, VELOCITY, PURE = "m s-2", "m s-1", "1"


@dataclass(frozen=True)
class Unit:
    """A unit for people.

    Attributes:
        text: the unit as it is written, "" for a pure number.
        ending: of the names that hold a value in it (JSON keys, columns).
        si: one of the unit in SI.
        words: writes a value (SI) with the unit; by default three figures and ``text``.
        level: ending and SI value of the unit of alarm levels, where that is another one.
    """

    text: str = ""
    ending: str = ""
    si: float = 1.0
    words: Callable[[float], str] | None = None
    level: tuple[str, float] | None = None

    def write(self, value: float) -> str:
        """Return a value (SI) with its unit."""
        return self.words(value) if self.words else f"{value / self.si:.3g} {self.text}".rstrip()


@dataclass(frozen=True)
class Variable:
    """One quantity of a health record, given for every block and channel.

    Attributes:
        name: in records and files.
        dims: dimensions beyond (time, channel).
        units: UDUNITS string of the SI unit, "1" for a pure number, "time" for a moment on the record's time axis,
            None where a unit has no meaning.
        long_name: what it is.
        symbol: that of the source, in ASCII.
        source: where it is defined.
        kind: "float", "int", "flag" (one word of ``values``) or "mask" (any number of words of ``values``).
        values: allowed words, in the order of their integers.
        optional: whether files leave it out where no record has it.
        comment: where it departs from its source.
    """

    name: str
    dims: tuple[str, ...] = ()
    units: str | None = PURE
    long_name: str = ""
    symbol: str = ""
    source: str = ""
    kind: Literal["float", "int", "flag", "mask"] = "float"
    values: tuple[str, ...] = ()
    optional: bool = False
    comment: str = ""


@dataclass(frozen=True)
class Feature(Variable):
    """One row of the table.

    Attributes:
        label: what it is called in a sentence or a legend; by default the name with blanks.
        unit: for people.
        bad: the side on which values are bad, None where no alarm level may stand on it.
        learned: whether an alarm level may follow from the baseline.
        trend: whether its extremes are kept and shown over time.
        chart: chart of the page in which the trend is drawn, "" for none; features that end in ``_lower`` and
            ``_upper`` are drawn as its band.
        axis: whether the axis of the chart begins at zero or follows the values.
    """

    label: str = ""
    unit: Unit = Unit()
    bad: Literal["above", "below"] | None = None
    learned: bool = True
    trend: bool = False
    chart: str = ""
    axis: Literal["zero", "free"] = "zero"

    @property
    def column(self) -> str:
        """Its name with the ending of its unit for people."""
        return self.name + self.unit.ending

    @property
    def level(self) -> tuple[str, float]:
        """The ending of the key of an alarm level, and one of its unit in SI."""
        return self.unit.level or (self.unit.ending, self.unit.si)

    @property
    def needs_calibration(self) -> bool:
        """Whether a level on it compares V_eq with a volume: such a level has no meaning on an uncalibrated rig."""
        return self.units == "m2" or "threshold" in self.dims

    @property
    def acceleration(self) -> bool:
        """Whether values are in the sensor's own unit where that is not known."""
        return self.units == ACCELERATION

    def of_si(self, *, absolute: bool) -> float:
        """Return the factor from SI to the unit for people; ``absolute``: whether accelerations are in m/s2."""
        return 1.0 if self.acceleration and not absolute else 1.0 / self.unit.si

    def write(self, value: float, *, absolute: bool = True) -> str:
        """Return a value (SI) with its unit; ``absolute``: whether accelerations are in m/s2."""
        return f"{value:.3g} (unit of the sensor)" if self.acceleration and not absolute else self.unit.write(value)


GABRIELLI = "Gabrielli, doctoral thesis, University of Ferrara, 2022"
_CERUTI = "Ceruti, Master's thesis, Politecnico di Torino, 2021, section 4.2"
_SASSI = "Sassi et al., J. Vibration and Control 13, 2007, Eq. 36"
_EQ_57, _EQ_90, _EQ_92, _EQ_96 = (f"{GABRIELLI}, {place}" for place in ("Eq. 57", "Eqs. 90-91", "Eq. 92", "Eq. 96"))
_VELOCITY = "ISO 20816-1; monitor/health/signal/velocity.py"
ROTATION = "monitor/health/signal/rotation"
_MAP, _STAGES = f"{GABRIELLI}, section 5.4.1", f"{GABRIELLI}, section 5.2.2"

_LEVEL = Feature("", units=ACCELERATION, unit=Unit("g", "_g", STANDARD_GRAVITY), bad="above", trend=True)
_VOLUME = Feature("", units="m2", unit=Unit("mm³/mm", "_mm2", 1e-6, volume), bad="above", learned=False, trend=True)
_TIME = Unit("s", "_s", 1.0, duration, ("_hours", 3600.0))
_KINDS = {
    "level": _LEVEL,
    "level without trend": replace(_LEVEL, trend=False),
    "mean": replace(_LEVEL, trend=False, bad=None),
    "velocity": Feature("", units=VELOCITY, unit=Unit("mm/s", "_mm_s", 1e-3), bad="above", trend=True),
    "velocity floor": Feature("", units=VELOCITY, unit=Unit("mm/s", "_mm_s", 1e-3)),
    "lines": replace(_LEVEL, dims=("band",)),
    "number": Feature("", bad="above", trend=True),
    "number without trend": Feature("", bad="above"),
    "score": Feature("", bad="above", learned=False, trend=True),
    "relative": Feature("", unit=Unit(words=times_first), bad="above", learned=False, trend=True),
    "volume": _VOLUME,
    "time": Feature("", units="s", unit=_TIME, dims=("threshold",), bad="below", learned=False, trend=True),
    "share": Feature(
        "",
        unit=Unit(words=lambda value: f"{100 * value:.0f} %"),
        dims=("threshold",),
        bad="above",
        learned=False,
        trend=True,
    ),
    "speed": Feature("", units="Hz", unit=Unit("Hz", "_hz"), trend=True, axis="free"),
    "load": Feature("", units="N", unit=Unit("N", "_newton"), trend=True, axis="free"),
    "angle": Feature("", units="rad", unit=Unit("°", "_deg", math.pi / 180.0)),
    "depth": Feature("", units="m", unit=Unit("µm", "_um", 1e-6)),
    "record only": Feature(""),
    "rate of speed": Feature("", units="Hz s-1", unit=Unit("Hz/s", "_hz_per_s")),
}
"""What rows have in common, by the word in their second cell."""


def row(text: str) -> Feature:
    """Return the feature of a line ``name | kind | chart | symbol | label | long name | source``.

    A question mark after the kind marks what files leave out where no record has it.
    """
    name, kind, chart, symbol, label, long_name, source = (cell.strip() for cell in text.split("|"))
    return replace(
        _KINDS[kind.removesuffix("?")],
        name=name,
        optional=kind.endswith("?"),
        chart=chart,
        symbol=symbol,
        label=label or name.replace("_", " "),
        long_name=long_name,
        source=source,
    )


_SUMS = "\n".join(
    f"{name} | lines | lines | {name.capitalize()} | {name.capitalize()} ({words} lines) | "
    f"sum of the first five {words} lines of the envelope spectrum | {source}{_EQ_96}"
    for name, words, source in ((part.feature, part.words, "after " * (part is not PARTS[0])) for part in PARTS)
)
_TABLE = f"""
rms | level | rms | RMS | RMS | root mean square of the acceleration in the RMS band, mean removed | {_CERUTI}
rms_smoothed | level | rms | X_exp | smoothed RMS | trailing mean of RMS that enters the map | {_MAP}
velocity_rms | velocity | velocity | v_RMS | velocity | \
    root mean square of the velocity from 10 to 1000 Hz | {_VELOCITY}
velocity_floor | velocity floor | | | floor of the velocity | \
    continuous part of velocity_rms, which noise of the sensor gives as well | {_VELOCITY}
peak | level | peak | peak | | largest absolute acceleration | {_SASSI}
kurtosis | number | kurtosis | KV | | kurtosis, 3 for Gaussian noise | {_CERUTI}
crest_factor | number | | Crf | | peak over RMS | {_SASSI}
a_star | level | | A* | A* | root sum of squares of the first five BPFO lines of the raw spectrum | {_EQ_57}
{_SUMS}
detect_score | score | | score | score of the detector | \
    how far RMS and the lines of a part stand above the learned baseline | monitor/health/onset
fault_snr | number | | snr | signal of the fault over noise | \
    fault lines over the noise floor under them | monitor/health/name/naming.py
v_eq | volume | v_eq | V_eq | damaged volume V_eq | equivalent damaged volume per unit of width | {_EQ_90}
v_eq_lower | volume | v_eq | V_eq | lower end of V_eq | lower end of the interval of v_eq | {_EQ_90}
v_eq_upper | volume | v_eq | V_eq | upper end of V_eq | upper end of the interval of v_eq | {_EQ_90}
v_eq_relative | relative | v_eq_relative | V_eq/V_eq,1 | relative damaged volume | \
    v_eq over the first value tracked for the same part | monitor/health/size/calibration.py
tt | time | tt | TT | time to threshold | time to threshold, as issued at this block | {_EQ_92}
tt_lower | time | tt | TT | lower end of the time to threshold | lower end of the interval of tt | {_EQ_92}
tt_upper | time | tt | TT | upper end of the time to threshold | upper end of the interval of tt | {_EQ_92}
p_threshold | share | | | probability of reaching the threshold | \
    probability that the threshold is reached within the maintenance window |
speed | speed | speed | f_s | | rotation frequency of the shaft |
load | load | load | P | | radial load |
peak_half_range | level without trend | | peak value | half the range | half the range of the acceleration | {_CERUTI}
shape_factor | number without trend | | Shf | | RMS over mean absolute value | {_SASSI}
impulse_factor | number without trend | | Imf | | peak over mean absolute value | {_SASSI}
clearance_factor | number without trend | | Clf | | \
    peak over squared mean of the root of the absolute value | {_CERUTI}
mean | mean | | mean | | mean acceleration | {_CERUTI}
skewness | record only | | SK | | skewness | {_CERUTI}
v_eq_filter | volume | | | | V_eq by the filter, where it runs beside the library | monitor/health/size/calibration.py
v_eq_filter_lower | volume | | | | lower end of the interval of v_eq_filter | monitor/health/size/calibration.py
v_eq_filter_upper | volume | | | | upper end of the interval of v_eq_filter | monitor/health/size/calibration.py
p_no_growth | record only | | | | probability that V_eq stands still | monitor/health/size
p_crossed | record only | | | | probability that a further run ends at or below the present level of RMS | \
    monitor/health/rest/learned
speed_factor | record only | | s | | \
    speed found over the nominal one, of the shaft or else of the lines of a fault | monitor/health/signal/shaft.py
detect_threshold | record only | | threshold | | score above which a block counts as abnormal | monitor/health/onset
fault_depth | record only | | depth | | \
    root sum of squares of the fault lines over the mean envelope | monitor/health/name/naming.py
fault_score | record only | | score | | evidence of the best family of fault lines | monitor/health/name/naming.py
dphi_d | angle | | dphi_d | | angular extent of the equivalent defect | {_STAGES}
h_d | depth | | h_d | | depth of the equivalent defect | {_STAGES}
speed_min | speed? | speed | | least speed | least speed in the block | {ROTATION}
speed_max | speed? | speed | | highest speed | highest speed in the block | {ROTATION}
acceleration | rate of speed? | | | change of the speed | \
    change of the speed over the block, per second | {ROTATION}
revolutions | record only? | | | | revolutions of the shaft in the block | {ROTATION}
encoder_error | angle? | | | error of the marks | \
    rms of the learned error of the marks | {ROTATION}
level_rms | score? | level_rms | | RMS over the expected one | \
    rms over what is learned for speed and load | monitor/health/onset
"""

_FOUND_LINES = "lines within 2 % of BPFO, printed at BPFO"
_DEPARTURES = {
    "rms": "printed with the mean",
    "crest_factor": "Ceruti's peak is half the range",
    "a_star": _FOUND_LINES,
    "h_or": _FOUND_LINES,
    "impulse_factor": "Ceruti's peak is half the range",
    "clearance_factor": "printed with abs(x), half the range",
}

FEATURES: dict[str, Feature] = {
    found.name: replace(found, comment=_DEPARTURES.get(found.name, ""))
    for found in map(row, _TABLE.strip().splitlines())
}
"""All features by name."""
TRENDS: tuple[Feature, ...] = tuple(feature for feature in FEATURES.values() if feature.trend)
"""Features whose extremes are kept over time."""
LEVELS: dict[str, Feature] = {name: feature for name, feature in FEATURES.items() if feature.bad is not None}
"""Features on which an alarm level may stand, by name."""


def first(value: Any) -> Any:
    """Return the first of several values (bands, thresholds), or the only one."""
    return (value[0] if value else None) if isinstance(value, list | tuple) else value


def columns(names: Iterable[str], values: Mapping[str, Any], *, absolute: bool = True) -> dict[str, float | None]:
    """Return values of a record, SI, by the names of their columns and in the units of these; None: no value."""
    found: dict[str, float | None] = {}
    for feature in (FEATURES[name] for name in names):
        value = first(values.get(feature.name))
        found[feature.column] = None if value is None else value * feature.of_si(absolute=absolute)
    return found


def rule_words(alarm: Mapping[str, Any]) -> str:
    """Return how an alarm's rule is called: by its own name, or what it watches where it has none."""
    rule, feature = str(alarm["rule"]), alarm.get("feature")
    return FEATURES[rule].label if rule == feature and rule in FEATURES else rule
