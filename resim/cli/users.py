"""`resim users`: who may come into the Supervisor, each with a token of their own."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import app, command
from resim.cli.terminal import add_to_json, say, visible

if TYPE_CHECKING:
    from resim.supervisor.users import Users

users = typer.Typer(
    help="Users of the Supervisor (`resim serve`): each has a name, a role and a token of their own.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.add_typer(users, name="users")


class RoleChoice(StrEnum):
    """Roles of users."""

    administer = "administer"
    run = "run"
    look = "look"


Name = Annotated[str, typer.Argument(metavar="NAME", help="Up to 40 letters, digits, _ and -.")]


@command(users)
def add(
    name: Name,
    role: Annotated[
        RoleChoice,
        typer.Option(
            help="look: see all; run: start and stop tasks, too; administer: see who did what, too."
        ),
    ] = RoleChoice.look,
) -> None:
    """Add a user, and print the token, once: it is kept nowhere. Who may run may run code on this machine."""
    from resim.results.audit import noted_command

    with noted_command("/users/add", [("name", name), ("role", role.value)]):
        token = _users().add(name, role.value)
    add_to_json(name=name, role=role.value, token=token)
    say(token)


@command(users, name="list")
def list_() -> None:
    """List users and their roles."""
    found = _users().all()
    add_to_json(users=[{"name": one.name, "role": one.role} for one in found.values()])
    for one in found.values():
        say(f"{one.name}: {one.role}")
    if not found:
        say("nobody; add one: resim users add NAME --role run")


@command(users)
def rm(name: Name) -> None:
    """Remove a user: the token, and all browsers that came in by it, are let in no more."""
    from resim.results.audit import noted_command

    with noted_command("/users/rm", [("name", name)]):
        _users().remove(name)
    say(f"{name}: removed")


def _users() -> Users:
    from resim.results.database import data_folder
    from resim.supervisor.users import USERS, Users

    return Users(data_folder() / USERS)


@command(users)
def trail(
    most: Annotated[int, typer.Option("--most", metavar="N", min=1, help="Lines at most.")] = 50,
) -> None:
    """Print who did what, the newest first: forms that were sent, and commands that steered tasks or users."""
    from resim.results.audit import AUDIT, AuditTrail
    from resim.results.database import data_folder

    lines = AuditTrail(data_folder() / AUDIT).last(most)
    add_to_json(trail=lines)
    for line in lines:
        form = " ".join(f"{name}={value}" for name, value in line["form"])
        who = line.get("user") or "owner"
        say(
            visible(
                f"{line['time']}  {who} from {line['client']}  {line['action']}  {form}: {line['outcome']}"
            )
        )
    if not lines:
        say("nobody did anything yet")
