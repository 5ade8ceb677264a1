"""The repository keeps its promises: lock, metadata, links, no traces of a machine."""

from __future__ import annotations

import ast
import functools
import importlib.util
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from importlib import metadata
from pathlib import Path

import pytest
import yaml

from skywright.evidence.reproduce.load import list_papers, load_claims
from skywright.evidence.reproduce.spec import judge

ROOT = Path(__file__).resolve().parent.parent
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = PYPROJECT["project"]
LOCK = (ROOT / "requirements.lock").read_text(encoding="utf-8")
LOCK_RUN = (ROOT / "requirements-run.lock").read_text(encoding="utf-8")
MARKDOWN = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]


def _load_file(path: Path):
    """Import a script that is no part of the package."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _tracked_files() -> list[Path]:
    """Files of the checkout that git knows; of an unpacked archive all but build products."""
    if (ROOT / ".git").exists() and shutil.which("git"):
        out = subprocess.run(
            ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
        )
        return [ROOT / name for name in out.stdout.split("\0") if name and (ROOT / name).is_file()]
    hidden = {".venv", "site", "runs", "__pycache__"}
    return [p for p in ROOT.rglob("*") if p.is_file() and not hidden & set(p.parts)]


def _normalised(requirement: str) -> str:
    name = re.match(r"[A-Za-z0-9._-]+", requirement)
    assert name is not None
    return re.sub(r"[-_.]+", "-", name.group()).lower()


# -- the lock ---------------------------------------------------------------------------------


def test_lock_pins_every_dependency_exactly_with_hashes() -> None:
    flies, tests = PROJECT["dependencies"], PROJECT["optional-dependencies"]["dev"]
    # `make` installs without build isolation, so the build back end must be locked too.
    builds = PYPROJECT["build-system"]["requires"]
    entries = _list_locked(LOCK)
    for file, locked, wanted in (
        ("requirements.lock", entries, [*flies, *builds, *tests]),
        ("requirements-run.lock", _list_locked(LOCK_RUN), [*flies, *builds]),
    ):
        names = set()
        for entry in locked:
            first = entry.splitlines()[0]
            assert re.match(r"[a-z0-9._-]+==[0-9][^ ]* ", first, re.IGNORECASE), first
            assert "--hash=sha256:" in entry, first
            names.add(_normalised(first))
        missing = {_normalised(w) for w in wanted} - names
        assert not missing, f"not in {file}: {missing}; run `make lock`"
    assert set(_list_locked(LOCK_RUN)) < set(entries)  # the same versions for demo and tests


def _list_locked(lock: str) -> list[str]:
    return re.split(r"\n(?=[a-z0-9])", lock.strip(), flags=re.IGNORECASE)


def test_make_lock_resolves_every_extra_but_the_one_with_pytorch() -> None:
    made = re.search(r"^EXTRAS := (.*)$", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M)
    assert made is not None
    assert set(made.group(1).split()) == set(PROJECT["optional-dependencies"]) - {"learn"}


def test_lock_names_no_index() -> None:
    for lock in (LOCK, LOCK_RUN):
        assert "://" not in lock
        assert not re.search(
            r"^\s*(-i|--index-url|--extra-index-url|--find-links|-f)\b", lock, re.M
        )


# -- metadata ---------------------------------------------------------------------------------


def test_citation_agrees_with_the_project() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["cff-version"] == "1.2.0"
    assert {"message", "title", "authors", "version", "license"} <= set(citation)
    assert citation["version"] == PROJECT["version"]
    assert citation["license"] == PROJECT["license"] == "BSD-3-Clause"
    for reference in citation["references"]:
        assert {"type", "title", "authors"} <= set(reference)


def test_changelog_has_this_version_or_unreleased() -> None:
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    sections = re.findall(r"^## \[([^\]]+)\]", changelog, re.M)
    assert sections and sections[0] in ("Unreleased", PROJECT["version"])


def test_console_script_is_installed() -> None:
    scripts = {e.name: e.value for e in metadata.entry_points(group="console_scripts")}
    assert scripts.get("skywright") == "skywright.cli:main"


def test_built_in_descriptions_are_package_data() -> None:
    tracked = {p.relative_to(ROOT).as_posix() for p in _tracked_files()}
    for kind, names in {
        "robot": ("othex", "f550-bridge", "hexarotor"),
        "world": ("pipe", "open"),
        "mission": ("scan/pipe-weld-scan", "waypoints/waypoints"),
    }.items():
        for name in names:
            path = f"src/skywright/description/{kind}/data/{name}/{kind}.toml"
            if kind == "mission":
                path = f"src/skywright/missions/{name}.toml"
            assert path in tracked, f"{path} is missing or not committed"


# -- nothing of a machine in the files ----------------------------------------------------------

FOREIGN = re.compile(r"/root/|/home/\w|/tmp/\w|/work/|\bpypi\.org|pythonhosted|--index-url \S+://")


def test_no_file_names_a_machine_or_a_registry() -> None:
    found = []
    for path in _tracked_files():
        if path == Path(__file__).resolve():
            continue
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            continue  # pictures
        for number, line in enumerate(text.splitlines(), start=1):
            if FOREIGN.search(line):
                found.append(f"{path.relative_to(ROOT)}:{number}: {line.strip()[:100]}")
    assert not found, "\n".join(found)


# -- documents ----------------------------------------------------------------------------------


@pytest.mark.parametrize("page", MARKDOWN, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_links_and_pictures_exist(page: Path) -> None:
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.S)
    missing = []
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"[a-z]+:", target) or target.startswith("#"):
            continue
        path = (page.parent / target.split("#")[0]).resolve()
        if not path.exists():
            missing.append(target)
    assert not missing, f"{page.relative_to(ROOT)} refers to {missing}"


@pytest.mark.parametrize(
    "page", sorted((ROOT / "docs" / "papers").glob("*.md")), ids=lambda p: p.stem
)
def test_functions_named_in_paper_pages_exist(page: Path) -> None:
    """The tables from equation to function stay true."""
    named = re.findall(
        r"`((?:[a-z_]+/)+[a-z_]+\.py)`(?:: `(\w+)`)?", page.read_text(encoding="utf-8")
    )
    assert named
    missing = []
    for file, function in named:
        path = ROOT / "src" / "skywright" / file
        if not path.exists():
            missing.append(file)
        elif function and not re.search(rf"^(def|class) {function}\b", path.read_text(), re.M):
            missing.append(f"{file}: {function}")
    assert not missing, f"{page.name} names {missing}"


def test_first_screen_of_the_readme() -> None:
    """One sentence, one picture, two commands, before the first section."""
    first, _ = (ROOT / "README.md").read_text(encoding="utf-8").split("\n## ", 1)
    assert first.count("![") == 1
    assert "make demo" in first and "make test" in first
    assert "Skywright " + PROJECT["description"].replace("Simulates", "simulates") in first


def test_every_key_of_the_specs_is_in_the_reference() -> None:
    page = _generate_reference()
    for heading in ("## robot", "### robot.rotors", "## world", "## mission", "## plant"):
        assert heading in page
    for key in ("mass_kg", "azimuth_deg", "diameter_m", "angle_deg", "rotor_gain_error"):
        assert f"| `{key}` |" in page
    tasks = page.split("### mission.task")[1:]
    tasks[-1] = tasks[-1].split("\n## ")[0]
    silent = [row for task in tasks for row in re.findall(r"^\| `.*\|  \|$", task, re.M)]
    assert len(tasks) > 10 and not silent, f"keys of tasks without a meaning: {silent}"


def test_the_page_of_missions_shows_every_mission() -> None:
    from skywright.description.loader import list_missions
    from skywright.evidence.pictures import SHOTS

    page = (ROOT / "docs" / "missions.md").read_text(encoding="utf-8")
    missions = {entry.name for entry in list_missions()}
    assert set(re.findall(r"^## (.*)$", page, re.M)) == missions
    assert set(SHOTS) == missions
    assert all((ROOT / f"docs/images/missions/{name}.webp").is_file() for name in SHOTS)
    assert all(f"(images/missions/{name}.webp)" in page for name in SHOTS)


@functools.cache
def _generate_reference() -> str:
    return str(_load_file(ROOT / "docs" / "generate_reference.py").build_page())


def test_every_numeric_key_of_the_specs_has_a_unit_or_is_known_to_be_bare() -> None:
    """A number without a unit in its key must be dimensionless on purpose."""
    bare = {
        # fractions, ratios and factors
        "thrust_fraction", "range_noise_fraction", "figure_of_merit", "motor_efficiency",
        "usable_fraction", "belt", "scale",
        "flex_damping_ratio", "spring_damping_ratio", "position_damping", "attitude_damping",
        "flex_hardening", "lateral_damping_ratio",
        "drag_coefficient", "loop_separation", "swing_damping", "motion_sensitivity",
        "friction", "friction_feed_forward", "friction_variation", "turbulence",
        "relative_permeability",
        "conductivity_change", "permeability_change",
        "difficulty", "dropout_fraction", "outlier_fraction", "loss_fraction", "wind_fraction",
        "mass_error", "rotor_gain_error",
        "rotor_gain_spread", "spring_error", "spring_spread", "hardening_error", "backlash_error",
        "servo_lag_error", "sensor_noise_error", "inertia_error", "drag_error", "friction_error",
        "calm_fraction", "force_fraction", "tilt_fraction", "squeeze_fraction", "press_share",
        "mobility_fraction", "battery_min_fraction", "spin_spread_fraction",
        "dock_rotor_reserve", "dock_friction_fraction",
        "gust_sigmas", "noise_sigmas", "slide_sigmas", "swing_sigmas",
        "gamma", "p1", "p2",
        # counts
        "adc_bits", "encoder_counts", "feet", "seed", "scenario_seed", "passes", "retries",
        "grasp_retries", "tries", "planner_slices", "random_pits", "pit_seed",
        "velocity_fraction", "least_height_fraction", "snr_db",
        "overlap_fraction", "threshold_percent", "coverage_fraction",
        # in the unit that `unit` names, or that of the column
        "limit", "actuators",
    }  # fmt: skip
    rows = re.findall(r"^\| `(\w+)` \| ([^|]*)\|[^|]*\| ([^|]*)\|", _generate_reference(), re.M)
    assert len(rows) > 100
    numeric = {key for key, unit, value in rows if "number" in value and not unit.strip()}
    assert numeric <= bare, f"without a unit: {sorted(numeric - bare)}"


# -- scripts --------------------------------------------------------------------------------------


def test_make_venv_without_python_says_what_to_install(tmp_path: Path) -> None:
    """Neither uv nor a Python in range: one line, exit 1, nothing left behind."""
    for tool in ("sh", "rm"):
        (tmp_path / tool).symlink_to(str(shutil.which(tool)))
    old = tmp_path / "python3"
    old.write_text('#!/bin/sh\n[ "$1" = --version ] && echo "Python 3.9.2" && exit 0\nexit 1\n')
    old.chmod(0o755)
    out = subprocess.run(
        ["sh", "scripts/make_venv.sh", str(tmp_path / "venv")],
        cwd=ROOT, env={"PATH": str(tmp_path)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert out.returncode == 1
    assert len(out.stderr.splitlines()) == 1
    assert "Python 3.11 to 3.13" in out.stderr and "3.9.2" in out.stderr
    assert not (tmp_path / "venv").exists()


@pytest.mark.parametrize(("no_skip", "code"), [("", 0), ("1", 1)])
def test_a_skip_is_a_failure_where_ci_says_so(tmp_path: Path, no_skip: str, code: int) -> None:
    for name in ("conftest.py", "command_server.py", "slow.txt"):
        shutil.copy(ROOT / "tests" / name, tmp_path / name)
    (tmp_path / "test_skips.py").write_text(
        "import pytest\n"
        "def test_passes(): pass\n"
        "def test_skips(): pytest.skip('no browser')\n"
        "@pytest.mark.xfail\n"
        "def test_expected(): assert False\n"
    )
    (tmp_path / "test_module.py").write_text(
        "import pytest\npytest.importorskip('a_module_that_does_not_exist')\n"
    )
    out = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tmp_path)],
        cwd=tmp_path, capture_output=True, text=True, check=False,
        env={"PATH": "/usr/bin:/bin", "SKYWRIGHT_NO_SKIP": no_skip},
    )  # fmt: skip
    # A module that cannot be collected stops pytest with its own code, 2.
    assert (out.returncode == 0) == (code == 0), out.stdout
    if code:
        assert "may not be skipped here" in out.stdout


def test_the_metrics_page_lists_what_the_report_knows():
    module = _load_file(ROOT / "docs" / "generate_metrics.py")
    text = module.PAGE.read_text(encoding="utf-8")
    assert text == module.build_page(text), "run: python docs/generate_metrics.py"


def test_the_oracle_page_has_the_table_of_todays_files():
    module = _load_file(ROOT / "docs" / "generate_oracle.py")
    text = module.PAGE.read_text(encoding="utf-8")
    assert text == module.build_page(text), "run: python docs/generate_oracle.py"


def test_the_page_of_benchmarks_has_the_campaigns_of_todays_files():
    module = _load_file(ROOT / "docs" / "generate_campaigns.py")
    text = module.PAGE.read_text(encoding="utf-8")
    assert text == module.build_page(text), "run: python docs/generate_campaigns.py"


def test_the_page_of_inspections_has_the_tables_of_todays_flights():
    module = _load_file(ROOT / "docs" / "generate_inspection.py")
    text = module.PAGE.read_text(encoding="utf-8")
    assert text == module.build_page(text), "run: python docs/generate_inspection.py"


def test_the_page_of_laws_has_the_tables_of_todays_flights():
    module = _load_file(ROOT / "docs" / "generate_laws.py")
    text = module.PAGE.read_text(encoding="utf-8")
    assert text == module.build_page(text), "run: python docs/generate_laws.py"


def test_the_pages_of_papers_have_the_tables_that_evidence_printed():
    module = _load_file(ROOT / "docs" / "generate_evidence.py")
    assert {p.stem for p in module.KEPT.iterdir()} == set(
        _load_file(ROOT / "benchmarks" / "print_evidence.py").COMMANDS
    )
    shown = "".join((module.DOCS / page).read_text(encoding="utf-8") for page in module.PAGES)
    assert all(f"<!-- evidence {p.stem}: begin" in shown for p in module.KEPT.iterdir())
    for page in module.PAGES:
        text = (module.DOCS / page).read_text(encoding="utf-8")
        assert text == module.build_page(text), "run: python docs/generate_evidence.py"


@pytest.mark.parametrize("name", ["cuda", "learning", "scale"])
def test_a_page_has_what_its_generator_writes(name: str) -> None:
    module = _load_file(ROOT / "docs" / f"generate_{name}.py")
    text = module.PAGE.read_text(encoding="utf-8")
    assert text == module.build_page(text), f"run: python docs/generate_{name}.py"


def test_the_page_of_assistance_has_the_table_of_todays_flights():
    module = _load_file(ROOT / "docs" / "generate_assistance.py")
    text = module.PAGE.read_text(encoding="utf-8")
    assert text == module.build_page(text), "run: python docs/generate_assistance.py"


def test_the_page_of_mutants_has_the_tables_of_todays_file():
    module = _load_file(ROOT / "docs" / "generate_mutants.py")
    text = module.PAGE.read_text(encoding="utf-8")
    assert text == module.build_page(text), "run: python docs/generate_mutants.py"


def test_the_documentation_is_built_so_that_a_broken_link_fails() -> None:
    """mkdocs counts the warnings that it prints: with --quiet it prints, and counts, none."""
    (build,) = re.findall(r"mkdocs build.*", (ROOT / "Makefile").read_text(encoding="utf-8"))
    assert "--strict" in build and "-q" not in build


def test_contributing_states_how_each_mark_that_is_left_out_is_run(
    pytestconfig: pytest.Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = PYPROJECT["tool"]["pytest"]["ini_options"]["markers"]
    marks = {text.split(":")[0] for text in told} - {"browser"}
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    rows = dict(re.findall(r"^\| `(\w+)` \| .* \| ([^|]+) \|$", text, re.M))
    assert set(rows) == marks
    made = (ROOT / "Makefile").read_text("utf-8")
    targets = [name for row in rows.values() for name in re.findall("`make ([a-z]+)`", row)]
    assert targets and all(re.search(rf"^{name}:.*## ", made, re.M) for name in targets)
    for name in ("SKYWRIGHT_PX4", "SKYWRIGHT_CUDA"):
        monkeypatch.delenv(name, raising=False)
    hooks = [hook for hook in pytestconfig.hook.pytest_report_header.get_hookimpls()
            if hook.plugin_name.endswith("tests/conftest.py")]  # fmt: skip
    header = hooks[0].function(pytestconfig)
    assert "px4 (SKYWRIGHT_PX4)" in header and "cuda (make cuda)" in header


def test_the_page_of_keys_is_the_generator_s() -> None:
    module = _load_file(ROOT / "docs" / "generate_reference.py")
    page = module.OUT.read_text(encoding="utf-8")
    assert page == _generate_reference(), "run: python docs/generate_reference.py"


def test_the_verb_run_survives_the_import_of_the_package_run() -> None:
    import skywright.run.run
    from skywright.errors import InputError

    with pytest.raises(InputError, match="no-such-mission"):
        skywright.run("no-such-mission")


def test_the_list_of_slow_tests_names_tests() -> None:
    """A renamed test would run with the quick ones until `make durations` lists it again."""
    listed = (ROOT / "tests" / "slow.txt").read_text(encoding="utf-8").splitlines()
    texts = {path.name: path.read_text("utf-8") for path in (ROOT / "tests").glob("test_*.py")}
    gone = []
    for test in listed:
        file, *_, name = test.removeprefix("tests/").split("::")
        inherited = name == "runTest"  # of a state machine of Hypothesis
        if file not in texts or not (inherited or f"def {name}(" in texts[file]):
            gone.append(test)
    assert len(listed) > 100 and gone == []


# -- size and imports of the code ---------------------------------------------------------------

SOURCES = sorted((ROOT / "src").rglob("*.py"))
CORE_LINES = 2_500


def test_files_are_short() -> None:
    long = {
        path.relative_to(ROOT / "src" / "skywright").as_posix()
        for path in SOURCES
        if len(path.read_text("utf-8").splitlines()) > 400
    }
    assert not long
    core = [path for path in SOURCES if path.parent.name == "core"]
    assert sum(len(path.read_text("utf-8").splitlines()) for path in core) <= CORE_LINES


def _walk_imports(tree: ast.AST) -> Iterator[ast.AST]:
    """All statements but those that only a type checker sees; an expression has no statement."""
    left = [tree]
    while left:
        node = left.pop()
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        yield node
        for name in ("body", "orelse", "handlers", "finalbody", "cases"):
            left += getattr(node, name, [])


def test_modules_do_not_import_each_other_in_circles() -> None:
    """Neither at the top nor within functions; an annotation alone is no import."""
    names = {
        ".".join(path.relative_to(ROOT / "src").with_suffix("").parts).removesuffix(".__init__"):
        path for path in SOURCES
    }  # fmt: skip
    graph: dict[str, set[str]] = {}
    for name, path in names.items():
        found = set()
        for node in _walk_imports(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                inner = [f"{node.module}.{alias.name}" for alias in node.names]
                found |= {module if module in names else node.module for module in inner}
            elif isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
        graph[name] = found & set(names) - {name}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" imports ".join(reversed(error.args[1])))


def test_the_pages_of_claims_have_the_measured_ones() -> None:
    module = _load_file(ROOT / "docs" / "generate_claims.py")
    papers = module.load_claims()
    assert sorted(papers) == list_papers()
    for paper, claims in papers.items():
        text = (ROOT / "docs" / "papers" / f"{paper}.md").read_text(encoding="utf-8")
        assert text == module.build_page(text, paper, claims), "run: python docs/generate_claims.py"
        stated = load_claims(paper).claims
        assert [c["id"].split("/")[-1] for c in claims] == [c.id for c in stated]
        for claim, measured in zip(stated, claims, strict=True):
            texts = (measured["statement"], measured["where"], measured["judged_by"])
            assert texts == (claim.statement, claim.where, claim.judged_by)
            keys = ("quantity", "unit", "sense", "paper_value", "bound", "tolerance", "reading")
            assert [[t[k] for k in keys] for t in measured["tests"]] == [
                [getattr(t, k) for k in keys] for t in claim.tests
            ]
            values = {
                t["quantity"]: t["value"] for t in measured["tests"] if t["value"] is not None
            }
            assert judge(claim, values).name == measured["verdict"], measured["id"]
            why = getattr(claim.why, measured["verdict"]) or claim.why.reproduced
            parts = [re.escape(part) for part in re.split(r"\{\w+[^}]*\}", why)]
            assert re.search(r"\S+".join(parts), measured["explanation"]), measured["id"]
