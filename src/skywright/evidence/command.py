"""Commands of the modules: `python -m skywright.evidence.NAME` reports an error in one line."""

from __future__ import annotations

import sys
from typing import Any

import click

from skywright.errors import SkywrightError, describe_os_error


class Command(click.Command):
    """A command whose input errors are one line on stderr, with the exit code of `skywright`."""

    def main(self, *args: Any, **extra: Any) -> Any:
        """Run the command; `args` and `extra` are those of click."""
        try:
            return super().main(*args, **extra)
        except SkywrightError as error:
            code, message = error.exit_code, str(error)
        except OSError as error:
            code, message = 2, describe_os_error(error) or ""
            if not message:
                raise
        click.echo(f"{self.name}: {message}", err=True)
        sys.exit(code)
