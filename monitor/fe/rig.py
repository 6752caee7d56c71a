"""``spallwatch bearing --fe --write-rig FILE``: the keys of ``[rig]`` that finite elements give, and their spread."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from models.fe.bearings.rig import EffectiveStiffness
from monitor.config.bearing import RIG_KEYS, STIFFNESS_KEYS


def rig_text(bearing: str, element: str, k_c: EffectiveStiffness | None, shaft: dict[str, Any] | None) -> str:
    """Return a ``[rig]`` table as TOML.

    Args:
        bearing: name of the bearing in the configuration.
        element: "ball" or "roller".
        k_c: of the bearing; None leaves the key out.
        shaft: what ``monitor.fe.shaft.shaft_values`` found; None leaves k_i out.

    Raises:
        ValueError: there is nothing to write, or the shaft did not settle.
    """
    lines = [*_contact_lines(element, k_c), *_shaft_lines(shaft)]
    if not lines:
        raise ValueError("[rig]: neither a bearing nor a shaft of finite elements to write")
    return "\n".join(
        ["# From finite elements (spallwatch bearing --fe).", "[rig]", f'bearing = "{bearing}"', *lines, ""]
    )


def _contact_lines(element: str, k_c: EffectiveStiffness | None) -> Iterator[str]:
    if k_c is None:
        return
    percent = 100.0 * k_c.spread
    mesh = "not known" if k_c.mesh_error != k_c.mesh_error else f"{100.0 * k_c.mesh_error:.2g} %"
    loads = [load for _, load, _ in k_c.matched]
    yield (
        f"# k_c of the law Q = k delta^{'1.5' if element == 'ball' else '(10/9)'} with the mean stiffness along a load "
        f"of {k_c.load:g} N;"
    )
    yield (
        f"# {k_c.low:.5g} to {k_c.high:.5g} match k_xx, k_yy or the displacement from {min(loads):g} to "
        f"{max(loads):g} N; standard deviation {percent:.2g} %, of it mesh {mesh}."
    )
    yield f"# Its spread in maps: spallwatch map build --rig-draws 16 --rig-spread-k-c {k_c.spread:.3f}"
    yield f"{STIFFNESS_KEYS[element]} = {k_c.value:.6g}"


def _shaft_lines(shaft: dict[str, Any] | None) -> Iterator[str]:
    if shaft is None:
        return
    if shaft["status"] != "converged":
        raise ValueError(f"[rig]: the shaft is {shaft['status']}; k_i is not written")
    over = shaft["against_load"]
    stiffness = [one["k_i_newton_per_m"] for one in over]
    loads = [one["load_newton"] for one in over]
    yield (
        f"# k_i of the end of the shaft under {shaft['load_newton']:g} N; {min(stiffness):.4g} to {max(stiffness):.4g} "
        f"from {loads[0]:g} to {loads[-1]:g} N, mesh error {shaft['mesh_error_percent']:.2g} %."
    )
    yield f"{RIG_KEYS['k_i']} = {shaft['k_i_newton_per_m']:.6g}"
