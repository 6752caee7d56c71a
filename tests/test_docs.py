"""The documents: links resolve, keys, commands and options exist in the program, user pages stay short."""

from __future__ import annotations

import re
import runpy
import tomllib
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from monitor.cli import spallwatch
from monitor.config.load import Config
from tests.support.docs import DOCS, FOR_USERS, ROOT, missing_tests, read, sentences

MAX_WORDS_FOR_USERS = 34_830
PAGES = sorted([*DOCS.rglob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"])


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page: those of its headings, and explicit ones."""
    titles = re.findall(r"^#+ (.*)$", read(page), re.MULTILINE)
    from_titles = {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}
    return from_titles | set(re.findall(r'<a id="([^"]+)">', read(page)))


def commands(group: click.Group = spallwatch) -> Iterator[click.Command]:
    """Yield all commands, those of groups too."""
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        yield command
        if isinstance(command, click.Group):
            yield from commands(command)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    for target, anchor in re.findall(r"\]\(([^)#\s]*)(?:#([^)]*))?\)", read(page)):
        if "://" in target:
            continue
        found = page if not target else (page.parent / target).resolve()
        assert found.exists(), target
        assert not anchor or anchor in anchors(found), f"{target}#{anchor}"


def test_paths_in_the_documents_exist() -> None:
    missing = {
        f"{page.relative_to(ROOT)}: {path}"
        for page in PAGES
        for path in re.findall(r"`((?:models|streams|monitor|tests|benchmarks|deploy|docs)/[\w/.-]*\w/?)`", read(page))
        if "NAME" not in path and not (ROOT / path).exists()
    }
    assert sorted(missing) == []


def test_pages_for_users_are_short_and_listed() -> None:
    index = DOCS / "README.md"
    pages = [index, *(page for folder in FOR_USERS for page in (DOCS / folder).glob("*.md"))]
    assert sum(len(read(page).split()) for page in pages) <= MAX_WORDS_FOR_USERS
    listed = set(re.findall(r"\]\(([^)#]+)\)", read(index)))
    folders = (*FOR_USERS, "evidence")
    assert {f"{folder}/{page.name}" for folder in folders for page in (DOCS / folder).glob("*.md")} <= listed


def test_each_promise_of_the_threat_model_names_tests_that_there_are() -> None:
    text = read(DOCS / "explanation" / "threat-model.md")
    promised = text.partition("## Promised")[2].partition("## Not promised")[0]
    # A promise ends with its tests; a head of further ones has none of its own.
    items = [item for item in re.split(r"^ *- ", promised, flags=re.MULTILINE)[1:] if not item.strip().endswith("**")]
    assert len(items) >= 12
    assert [item for item in items if not re.search(r"`(?:tests|benchmarks)/[\w/]+\.py::test_\w+`[.;,]", item)] == []
    assert missing_tests(re.findall(r"`(tests/[\w/]+\.py::test_\w+)`", text)) == []


def test_each_sentence_about_the_daemon_has_its_tests_and_its_figures() -> None:
    proofs = tomllib.loads(read(ROOT / "tests" / "support" / "daemon_sentences.toml"))["sentence"]
    said = list(sentences(read(DOCS / "reference" / "daemon.md")))
    assert len(said) > 50
    # Each is there once, in the order of the page.
    assert [proof["says"] for proof in proofs] == said
    assert [proof["says"] for proof in proofs if not proof["tests"]] == []
    assert missing_tests(test for proof in proofs for test in proof["tests"]) == []
    figures = [tuple(figure) for proof in proofs for figure in proof.get("figures", ())]
    # Run anew, as quick effort shortens those of the modules that are loaded.
    modules = {file: runpy.run_path(str(ROOT / file)) for file in sorted({file for file, *_ in figures})}
    assert [figure for figure in figures if modules[figure[0]].get(figure[1]) != figure[2]] == []
    page = "# A\n\n- **One** [of](b.md)\n  two. Three.\n\nSee [d](e). Keys:\n\nk | v\n---|---\n`x` | 1\n\nFour.\n"
    assert list(sentences(page)) == ["One of two.", "Three.", "`x` | 1", "Four."]


def test_every_key_of_the_configuration_is_described() -> None:
    named = set(re.findall(r"[a-z0-9_]+", read(DOCS / "reference" / "configuration.md")))
    keys = {key for section in Config.model_json_schema()["$defs"].values() for key in section["properties"]}
    assert sorted(keys - named) == []


def test_every_command_is_described() -> None:
    text = read(DOCS / "reference" / "commands.md")
    top = spallwatch.list_commands(click.Context(spallwatch))
    assert [name for name in top if not re.search(rf"\| `{name}\b", text)] == []


def test_options_in_examples_exist() -> None:
    known = {
        option for command in commands() for item in command.params for option in (*item.opts, *item.secondary_opts)
    }
    for page in PAGES:
        for line in re.findall(r"spallwatch [a-z]+ .*", read(page)):
            for option in re.findall(r"(?<!\S)--[a-z][a-z0-9-]+", line.partition("`")[0]):
                assert option in known, f"{page.name}: {option}"
