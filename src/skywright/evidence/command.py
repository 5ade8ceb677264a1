"""Commands of the modules: `python -m skywright.evidence.NAME` reports an error in one line."""

from __future__ import annotations

import sys
from typing import Any, NoReturn

import click

from skywright.errors import SkywrightError


class Command(click.Command):
    """A command whose input errors are one line on stderr, with the exit code of `skywright`."""

    def main(self, *args: Any, **extra: Any) -> NoReturn:
        """Run the command; `args` and `extra` are those of click."""
        try:
            super().main(*args, **extra)
        except SkywrightError as error:
            click.echo(f"{self.name}: {error}", err=True)
            sys.exit(error.exit_code)
        sys.exit(0)
