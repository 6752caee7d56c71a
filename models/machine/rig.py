"""Parameters of the six-degree-of-freedom model (thesis, Table 18), its natural frequencies and damping ratios.

Draws of the uncertain parameters of a rig: the posterior of an identification, and its file.

The hash of the identification is that of the text of the file, so that a file that was edited or belongs to another
identification is told from the right one by the hash that ``[rig]`` holds.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from models.words.checks import check_choice, check_numbers
from models.words.errors import WrongInputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.bearing import Bearing, Element
    from models.words.request import Sensor


Calibration = bool | Literal["declared"]
"""Whether a rig's parameters are those of the machine: identified on it, or "declared" by a person."""
Claim = Literal[False, "declared"]
"""The same of a model whose parameters no identification finds."""


@dataclass(frozen=True)
class RigParameters:
    """Base of the parameters of a model's machine, without fields of its own.

    Attributes:
        model: the model that takes them, a key of ``models.solve.registry.MODELS``.
        first_sensor: the first of its sensors.
        uncertain: names of the fields that differ from machine to machine of a kind.
        ignores_depth: why its vibration is the same for any depth of a defect, "" where it is not.
        slow: whether its map takes a processor a quarter of an hour, and a life as long.
    """

    model: ClassVar[str]
    first_sensor: ClassVar[Sensor]
    uncertain: ClassVar[tuple[str, ...]]
    ignores_depth: ClassVar[str] = ""
    slow: ClassVar[bool] = False

    if TYPE_CHECKING:
        # A field of each type, at a place of its own.
        calibrated: Calibration = False

    def check_bearing(self, bearing: Bearing) -> None:
        """Raise a ValueError that says why the parameters cannot belong to a bearing."""
        raise NotImplementedError

    def as_dict(self) -> dict[str, Any]:
        """Return the parameters as plain values, from which the type makes the same rig as keyword arguments."""
        return asdict(self)


@dataclass(frozen=True)
class Rig(RigParameters):
    """Lumped parameters of the six-degree-of-freedom model (thesis, Table 18 and section 4.2.1).

    Attributes:
        m_i, m_o, m_r, m_b: masses of inner ring and shaft, of outer ring and casing, of the fictitious high-frequency
            resonator, and of one rolling element, kg.
        k_i, c_i: stiffness, N/m, and damping, N s/m, of the shaft to ground.
        k_r, c_r: the same between resonator and casing.
        k_c: contact stiffness of one rolling element between both rings, N/m^1.5 of a ball, N/m^(10/9) of a roller
            (Eq. 35).
        alpha_c: mass coefficient of the contact damping, 1/s (Eq. 39).
        beta_c: stiffness coefficient of the contact damping, s (Eq. 39).
        element: the rolling element that ``k_c`` belongs to; a scene refuses a bearing with another.
        calibrated: whether the parameters are those of the machine: true where they were identified on it, or where
            the machine is a simulation with them; "declared" where a person vouches for them.
        identification: hash of the identification that found them, "" for none.
    """

    model: ClassVar[str] = "six_dof"
    first_sensor: ClassVar[Sensor] = "mo"
    uncertain: ClassVar[tuple[str, ...]] = ("m_i", "m_o", "m_r", "k_i", "k_r", "k_c", "c_i", "c_r", "alpha_c", "beta_c")
    # Whether the turn of the cage enters the rate of approach of a contact (Eq. 36).
    cage_in_rate: ClassVar[bool] = True

    m_i: float = 3.48
    m_o: float = 5.79
    m_r: float = 3.01
    m_b: float = 1.47e-3
    k_i: float = 75e6
    k_r: float = 4.25e9
    k_c: float = 5927e6
    c_i: float = 2834.1
    c_r: float = 186.0
    alpha_c: float = 154.9
    beta_c: float = 2.5e-5
    element: Element = "ball"
    calibrated: Calibration = False
    identification: str = ""

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        if self.calibrated not in (False, True, "declared"):
            raise ValueError(f"rig.calibrated must be False, True or 'declared', got {self.calibrated!r}")
        if self.identification and self.calibrated is not True:
            raise ValueError(f"rig.identification belongs to rig.calibrated = True, got {self.calibrated!r}")
        check_numbers(self, "rig.", "positive", "m_i", "m_o", "m_r", "k_i", "k_r", "k_c")
        check_choice(self.element, "rig.element", ("ball", "roller"))
        check_numbers(self, "rig.", "not negative", "m_b", "c_i", "c_r", "alpha_c", "beta_c")

    def check_bearing(self, bearing: Bearing) -> None:
        """Raise a ValueError that says why the parameters cannot belong to a bearing."""
        if self.element != bearing.element:
            raise ValueError(f"rig.k_c is that of a {self.element}, {bearing.designation} has {bearing.element}s")

    @property
    def is_default_bench(self) -> bool:
        """Whether masses and springs are those of the default test bench (thesis, Table 18)."""
        return all(getattr(self, name) == getattr(Rig, name) for name in _BENCH)

    def as_dict(self) -> dict[str, Any]:
        """Return the parameters as plain values; ``Rig(**values)`` is the same rig."""
        values = super().as_dict()
        if not self.identification:
            # As before there were identifications, so that maps and populations keep their hash.
            del values["identification"]
        return values


