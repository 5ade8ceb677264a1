"""Common behaviour of all commands: order, errors in one line, exit codes."""

import gc
import os
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

import click

from skywright.cli.options import print_json
from skywright.core.interrupt import listen
from skywright.errors import InfeasibleError, SkywrightError, describe_os_error, neighbours

LONGEST = 4000
"""Longest message, in characters."""


class Group(click.Group):
    """Commands in a fixed order; every error is one line and an exit code."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and args[0] not in self.commands and not args[0].startswith("-"):
            valid = neighbours(args[0], self.commands, count=len(self.commands))
            raise click.UsageError(f"unknown command {args[0]!r}; valid: {valid}")
        return super().resolve_command(ctx, args)

    def main(self, args: Sequence[str] | None = None, *more: Any, **extra: Any) -> NoReturn:
        args = list(sys.argv[1:] if args is None else args)
        extra |= {"standalone_mode": False, "obj": args}  # the command line is recorded in a run
        listen()
        gc.set_threshold(50_000)  # imports make objects, not garbage: looking took a fifth of them
        try:
            code = super().main(args, *more, **extra)
        except BaseException as error:
            code = _report(error, as_json="--json" in args)
        # After an interrupt in code compiled from text (numba, pydantic), `python -m` would end
        # itself with SIGINT. Executing a text resets that state.
        exec("pass")
        sys.exit(code if isinstance(code, int) else 0)


def _shorten(message: str) -> str:
    """Shorten a message, because it may quote a long file."""
    return message if len(message) <= LONGEST else message[:LONGEST] + " ..."


def _report(error: BaseException, as_json: bool) -> int:
    """Print an error as one line on stderr, with `--json` also as an object; return its code."""
    if isinstance(error, SystemExit):
        return error.code if isinstance(error.code, int) else 0 if error.code is None else 2
    if os.environ.get("SKYWRIGHT_DEBUG") and isinstance(error, Exception):
        import traceback

        traceback.print_exc()
    facts: dict[str, Any] = {}
    if isinstance(error, click.exceptions.NoArgsIsHelpError):
        click.echo(error.format_message())
        return 0
    if isinstance(error, click.Abort | KeyboardInterrupt):
        code, message = 1, "interrupted"
    elif isinstance(error, click.ClickException):
        code, message = 2, error.format_message()
        command = getattr(getattr(error, "ctx", None), "command_path", "skywright")
        message = f"{message.rstrip('.')} (see {command} --help)"
    elif isinstance(error, SkywrightError):
        code, message = error.exit_code, getattr(error, "with_options", "") or str(error)
        if isinstance(error, InfeasibleError):
            facts["blocked_by"] = error.blocked_by
    elif isinstance(error, BrokenPipeError):  # the reader of the output has closed the pipe
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    elif isinstance(error, OSError) and (found := describe_os_error(error)):
        code, message = 2, found
    else:
        code = 3
        message = (
            f"internal error, please report: {type(error).__name__}: {error} "
            "(SKYWRIGHT_DEBUG=1 shows where)"
        )
    message = _shorten(" ".join(message.split()))
    click.echo(f"skywright: {message}", err=True)
    if as_json:
        print_json({"error": message, "exit_code": code, **facts})
    return code
