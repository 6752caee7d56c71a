"""Every path and URL of every command: an empty one, as an unset variable of a shell gives it, is refused by name."""

from __future__ import annotations

from collections.abc import Iterator

import click
import pytest
from click.testing import CliRunner

from monitor.cli import spallwatch
from monitor.commands.option import Place, PlaceOrUrl


def commands(group: click.Group, names: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        if isinstance(command, click.Group):
            yield from commands(command, (*names, name))
        else:
            yield (*names, name), command


PLACES = [
    (names, parameter)
    for names, command in commands(spallwatch)
    for parameter in command.params
    if isinstance(parameter.type, Place | PlaceOrUrl)
]


def test_all_paths_are_such_places() -> None:
    assert len(PLACES) > 60
    for names, command in commands(spallwatch):
        for parameter in command.params:
            assert type(parameter.type) is not click.Path, (names, parameter.name)


def test_an_empty_place_is_refused_by_its_name() -> None:
    # The types alone: no command runs with such a place.
    for names, parameter in PLACES:
        with pytest.raises(click.BadParameter) as error:
            parameter.type.convert("", parameter, None)
        assert "got ''" in error.value.format_message()
        assert not isinstance(parameter, click.Option) or f"'{parameter.opts[0]}'" in error.value.format_message(), (
            names
        )


@pytest.mark.parametrize("text", ["", " "])
def test_the_words(text: str) -> None:
    found = CliRunner().invoke(spallwatch, ["archive", "status", text])
    assert f"Invalid value for 'OUT': expected a path or a URL, got {text!r}" in found.stderr
