"""Problems of a configuration in words: where, what came, what was expected, what to write; names that lead nowhere."""

from __future__ import annotations

import copy
import difflib
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel, ValidationError

from monitor.config.fields import LocatedError
from monitor.config.hints import TABLES, shown, unknown_key, wrong_value
from monitor.config.positions import Place

_SIMPLE = {"bool", "float", "int", "str", "tuple"}
_WORDS = {
    "Input should be a valid tuple": "expected a list",
    "Input should be a valid dictionary": "expected a table",
    "Input should be a valid string": "expected a text in quotes",
    "Input should be a valid boolean": "expected true or false",
    "Input should be a valid number": "expected a number",
    "Input should be a valid integer": "expected a whole number",
    "Input should be a valid datetime": "expected a date and time such as 2026-01-31T08:00:00Z",
    "Input should be a valid path": "expected a path in quotes",
    "Input is not a valid path": "expected a path in quotes",
}
_NAME_PATTERN = "[A-Za-z0-9][A-Za-z0-9_.-]{0,63}"
_REPLACED = {"unit": "unknown"}
"""Required keys that are replaced, so that the rest of their table can be checked."""
_NAME = "expected a name of up to 64 letters, digits, _ . and -, beginning with a letter or digit"


def explain_problems(error: ValidationError, root: type[BaseModel]) -> list[tuple[Place, str]]:
    """Return a line for each problem, with the place that it is about.

    Args:
        error: of the validation of ``root``, the model of the whole configuration.
    """
    problems: dict[Place, list[Any]] = {}
    for problem in error.errors():
        problems.setdefault(_place(problem), []).append(problem)
    found: list[tuple[Place, str]] = []
    for place, group in problems.items():
        deeper = any(len(other) > len(place) and other[: len(place)] == place for other in problems)
        if deeper and all(problem["type"] != "value_error" for problem in group):
            # The entries of a list say more than "not this list, nor one of these words".
            continue
        found += _explained(place, group, root)
    return found


def further_problems(
    error: ValidationError, values: Mapping[str, Any], root: type[BaseModel]
) -> list[tuple[Place, str]]:
    """Return the problems that show once the wrong keys of a first validation are left out.

    A table with a wrong key is not checked as a whole, nor are bands against rates; what follows from a key that was
    left out is not a problem of its own, and an unknown key may be any key of its table.
    """
    left = copy.deepcopy(dict(values))
    unclear = [_place(problem)[:-1] for problem in error.errors() if problem["type"] == "extra_forbidden"]
    removed = {key for problem in error.errors() if (key := _leave_out(left, _place(problem))) is not None}
    try:
        root.model_validate(left)
    except ValidationError as second:
        known = {text for _, text in explain_problems(error, root)}
        return [
            (place, text)
            for place, text in explain_problems(second, root)
            if text not in known
            and "is missing" not in text
            and not any(key in text for key in removed)
            and not any(table and place[: len(table)] == table for table in unclear)
        ]
    return []


def _leave_out(values: dict[str, Any], place: Place) -> str | None:
    """Remove the key that a place is about from its table; return its name, None where there is none such."""
    table: Any = values
    chosen: tuple[dict[str, Any], str] | None = None
    for part in place:
        if isinstance(table, dict) and isinstance(part, str) and part in table:
            chosen = (table, part)
            table = table[part]
        elif isinstance(table, list) and isinstance(part, int) and part < len(table):
            table = table[part]
        else:
            break
    if chosen is None:
        return None
    container, key = chosen
    value = container[key]
    if isinstance(value, dict) or (isinstance(value, list) and value and isinstance(value[0], dict)):
        return None
    if key in _REPLACED:
        container[key] = _REPLACED[key]
    else:
        del container[key]
    return key


