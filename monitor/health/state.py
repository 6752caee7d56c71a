"""All that a channel remembers from block to block, frozen and writable as JSON."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.health.damage.filter.particle_filter import FilterState
from monitor.health.damage.library.forecaster import LibraryState
from monitor.health.damage.tracker import DamageState
from monitor.health.detect import DetectState
from monitor.health.spectrum.transform import Band
from monitor.health.spectrum.votes import BandVotes

STATE_VERSION = 2


@dataclass(frozen=True)
class Named:
    """The part that a channel's fault was named, and on what evidence.

    Attributes:
        fault: "outer", "inner", "ball", "cage" or two of them joined by "|".
        snr: its lines over the floor under them.
        depth: its lines over the mean envelope.
        standing: its score over the score that it had to reach.
        sequence: block at which this was said.
    """

    fault: str
    snr: float
    depth: float
    standing: float
    sequence: int


@dataclass(frozen=True, eq=False)
class Spectra:
    """The latest envelope spectra of a channel, in power and relative to the mean envelope, oldest first.

    Attributes:
        rows: one array of shape (band, bin), float32, for each block.
    """

    rows: tuple[NDArray[np.float32], ...] = ()

    @property
    def count(self) -> int:
        """How many blocks there are."""
        return len(self.rows)

    def add(self, amplitudes: tuple[NDArray[np.float32], ...], most: int) -> Spectra:
        """Return the spectra with those of one more block (one array a band), and at most ``most`` blocks.

        Spectra of another number of bins or bands start anew: they cannot be averaged with what was.
        """
        length = min(amplitude.size for amplitude in amplitudes)
        row = np.square(np.stack([amplitude[:length] for amplitude in amplitudes]), dtype=np.float32)
        earlier = self.rows if self.rows and self.rows[-1].shape == row.shape else ()
        return Spectra((*earlier, row)[-most:])

    def averages(self) -> tuple[NDArray[np.float64], ...]:
        """Return the root of the mean power of each band, shape (bin,), each block weighted by one over its noise.

        Noise is the median over the bins. With equal weights a single impact, whose spectrum is high everywhere, would
        outweigh all other blocks, and what is left is no more certain than one spectrum.
        """
        rows = np.stack(self.rows).astype(np.float64)
        noise = np.maximum(np.median(rows, axis=2, keepdims=True), np.finfo(np.float64).tiny)
        weights = (1.0 / noise) / np.sum(1.0 / noise, axis=0)
        return tuple(np.sqrt(np.sum(weights * rows, axis=0)))

    def __eq__(self, other: object) -> bool:
        """Equal where all rows are equal bit for bit."""
        return (
            isinstance(other, Spectra)
            and self.count == other.count
            and all(np.array_equal(a, b) for a, b in zip(self.rows, other.rows, strict=True))
        )

    __hash__ = None  # pyright: ignore[reportAssignmentType]  # holds arrays: equal, but not hashable

    def to_list(self) -> list[dict[str, Any]]:
        """Return the rows as text that keeps every bit."""
        return [
            {"shape": list(row.shape), "float32": base64.b64encode(row.astype("<f4").tobytes()).decode("ascii")}
            for row in self.rows
        ]

    @classmethod
    def from_list(cls, rows: list[Mapping[str, Any]]) -> Spectra:
        """Return what :meth:`to_list` wrote."""
        return cls(
            tuple(
                np.frombuffer(base64.b64decode(row["float32"]), dtype="<f4").reshape(row["shape"]).astype(np.float32)
                for row in rows
            )
        )


@dataclass(frozen=True)
class ChannelState:
    """All that one channel remembers.

    Attributes:
        detect: the onset detector.
        bands: the bands that were chosen, Hz, or () where none were (yet).
        band_source: "learning" or "recording" once chosen, else "provisional".
        votes: what the first blocks say of the candidate bands, or None.
        spectra: the latest envelope spectra, for the averaged one.
        running_time: seconds that the machine has run, the time axis of the damage.
        last_time: time of the latest block that was in order, s, or None.
        was_running: whether the machine ran then.
        damage: the trackers and forecasts.
        named: what the fault is called, or None.
    """

    detect: DetectState = field(default_factory=DetectState)
    bands: tuple[Band, ...] = ()
    band_source: str = "provisional"
    votes: BandVotes | None = None
    spectra: Spectra = field(default_factory=Spectra)
    running_time: float = 0.0
    last_time: float | None = None
    was_running: bool = False
    damage: DamageState = field(default_factory=DamageState)
    named: Named | None = None
    version: int = STATE_VERSION

    def to_dict(self) -> dict[str, Any]:
        """Return the state as plain values for JSON; floats come back as they were."""
        return {
            "version": self.version,
            "detect": self.detect.to_dict(),
            "bands": [list(band) for band in self.bands],
            "band_source": self.band_source,
            "votes": None if self.votes is None else self.votes.to_dict(),
            "spectra": self.spectra.to_list(),
            "running_time": self.running_time,
            "last_time": self.last_time,
            "was_running": self.was_running,
            "damage": self.damage.to_dict(),
            "named": None if self.named is None else asdict(self.named),
        }

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> ChannelState:
        """Return the state that :meth:`to_dict` gave.

        Raises:
            ValueError: if it was written in a layout that this version does not know.
        """
        version = stored.get("version")
        if version not in (1, STATE_VERSION):
            raise ValueError(f"channel state: version {STATE_VERSION} expected, got {version!r}")
        return cls(
            detect=DetectState.from_dict(stored["detect"]),
            bands=tuple((float(low), float(high)) for low, high in stored["bands"]),
            band_source=stored["band_source"],
            votes=None if stored["votes"] is None else BandVotes.from_dict(stored["votes"]),
            spectra=Spectra.from_list(stored["spectra"]),
            running_time=stored["running_time"],
            last_time=stored["last_time"],
            was_running=stored["was_running"],
            damage=DamageState.from_dict(stored["damage"] if version > 1 else _damage_of_version_1(stored)),
            named=None if stored["named"] is None else Named(**stored["named"]),
        )


def _damage_of_version_1(stored: Mapping[str, Any]) -> dict[str, Any]:
    """Return the damage of a state that kept its parts side by side, and of a waiting block its time and RMS only."""
    return {
        "pending": [[time, rms, None, None, None] for time, rms in stored["pending"]],
        "edv": stored["edv"],
        "filter": FilterState().to_dict(),
        "forecast": stored["forecast"],
        "library": LibraryState().to_dict(),
    }