_BENCH = ("m_i", "m_o", "m_r", "k_i", "k_r")


def natural_frequencies(rig: Rig, k_xx: float, k_yy: float) -> NDArray[np.float64]:
    """Return the six natural frequencies of the undamped linearised rig, Hz, ascending (Eqs. 59 and 60).

    ``k_xx`` and ``k_yy`` are the stiffness of the bearing across and along the load, N/m.
    """
    from models.words.numerics import generalised_eigenvalues

    mass = np.diag([rig.m_i, rig.m_o, rig.m_r])
    values: list[NDArray[np.float64]] = []
    for k_b in (k_xx, k_yy):
        stiffness = np.array(
            [[k_b + rig.k_i, -k_b, 0.0], [-k_b, k_b + rig.k_r, -rig.k_r], [0.0, -rig.k_r, rig.k_r]], dtype=float
        )
        values.append(generalised_eigenvalues(stiffness, mass))
    return np.sort(np.sqrt(np.maximum(np.concatenate(values), 0.0))) / (2.0 * math.pi)


def resonator_stiffness(rig: Rig, k_b: float, frequency: float) -> float:
    """Return the k_r that gives the rig a natural frequency, N/m (Eq. 62).

    Source: Eqs. 62-65. Eq. 63 as printed misses k_b m_i in its bracket, which is Lambda of Eq. 65.

    Masses and k_i are the rig's; ``k_b`` is the bearing stiffness in the direction of the mode, N/m; frequency in Hz.
    """
    lam = (2.0 * math.pi * frequency) ** 2
    constant = lam**2 * rig.m_i * rig.m_o - lam * (rig.k_i * rig.m_o + k_b * rig.m_i + k_b * rig.m_o) + rig.k_i * k_b
    return lam * rig.m_r * constant / (lam * rig.m_r * (lam * rig.m_i - rig.k_i - k_b) + constant)


def stiffness_damping(zeta: float, frequency: float, stiffness: float) -> float:
    """Return the damping coefficient beta k, N s/m, that gives a damping ratio at a frequency in Hz (Eqs. 75, 76)."""
    return zeta * stiffness / (math.pi * frequency)


def contact_damping(zeta_1: float, zeta_2: float, f_1: float, f_2: float) -> tuple[float, float]:
    """Return alpha_c (1/s) and beta_c (s) that give two damping ratios at two frequencies, Hz (Eqs. 70, 73 and 74).

    Raises:
        ValueError: if the frequencies are not positive and ascending.
    """
    if not 0.0 < f_1 < f_2:
        raise ValueError(f"frequencies must be positive and ascending, got {f_1!r} and {f_2!r} Hz")
    omega_1, omega_2 = 2.0 * math.pi * f_1, 2.0 * math.pi * f_2
    span = omega_2**2 - omega_1**2
    beta_c = 2.0 * (omega_2 * zeta_2 - omega_1 * zeta_1) / span
    alpha_c = 2.0 * omega_1 * omega_2 * (omega_2 * zeta_1 - omega_1 * zeta_2) / span
    return alpha_c, beta_c


CLEARANCE = "clearance"
"""The radial clearance, m: the one parameter that is not a field of ``Rig``."""
# Significant digits in the file; what is drawn is rounded to them first.
_DIGITS = 12
_SAME = 1e-9
_TITLE = "# posterior of a rig (SI): equally likely draws, one a line; a changed file is refused"
_HASH = "# identification "
_NAMES = (*(f.name for f in fields(Rig) if f.name not in ("element", "calibrated", "identification")), CLEARANCE)


class PosteriorError(WrongInputError, ValueError):
    """Draws of a rig, or their file, cannot be used; the message says why."""


@dataclass(frozen=True)
class RigDraws:
    """Equally likely values of the uncertain parameters of a rig, SI.

    Attributes:
        identification: hash of the identification whose posterior they are drawn from.
        names: of the parameters: fields of ``Rig``, or "clearance", m.
        rows: their values, a row per draw, in random order: the first of them are draws as good as all.
    """

    identification: str
    names: tuple[str, ...]
    rows: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        """Raise a PosteriorError for names that are no parameters, or rows that are no numbers for them."""
        wrong = [name for name in self.names if name not in _NAMES]
        if wrong or not self.names or len(set(self.names)) < len(self.names):
            raise PosteriorError(f"parameters of a posterior: expected some of {', '.join(_NAMES)}, got {self.names!r}")
        if not self.rows or any(len(row) != len(self.names) or not all(map(math.isfinite, row)) for row in self.rows):
            raise PosteriorError(f"a posterior needs rows of {len(self.names)} finite numbers")

    @classmethod
    def from_dict(cls, data: Mapping[str, Any] | None) -> RigDraws | None:
        """Return the draws whose fields JSON gave back, None for None."""
        if data is None:
            return None
        rows = tuple(tuple(float(value) for value in row) for row in data["rows"])
        return cls(str(data["identification"]), tuple(data["names"]), rows)

    def first(self, count: int) -> RigDraws:
        """Return the first draws; PosteriorError where there are not so many."""
        if count > len(self.rows):
            raise PosteriorError(f"the posterior has {len(self.rows)} draws, asked for {count}")
        return replace(self, rows=self.rows[:count])

    def rig(self, rig: Rig, number: int) -> Rig:
        """Return a rig with the parameters of a draw."""
        drawn = dict(zip(self.names, self.rows[number], strict=True))
        drawn.pop(CLEARANCE, None)
        return replace(rig, **drawn)

    def clearance(self, otherwise: float, number: int) -> float:
        """Return the clearance of a draw, m, ``otherwise`` where it is not among the parameters."""
        return dict(zip(self.names, self.rows[number], strict=True)).get(CLEARANCE, otherwise)

    def check(self, rig: Rig) -> None:
        """Raise a PosteriorError unless a rig is the one that was identified, by the hash that it bears."""
        if not (rig.identification and self.identification.startswith(rig.identification.removeprefix("sha256:"))):
            raise PosteriorError(
                f"the posterior is of identification {self.identification[:16]}, "
                f"the rig of {rig.identification[:23] or 'none'}"
            )