def place_words(place: Place) -> str:
    """Return a place as ``channel[0].unit``."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in place).removeprefix(".")


def _place(problem: Any) -> Place:
    """Return the place of a problem without the branches of unions that pydantic names in it."""
    *location, last = problem["loc"] or ("",)
    kept = [part for part in location if isinstance(part, int) or not _is_branch(part)]
    if last != "" and (problem["type"] == "extra_forbidden" or isinstance(last, int) or not _is_branch(last)):
        kept.append(last)
    return tuple(kept)


def _is_branch(part: str) -> bool:
    return "[" in part or part in _SIMPLE or part.startswith(("literal", "constrained", "lax-or", "function"))


def _explained(place: Place, group: Sequence[Any], root: type[BaseModel]) -> Iterator[tuple[Place, str]]:
    first = group[0]
    where = place_words(place)
    section, key = _section_and_key(place)
    if first["type"] == "extra_forbidden":
        known = list(_model_at(place[:-1], root).model_fields)
        hint = unknown_key(section, key, first["input"], known, _all_keys(root))
        is_table = isinstance(first["input"], dict) or shown(first["input"]).startswith(("{", "[{"))
        came = "" if is_table else f" = {shown(first['input'])}"
        advice = f"; {hint}{'' if hint.endswith('?') else '.'}" if hint else "."
        yield place, f"{where}{came}: unknown key{advice} Allowed are {', '.join(sorted(known))}"
        return
    if first["type"] == "missing":
        yield place, f"{where}: is missing; expected {_expected_at(place, root)}"
        return
    if first["type"] == "value_error":
        for problem in group:
            yield from _of_section(place, problem)
        return
    expected = list(dict.fromkeys(_expectation(problem) for problem in group))
    words = expected[0] + "".join(f" or {other.removeprefix('expected ')}" for other in expected[1:])
    hint = wrong_value(section, key, first["input"])
    came = ", found a table" if isinstance(first["input"], dict) else ""
    where += "" if came else f" = {first['input']!r}"
    yield place, f"{where}: {words}{came}" + (f"; {hint}" if hint else "")


def _of_section(place: Place, problem: Any) -> Iterator[tuple[Place, str]]:
    """Yield the problems that the validator of a table or a key has raised."""
    error, table = problem["ctx"].get("error"), problem["input"]
    where = place_words(place)
    if isinstance(error, LocatedError):
        for inner, text in error.problems:
            whole = (*place, *inner)
            yield whole, f"{place_words(whole)}: {text}"
        return
    message = problem["msg"].removeprefix("Value error, ")
    if not isinstance(table, dict):
        yield place, f"{where} = {table!r}: {message}"
        return
    named = [word for word in dict.fromkeys(re.findall(r"[a-z][a-z0-9_]+", message)) if word in table]
    name = table.get("name")
    who = f"{where} ({name})" if name and where else where or "configuration"
    came = "" if "found" in message else ", ".join(f"{key} = {shown(table[key])}" for key in named)
    yield (*place, named[0]) if named else place, f"{who}: {message}" + (f"; found {came}" if came else "")


def _expectation(problem: Any) -> str:
    message, kind = problem["msg"], problem["type"]
    if kind == "string_pattern_mismatch" and _NAME_PATTERN in message:
        return _NAME
    for words, own in _WORDS.items():
        if message.startswith(words):
            return own
    if kind == "too_short":
        minimum = problem["ctx"]["min_length"]
        return f"expected at least {minimum} {'entry' if minimum == 1 else 'entries'}"
    if kind == "too_long":
        return f"expected at most {problem['ctx']['max_length']} entries"
    return (
        re.sub(r"^Input should be (?=greater|less|finite|a finite)", "expected a number ", message)
        .replace("Input should be", "expected")
        .replace("a number a finite number", "a finite number")
    )


def _section_and_key(place: Place) -> tuple[str, str]:
    """Return the section of a place without indices, and its last key."""
    keys = [part for part in place if isinstance(part, str)]
    return ".".join(keys[:-1]), keys[-1] if keys else ""


def _model_at(place: Place, root: type[BaseModel]) -> type[BaseModel]:
    """Return the model of the table at a place."""
    model = root
    for part in place:
        if isinstance(part, int) or part not in model.model_fields:
            continue
        candidates = _branches(model.model_fields[part].annotation)
        model = next((c for c in candidates if isinstance(c, type) and issubclass(c, BaseModel)), model)
    return model


def _branches(annotation: Any) -> list[Any]:
    """Return an annotation and all within it."""
    return [annotation, *(inner for item in get_args(annotation) for inner in _branches(item))]


def _all_keys(root: type[BaseModel]) -> Mapping[str, Sequence[str]]:
    """Return the keys of each section."""
    return {name: list(_model_at((name,), root).model_fields) for name in root.model_fields}


def _expected_at(place: Place, root: type[BaseModel]) -> str:
    """Return in words what a missing key holds."""
    key = str(place[-1])
    table = ".".join(str(part) for part in place if isinstance(part, str))
    if len(place) == 1 or table in TABLES:
        return f"at least one [[{table}]]"
    field = _model_at(place[:-1], root).model_fields.get(key)
    branches = [] if field is None else _branches(field.annotation)
    choices = [choice for branch in branches if get_origin(branch) is Literal for choice in get_args(branch)]
    if choices:
        words = "; spallwatch init FOLDER says what the files state" if key == "unit" else ""
        return " or ".join(shown(choice) for choice in choices) + words
    if key in ("source", "bearing"):
        return f"the name of a [[{key}]]"
    return "a name of letters and digits" if key == "name" else "a value"


def find_loose_ends(values: Mapping[str, Any]) -> Iterator[tuple[Place, str]]:
    """Yield the place of each name that is given twice or leads nowhere, and what was expected.

    ``values`` are the tables as parsed; those of the wrong kind are left to their own validation.
    """
    names: dict[str, list[str]] = {}
    for key in ("bearing", "source", "channel"):
        names[key] = []
        for index, table in _tables(values, key):
            name = table.get("name")
            if not isinstance(name, str):
                continue
            if name in names[key]:
                yield (key, index, "name"), f"[[{key}]] name {name!r} is given twice; expected one of its own"
            names[key].append(name)
    for index, table in _tables(values, "channel"):
        for key in ("source", "bearing"):
            yield from _leads(("channel", index, key), table.get(key), names[key], f"channel {table.get('name')!r}: ")
    for section, key in (("rig", "bearing"), ("shaft", "second_bearing")):
        table = values.get(section)
        found = table.get(key) if isinstance(table, Mapping) else None
        yield from _leads((section, key), found, names["bearing"], f"[{section}] ")


def _tables(values: Mapping[str, Any], key: str) -> Iterator[tuple[int, Mapping[str, Any]]]:
    """Yield the tables of an array of tables with their index."""
    found = values.get(key)
    for index, table in enumerate(found) if isinstance(found, list | tuple) else ():
        if isinstance(table, Mapping):
            yield index, table


def _leads(place: Place, name: Any, known: list[str], who: str) -> Iterator[tuple[Place, str]]:
    """Yield a name that is none of the known ones; without any, the missing section is the problem."""
    if not isinstance(name, str) or not known or name in known:
        return
    yield place, f"{who}{place[-1]} {lost_name(name, known)}"


def lost_name(name: str, known: Sequence[str]) -> str:
    """Return in words that a name is none of the known ones, with the one that is probably meant."""
    near = difflib.get_close_matches(name, known, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"{name!r} is not one of {', '.join(sorted(known))}{hint}"
