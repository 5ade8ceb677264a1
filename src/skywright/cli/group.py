"""How every command behaves: order, errors as one line, exit codes."""

import gc
import os
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

import click

from skywright.cli.options import print_json
from skywright.core.interrupt import listen
from skywright.errors import InfeasibleError, SkywrightError, neighbours

LONGEST = 4000
"""Characters of a message."""


class Group(click.Group):
    """Commands in the order of the contract; every error is one line and an exit code."""

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
        extra |= {"standalone_mode": False, "obj": args}  # a run notes its command
        listen()
        gc.set_threshold(50_000)  # imports make objects, not garbage: looking took a fifth of them
        try:
            code = super().main(args, *more, **extra)
        except BaseException as error:
            code = _report(error, as_json="--json" in args)
        # `python -m` would kill itself with SIGINT at the end where an interrupt went through code
        # that was compiled from text (numba's, pydantic's): running some clears that note.
        exec("pass")
        sys.exit(code if isinstance(code, int) else 0)


def _shorten(message: str) -> str:
    """Cut what a message quotes of a file, so that it stays readable."""
    return message if len(message) <= LONGEST else message[:LONGEST] + " ..."


def _report(error: BaseException, as_json: bool) -> int:
    """Print an error as one line on stderr (and as an object where `--json` asks): exit code."""
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
        code, message = error.exit_code, str(error)
        if isinstance(error, InfeasibleError):
            facts["blocked_by"] = error.blocked_by
    elif isinstance(error, BrokenPipeError):  # the reader of our output went away
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    elif isinstance(error, OSError) and error.filename is not None:
        code, message = 2, f"{error.filename}: {error.strerror}"
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