@dataclass(frozen=True)
class RigPosterior:
    """The posterior of an identification as its file holds it, SI.

    Attributes:
        best: (name, value) of all parameters at the best fit, the known ones too.
        names, rows: as in ``RigDraws``.
        result: hash of tests, space and result.
        effective: effective number of independent candidates that the draws come from.
        candidates: that were simulated for them.
    """

    best: tuple[tuple[str, float], ...]
    names: tuple[str, ...]
    rows: tuple[tuple[float, ...], ...]
    result: str
    effective: float
    candidates: int

    @cached_property
    def identification(self) -> str:
        """SHA-256 of the text of the file, hexadecimal."""
        return hashlib.sha256("\n".join(self._lines()).encode()).hexdigest()

    @property
    def draws(self) -> RigDraws:
        """The draws with the hash of the identification."""
        return RigDraws(self.identification, self.names, self.rows)

    def text(self) -> str:
        """Return the text of the file."""
        return "\n".join([f"{_HASH}{self.identification}", *self._lines(), ""])

    def _lines(self) -> Iterator[str]:
        yield _TITLE
        yield f"# tests and result {self.result}"
        yield f"# effective {self.effective:.1f} of {self.candidates} candidates"
        yield "# best " + " ".join(f"{name}={_text(value)}" for name, value in self.best)
        yield ",".join(self.names)
        for row in self.rows:
            yield ",".join(map(_text, row))

    def differences(self, rig: Rig, clearance: float) -> list[str]:
        """Return in words which parameters of a rig are not those of the best fit; SI.

        The clearance, m, which belongs to the bearing, counts only where it was identified.
        """
        found: list[str] = []
        for name, value in self.best:
            if name == CLEARANCE and name not in self.names:
                continue
            given = clearance if name == CLEARANCE else float(getattr(rig, name))
            if not math.isclose(given, value, rel_tol=_SAME, abs_tol=1e-15):
                found.append(f"{name} is {given:.12g}, identified was {value:.12g}")
        return found


def rounded(value: float) -> float:
    """Return a number as the file of a posterior holds it."""
    return float(_text(value))


def _text(value: float) -> str:
    return f"{value:.{_DIGITS}g}"


def read_posterior(path: Path) -> RigPosterior:
    """Return the posterior in a file.

    Raises:
        PosteriorError: it cannot be read, is no posterior, or was changed since it was written.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise PosteriorError(f"{path}: cannot be read: {error}") from None
    try:
        found = _parse(lines)
        found.draws.check(Rig(calibrated=True, identification=lines[0].removeprefix(_HASH)))
    except (ValueError, IndexError, StopIteration) as error:
        raise PosteriorError(
            f"{path}: is not the posterior that was written, or was changed; run identify again ({error})"
        ) from None
    return found


def _parse(lines: list[str]) -> RigPosterior:
    """Return what the lines of a file say; a ValueError or IndexError where they are of another form."""
    if not lines[0].startswith(_HASH) or lines[1] != _TITLE:
        raise PosteriorError("its first lines are not those of a posterior")
    effective, _, candidates = lines[3].removeprefix("# effective ").removesuffix(" candidates").split(" ")
    best = (item.split("=") for item in lines[4].removeprefix("# best ").split(" "))
    return RigPosterior(
        best=tuple((name, float(value)) for name, value in best),
        names=tuple(lines[5].split(",")),
        rows=tuple(tuple(float(value) for value in line.split(",")) for line in lines[6:]),
        result=lines[2].removeprefix("# tests and result "),
        effective=float(effective),
        candidates=int(candidates),
    )


def without_draws(data: dict[str, Any], draws: RigDraws | None) -> dict[str, Any]:
    """Return the fields of a plan or population for JSON: without draws, as before there were any, by their hash."""
    rest = {name: value for name, value in data.items() if name != "rig_posterior"}
    return rest if draws is None else rest | {"rig_posterior": asdict(draws)}
