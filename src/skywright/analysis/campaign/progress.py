"""Progress of a campaign on standard error."""

import time

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from skywright.reports.terminal import new_console
from skywright.run.rows import Row

LINE_S = 30.0
"""Interval (s) between two lines if standard error is not a terminal."""


class CampaignProgress:
    """A progress bar on a terminal, else a line every LINE_S; `quiet` writes nothing."""

    def __init__(self, runs: int, done: int, failed: int, *, quiet: bool = False) -> None:
        """`done` runs, `failed` of them failed, exist from an earlier call."""
        self._console = new_console(stderr=True)
        self._quiet, self._runs, self._done, self._failed = quiet, runs, done, failed
        self._told = time.perf_counter()
        self._bar: Progress | None = None
        if quiet:
            return
        if done:
            self.say(f"{done} of {runs} runs are there already")
        if self._console.is_terminal:
            self._bar = Progress(
                TextColumn("{task.completed:.0f} of {task.total:.0f} runs"),
                BarColumn(bar_width=30),
                TextColumn("{task.fields[failed]} failed"),
                TimeRemainingColumn(compact=True),
                console=self._console,
                transient=True,
            )
            self._task = self._bar.add_task("", total=runs, completed=done, failed=failed)
            self._bar.start()

    def say(self, text: str) -> None:
        """Write one line."""
        if not self._quiet:
            self._console.print(text)

    def on_row(self, row: Row) -> None:
        """Count a finished run and update the display."""
        self._done += 1
        self._failed += not row.succeeded
        if self._quiet:
            return
        if row.attempts > 1:
            self.say(f"run {row.run}: a worker process died, flown again")
        if self._bar is not None:
            self._bar.update(self._task, completed=self._done, failed=self._failed)
        elif time.perf_counter() - self._told > LINE_S:
            self._told = time.perf_counter()
            self.say(f"{self._done} of {self._runs} runs, {self._failed} failed")

    def close(self) -> None:
        """Remove the bar."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None
