"""What the shaft did in a block as text for people: its speeds, the domain of the spectra, why there is no angle."""

from __future__ import annotations

ROTATION_REFUSALS = {
    "none": "no pulses and no speed over time came with the block",
    "too_few": "too few pulses or turns fell into the block",
    "irregular": "the pulses do not fit a shaft that turns",
    "reversed": "the shaft turned back",
    "stopped": "the shaft stood still in the block",
    "cannot_tell": "the vibration does not show the angle of the shaft well enough",
    "too_wide": "the highest speed in the block is more than six times the least",
}
"""Why the angle of the shaft over a block is not known, by ``rotation_status``."""
DOMAINS = {
    "hertz": "spectra in Hz",
    "order": "spectra in orders of the shaft",
}
"""What the spectra of a block are over."""


def speed_words(status: str | None, domain: str | None, least: float | None, highest: float | None) -> str | None:
    """Return the speeds in a block and what its spectra are over, or why there is no angle.

    None of a machine without a source of one.

    Args:
        status, domain: ``rotation_status`` and ``domain`` of its record.
        least, highest: speed, Hz.
    """
    if status is None:
        return None
    if status != "ok":
        return f"no angle of the shaft: {ROTATION_REFUSALS.get(status, status)}; {DOMAINS['hertz']}"
    spectra = DOMAINS.get(domain or "hertz", "")
    if least is None or highest is None:
        return spectra
    return f"{range_words(least, highest)} in this block; {spectra}"


def range_words(least: float, highest: float) -> str:
    """Return the speeds, Hz, as "speed from 22.1 to 27.9 Hz", or as one where three figures are the same."""
    low, high = f"{least:.3g}", f"{highest:.3g}"
    return f"speed {low} Hz" if low == high else f"speed from {low} to {high} Hz"
