"""Every command in README and docs runs: each distinct one of the ```console blocks, once.

`make docs` runs them (`pytest -m docs`), `make test` what is around them. Pages are read in the
order of the navigation; each has a working folder, so that a command may use what an earlier one of
its page wrote, and pages can be shared among processes. `# not run` at the end of a line leaves it
out, `# exits 2` says which exit code it must have (0 without it).

Lines below a command are its output: each must be among the printed lines, in this order, with the
same words, and with numbers that agree within 10 % or two units of the last digit. `...` stands for
lines, or for the rest of a line, that are left out. So a number in a page has a command that prints
it. The numbers of campaigns, which take hours, are in docs/numbers.toml instead.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import click
import pytest
import yaml

from command_server import CommandServer

ROOT = Path(__file__).resolve().parent.parent


class Command(NamedTuple):
    """A command line of a page, its exit code and the lines of its output that the page shows."""

    line: str
    exit_code: int
    page: str
    shown: tuple[str, ...] = ()


def _pages() -> list[Path]:
    """README, then the navigation in its order, then pages outside it."""

    def leaves(node: object) -> list[str]:
        if isinstance(node, str):
            return [node]
        if isinstance(node, dict):
            node = list(node.values())
        assert isinstance(node, list)
        return [leaf for item in node for leaf in leaves(item)]

    nav = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]
    pages = [ROOT / "README.md", *(ROOT / "docs" / name for name in leaves(nav))]
    pages += sorted({*(ROOT / "docs").rglob("*.md")} - {*pages})
    return [page for page in pages if page.exists()]


def parse_commands(text: str, page: str) -> list[Command]:
    """Return the commands of the console blocks in `text`; lines ending in `\\` are joined."""
    commands = []
    for block in re.findall(r"^```console\n(.*?)^```", text, re.M | re.S):
        for part in re.split(r"^\$ ", block.replace("\\\n", " "), flags=re.M)[1:]:
            line, *shown = part.splitlines()
            command, _, comment = line.partition("  #")
            if "not run" in comment:
                continue
            code = re.search(r"exits (\d)", comment)
            lines = tuple(x.strip() for x in shown if x.strip() not in ("", "..."))
            commands.append(
                Command(command.strip(), int(code.group(1)) if code else 0, page, lines)
            )
    return commands


NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def is_line(shown: str, printed: str) -> bool:
    """Whether a printed line is the one that a page shows, but for the last digits of numbers."""
    cut = shown.endswith("...")
    words, printed_words = (
        " ".join(NUMBER.sub("0", text.removesuffix("...")).split()) for text in (shown, printed)
    )
    if not (printed_words.startswith(words) if cut else printed_words == words):
        return False
    for a, b in zip(NUMBER.findall(shown), NUMBER.findall(printed), strict=False):
        digit = 10.0 ** -len(a.partition("e")[0].partition(".")[2])
        if abs(float(a) - float(b)) > max(0.1 * abs(float(a)), 2.01 * digit if "." in a else 0.0):
            return False
    return True


def find_missing(shown: tuple[str, ...], printed: list[str]) -> str:
    """Return the first line of `shown` that is not printed after the ones before it, or ""."""
    rest = iter(printed)
    for line in shown:
        if not any(is_line(line, other) for other in rest):
            return line
    return ""


def _distinct() -> list[Command]:
    seen: dict[str, Command] = {}
    for page in _pages():
        name = page.relative_to(ROOT).as_posix()
        for command in parse_commands(page.read_text(encoding="utf-8"), name):
            seen.setdefault(command.line, command)
            if command.shown:
                SHOWN.setdefault(command.line, []).append(command)
    return list(seen.values())


SHOWN: dict[str, list[Command]] = {}
"""Command line -> where pages show its output."""


COMMANDS = _distinct()


def test_parse_commands() -> None:
    text = (
        "```console\n$ skywright list robots\nothex\n$ skywright run x   # exits 2\n"
        "$ skywright run y --view  # not run\n$ skywright plan z \\\n  --seed 3\n```\n"
        "```sh\n$ skywright ignored\n```\n"
    )
    assert parse_commands(text, "p") == [
        Command("skywright list robots", 0, "p", ("othex",)),
        Command("skywright run x", 2, "p"),
        Command("skywright plan z    --seed 3", 0, "p"),
    ]


def test_shown_output_is_compared() -> None:
    printed = ["Plan", "│ duration │ 12.9 s │", "│ clearance │ 0.3 m │", "report.html"]
    assert not find_missing(("│ duration │  12.1 s │", "report.html"), printed)
    assert not find_missing(("│ duration ...", "│ clearance │ 0.31 m │"), printed)
    for wrong in (("│ duration │ 15.1 s │",), ("report.html", "Plan"), ("│ time │ 12.9 s │",)):
        assert find_missing(wrong, printed) == wrong[-1]


def test_the_readme_has_commands() -> None:
    assert any(command.page == "README.md" for command in COMMANDS)


def test_reference_names_every_command_and_option() -> None:
    from skywright.cli import main

    page = (ROOT / "docs" / "reference" / "command-line.md").read_text(encoding="utf-8")
    missing = []
    commands = dict(main.commands)
    for name, group in main.commands.items():
        if isinstance(group, click.Group):
            commands |= {f"{name} {inner}": c for inner, c in group.commands.items()}
    for name, command in commands.items():
        if not re.search(rf"`skywright {name}\b", page):
            missing.append(name)
        for option in command.params:
            if isinstance(option, click.Option):
                missing += [
                    f"{name} {flag}"
                    for flag in option.opts
                    if flag.startswith("--") and not re.search(rf"`{flag}\b", page)
                ]
    assert not missing, f"not in docs/reference/command-line.md: {missing}"


def test_reference_and_help_name_every_word_of_list_and_new() -> None:
    from skywright.cli import main
    from skywright.cli.describe import PARTS
    from skywright.description.template import list_templates

    page = (ROOT / "docs" / "reference" / "command-line.md").read_text(encoding="utf-8")
    for name, words in (("list", PARTS), ("new", list_templates())):
        row = next(line for line in page.splitlines() if line.startswith(f"| `skywright {name} ")
                   and words_of(line) & set(words))  # fmt: skip
        assert set(words) <= words_of(row), name
        assert set(words) <= words_of(str(main.commands[name].help)), name


def words_of(text: str) -> set[str]:
    return set(re.findall(r"[a-z-]+", text))


def test_a_command_of_the_server_is_that_of_a_process(
    commands: CommandServer, tmp_path: Path
) -> None:
    """Output, messages and exit codes are the same; a failed command leaves the server as it is."""
    for words in (["list", "robots"], ["list", "robot"], ["check", "othex"]):
        alone = subprocess.run(
            [sys.executable, "-m", "skywright", *words],
            cwd=tmp_path, capture_output=True, text=True, check=False,
            env={**os.environ, "COLUMNS": "100"},
        )  # fmt: skip
        ours = commands.run(words, tmp_path, COLUMNS="100")
        assert (ours.returncode, ours.stdout) == (alone.returncode, alone.stdout), words
        assert ours.stderr == alone.stderr.replace("python -m skywright", "skywright"), words


@pytest.mark.docs
@pytest.mark.parametrize("page", list(dict.fromkeys(command.page for command in COMMANDS)))
def test_commands_of_the_page(page: str, tmp_path: Path, commands: CommandServer) -> None:
    shutil.copytree(ROOT / "examples", tmp_path / "examples")  # as a reader of the docs has them
    failed = [run(c, tmp_path, commands) for c in COMMANDS if c.page == page]
    assert not any(failed), "\n\n".join(filter(None, failed))


def run(command: Command, folder: Path, commands: CommandServer) -> str:
    """Run a command of a page; returns what is wrong, or ""."""
    words = shlex.split(command.line)
    if words[0] == "skywright":
        out = commands.run(words[1:], folder, COLUMNS="100")
    elif words[0] == "python":  # the interpreter of the tests, whatever is first on the path
        out = subprocess.run(
            [sys.executable, *words[1:]],
            cwd=folder, capture_output=True, text=True, timeout=600, check=False,
            env={**os.environ, "COLUMNS": "100"},
        )  # fmt: skip
    else:
        return f"{command.page}: only skywright and python are run: {command.line}"
    said = f"{out.stdout[-2000:]}\n{out.stderr[-2000:]}"
    if out.returncode != command.exit_code or "Traceback" in out.stderr:
        return (
            f"{command.page}: `{command.line}` exits {out.returncode}, "
            f"expected {command.exit_code}\n{said}"
        )
    for other in SHOWN.get(command.line, []):
        if missing := find_missing(other.shown, out.stdout.splitlines()):
            return f"{other.page}: `{command.line}` does not print: {missing}\n{said}"
    return ""
