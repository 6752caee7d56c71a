"""What is known of a rig's numbers, and what an uncalibrated one means for V_eq and TT, as text for people."""

from __future__ import annotations

from models.machine.rig import Rig, RigParameters

RELATIVE = "V_eq is shown as a multiple of its first value"
_NOT_ISSUED = "TT to a threshold in mm3/mm is not issued"
_HASH_CHARACTERS = 16
ASSUMED = "not given in [rig], so that the default test bench's are taken (thesis, Table 18)"
"""Follows the names of such keys of ``[rig]``."""


def rig_words(rig: RigParameters) -> str:
    """Return what vouches for a rig's numbers, or whose they are where nothing does.

    A model other than that of the casing is named.
    """
    if not isinstance(rig, Rig):
        vouched = "declared, not identified" if rig.calibrated == "declared" else "not calibrated on this machine"
        return f"of the model {rig.model}, {vouched}"
    if rig.calibrated == "declared":
        return "declared, not identified"
    if rig.calibrated:
        return "calibrated" + (
            f" (identification {rig.identification[:_HASH_CHARACTERS]})" if rig.identification else ""
        )
    if rig.is_default_bench:
        return "not calibrated: masses and springs are those of the default test bench (thesis, Table 18)"
    return "not calibrated on this machine"


def rig_line(rig: RigParameters) -> str:
    """Return one line on a rig for the console: what vouches for it, and what follows where nothing does."""
    return f"rig {rig_words(rig)}" + ("" if rig.calibrated else f"; {RELATIVE}")


def uncalibrated_sentence(rig: RigParameters | str, *, issued: bool) -> str:
    """Return why V_eq of a channel is uncalibrated, and what follows; ``issued``: TT is given all the same.

    ``rig`` is the one that is not calibrated, or another reason.
    """
    why = rig if isinstance(rig, str) else f"the rig is {rig_words(rig)}"
    return f"V_eq is uncalibrated, as {why}; {RELATIVE}" + ("" if issued else f", and {_NOT_ISSUED}")
