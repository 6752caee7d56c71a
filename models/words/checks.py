"""Checks of the fields of frozen settings, and of arguments: each raises a ValueError that names the field."""

from __future__ import annotations

import math


def check_numbers(owner: object, prefix: str, rule: str, *names: str) -> None:
    """Raise a ValueError that names a field which breaks a rule: "positive", "not negative" or "finite"."""
    for name in names:
        value = getattr(owner, name)
        met = {"positive": value > 0.0, "not negative": value >= 0.0, "finite": True}[rule]
        if not (met and math.isfinite(value)):
            wanted = {"positive": "positive and finite", "not negative": "finite and not negative"}.get(rule, rule)
            raise ValueError(f"{prefix}{name} must be {wanted}, got {value!r}")


def check_positive(**values: float) -> None:
    """Raise a ValueError that names an argument which is not positive and finite."""
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0.0):
            raise ValueError(f"{name} must be positive and finite, got {value!r}")


def check_choice(value: str, field_name: str, choices: tuple[str, ...]) -> None:
    """Raise a ValueError that names a field whose value is none of the choices."""
    if value not in choices:
        raise ValueError(f"{field_name} must be one of {', '.join(map(repr, choices))}, got {value!r}")


def check_whole(value: float, field_name: str, least: int) -> None:
    """Raise a ValueError that names a field which is not a whole number from ``least`` on."""
    if isinstance(value, bool) or not math.isfinite(value) or value != int(value) or value < least:
        raise ValueError(f"{field_name} must be a whole number of at least {least}, got {value!r}")
