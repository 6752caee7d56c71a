"""Validation problems in words: the key as in the file, the value found, the values allowed."""

from __future__ import annotations

import difflib
from typing import Any, get_args

from pydantic import BaseModel, ValidationError


def explain_all(error: ValidationError, root: type[BaseModel]) -> list[str]:
    """Return one line for each problem; "list too short" is left out if wrong entries of the list cause it."""
    problems = error.errors()
    return [
        explain(problem, root)
        for problem in problems
        if problem["type"] != "too_short"
        or not any(other is not problem and other["loc"][: len(problem["loc"])] == problem["loc"] for other in problems)
    ]


def explain(problem: Any, root: type[BaseModel]) -> str:
    """Return a line that names the key, the value found and the values allowed.

    ``problem`` is one of the errors of a pydantic ValidationError, ``root`` the model of the whole configuration.
    """
    location = ""
    for part in problem["loc"]:
        if isinstance(part, int):
            location += f"[{part}]"
        elif "[" not in part and part not in {"float", "int", "str", "tuple"} and not part.startswith("literal"):
            location += f".{part}" if location else part
    if problem["type"] == "extra_forbidden":
        known = _keys_at(problem["loc"][:-1], root)
        key = str(problem["loc"][-1])
        near = difflib.get_close_matches(key, known, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        return f"{location}: unknown key{hint} Allowed are {', '.join(sorted(known))}"
    message = problem["msg"].removeprefix("Value error, ")
    if problem["type"] == "missing":
        return f"{location}: is missing"
    if problem["type"] == "value_error" and isinstance(problem["input"], dict):
        name = problem["input"].get("name")
        who = f"{location} ({name})" if name and location else location or "configuration"
        return f"{who}: {message}"
    return f"{location} = {problem['input']!r}: {message}"


def _keys_at(location: tuple[int | str, ...], root: type[BaseModel]) -> list[str]:
    """Return the keys that the table at ``location`` may hold."""
    model = root
    for part in location:
        if isinstance(part, int) or part not in model.model_fields:
            continue
        annotation = model.model_fields[part].annotation
        candidates = [annotation, *get_args(annotation)]
        model = next((c for c in candidates if isinstance(c, type) and issubclass(c, BaseModel)), model)
    return list(model.model_fields)
