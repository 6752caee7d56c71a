"""``spallwatch user``: who may sign in to the page."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import click

from monitor.commands import option
from monitor.commands.common import InputError, read_config
from monitor.config.load import Config
from monitor.config.outputs import WebSection
from monitor.words.events import local_moment

if TYPE_CHECKING:
    from monitor.web.users import Role

_ROLES = ("viewer", "operator", "admin")
_INVITE_PATH = "#/invite/"


@click.group("user")
def group() -> None:
    """Users of the page: names, roles, passwords."""


def _web_of(config_path: Path | None) -> tuple[WebSection, Path, Config | None]:
    """Return the section of the page, the file of its users, and the machine's configuration; of a fleet, none."""
    from monitor.web.users import USERS_FILE

    if config_path is not None and config_path.is_dir():
        from monitor.config.fleet import load_fleet

        fleet = load_fleet(config_path, strict=False)
        return fleet.web, fleet.web.users_file or fleet.page_dir / USERS_FILE, None
    config = read_config(config_path)
    return config.web, config.web.users_file or config.machine.state_dir / USERS_FILE, config


@group.command("add")
@click.argument("name")
@click.option("--role", type=click.Choice(_ROLES), default="operator")
@click.option(
    "--invite", "invited", is_flag=True, help="Print a code for one sign-in instead of asking for a password."
)
@option.config
@option.output
def add(name: str, role: str, invited: bool, config_path: Path | None, as_json: bool, quiet: bool) -> option.Result:
    """Add the user NAME, or give a known one another role and password.

    The password is asked for twice, or is the first line of standard input where that is no terminal. A viewer reads,
    an operator acknowledges, too, an admin invites users, too. A running page knows the change at once.
    """
    from monitor.web.passwords import check_new_password, hash_password
    from monitor.web.users import User, changed_users, check_name

    _, path, _ = _web_of(config_path)
    try:
        check_name(name)
        stored = None if invited else hash_password(check_new_password(_ask()))
    except ValueError as error:
        raise InputError(str(error)) from None
    with changed_users(path) as users:
        known = users.get(name)
        user = replace(known or User(name, "viewer"), role=cast("Role", role))
        users[name] = user if stored is None else replace(user, password=stored, invite="", invite_until=0.0)
    values = {"name": name, "role": role, "file": str(path), "new": known is None}
    lines = [] if quiet else [f"{'added' if known is None else 'changed'}: {name}, {role} ({path})"]
    return values, [*lines, *(_invitation(name, config_path)[1] if invited and not as_json else ())]


def _ask() -> str:
    if sys.stdin.isatty():
        return str(click.prompt("Password", hide_input=True, confirmation_prompt="The same again", err=True))
    return sys.stdin.readline().rstrip("\r\n")


@group.command("invite")
@click.argument("name")
@option.config
@option.output
def invite_command(name: str, config_path: Path | None) -> option.Result:
    """Print a link and a code with which NAME sets a password, once, within a day."""
    return _invitation(name, config_path)


def _invitation(name: str, config_path: Path | None) -> tuple[dict[str, Any], list[str]]:
    """Invite a user; return the code for programs and for people."""
    from monitor.web.users import invite

    web, path, config = _web_of(config_path)
    code, until = invite(path, name)
    page = None if config is None else config.notify.page_url
    if page is None and web.port:
        page = web.url(web.port)
    link = None if page is None else f"{page.rstrip('/')}/{_INVITE_PATH}{code}"
    zone = "UTC" if config is None else config.machine.timezone
    where = [] if link is None else [f"link: {link}"]
    lines = [*where, f"code: {code}", f"for {name}, once, until {local_moment(until, zone)}"]
    return {"name": name, "code": code, "link": link, "until_utc_s": until}, lines


@group.command("list")
@option.config
@option.output
def list_command(config_path: Path | None) -> option.Result:
    """List the users with their roles."""
    from monitor.web.users import read_users

    _, path, _ = _web_of(config_path)
    found = [
        {"name": user.name, "role": user.role, "password": bool(user.password), "invited": bool(user.invite)}
        for user in read_users(path).values()
    ]
    lines = [
        f"{user['name']}: {user['role']}"
        + ("" if user["password"] else ", no password yet")
        + (", invited" if user["invited"] else "")
        for user in found
    ]
    return {"users": found, "file": str(path)}, lines or [f"no users in {path}"]


@group.command("remove")
@click.argument("name")
@option.config
@option.output
def remove(name: str, config_path: Path | None, quiet: bool) -> option.Result:
    """Remove the user NAME; the sessions of a running page end with the next request."""
    from monitor.web.users import changed_users

    _, path, _ = _web_of(config_path)
    with changed_users(path) as users:
        if name not in users:
            raise InputError(f"{path}: there is no user {name!r}; expected one of {', '.join(users) or 'none so far'}")
        del users[name]
    return {"removed": name, "file": str(path)}, [] if quiet else [f"removed: {name} ({path})"]
