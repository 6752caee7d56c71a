"""Lines of a configuration that are not valid TOML, all at once."""

from __future__ import annotations

import re
import tomllib

from monitor.config.hints import syntax_hint

_MAX_LINES = 20
_WHERE = re.compile(r" \(at (?:line (\d+), column \d+|end of document)\)$")


def syntax_problems(text: str, message: str) -> list[str]:
    """Return ``LINE: problem`` for each line of a text that is not valid TOML.

    A line is left out once it is known to be wrong, so that the next one can be found.

    Args:
        message: of the parser for the whole text.
    """
    lines = text.splitlines() or [""]
    left, found = list(lines), dict[int, str]()
    headless = False
    while message and len(found) < _MAX_LINES:
        where = _WHERE.search(message)
        line = len(lines) if where is None or where[1] is None else min(int(where[1]), len(lines))
        if line in found:
            break
        written = lines[line - 1].strip()
        # Without a header, its keys stand in the section above, where they may be given twice.
        if not (headless and "overwrite" in message):
            reason = message if where is None else message[: where.start()]
            hint = syntax_hint(written, message)
            found[line] = f"not valid TOML: {reason}, found {written[:80]!r}{f'; {hint}' if hint else ''}"
        headless = headless or written.startswith("[")
        if not left[line - 1]:
            break
        left[line - 1] = ""
        message = _message(left)
    return [f"{line}: {found[line]}" for line in sorted(found)]


def _message(lines: list[str]) -> str:
    """Return what the parser says of lines, "" where they are valid."""
    try:
        tomllib.loads("\n".join(lines) + "\n")
    except tomllib.TOMLDecodeError as error:
        return str(error)
    return ""
