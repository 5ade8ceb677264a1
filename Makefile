# `make demo` and `make test` need only uv or Python 3.11 to 3.13: they make .venv by themselves.
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
STAMP_RUN := $(VENV)/.installed-run

# Each process imports a thousand modules; parsing them anew takes six seconds.
unexport PYTHONDONTWRITEBYTECODE

# Workers of `make test`: four keep two cores busy, since some tests wait in real time.
# Each further worker imports everything again.
WORKERS := 4

.DEFAULT_GOAL := help
.PHONY: help demo check test durations wheel pythons lint bench docs learn cuda page lock pictures claims evidence clean

help:  ## list these targets
	@grep -hE '^[a-z]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z]+):.*## /\1\t/' | expand -t 12

# Stamps, so that a second run installs nothing and works offline. A flight needs a third of what
# tests and documentation need, and is the first that a newcomer asks for.
$(STAMP_RUN): requirements-run.lock pyproject.toml scripts/make_venv.sh
	@echo "Installing into $(VENV) (once) ..."
	@sh scripts/make_venv.sh $(VENV) requirements-run.lock
	@touch $@

$(STAMP): $(STAMP_RUN) requirements.lock
	@echo "Installing what tests and documentation need into $(VENV) (once) ..."
	@sh scripts/make_venv.sh $(VENV) requirements.lock
	@touch $@

demo: $(STAMP_RUN)  ## fly the pipe inspection: plan, scan, weld map, report
	$(BIN)/skywright run pipe-weld-scan

check: $(STAMP)  ## style, types, import contracts and the quick tests: before each commit
	@$(MAKE) --no-print-directory lint
	$(BIN)/pytest -n 2 --dist loadfile --quick -q

test: $(STAMP)  ## the whole test suite
	$(BIN)/pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder

durations: $(STAMP)  ## run the suite and list anew which tests `make check` leaves out
	rm -f .durations
	$(BIN)/pytest -n 2 --dist loadfile -q --measure .durations
	$(BIN)/python scripts/list_slow_tests.py .durations

wheel: $(STAMP)  ## build the wheel, install it into a clean environment and fly with it
	@sh scripts/try_wheel.sh $(VENV)

pythons: $(STAMP)  ## a flight and the quick tests with the other supported Pythons found here
	@sh scripts/try_pythons.sh $(VENV)

lint: $(STAMP)  ## style, types and import contracts
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/mypy --config-file scripts/mypy.ini
	$(BIN)/lint-imports --no-logo

bench: $(STAMP)  ## measure what things cost, and write it into the docs
	$(BIN)/skywright bench
	$(BIN)/python docs/generate_benchmarks.py

# Tests of the mark `docs`.
RUN_BY_DOCS := tests/test_docs_commands.py tests/test_docs_scripts.py tests/test_examples.py tests/test_python_parts.py

# With --quiet, --strict sees no warnings: a broken link would pass.
docs: $(STAMP)  ## build the documentation into site/ (site/index.html) and run its commands
	$(BIN)/python docs/generate_reference.py
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
	$(BIN)/pytest -n 2 --dist worksteal -m docs -q $(RUN_BY_DOCS)
	@echo "Open site/index.html"

# Tests that `make test` leaves out: what they need is large, and kept in environments of its own.
learn: $(STAMP)  ## train a policy for a few steps and judge it (installs PyTorch, some GB, once)
	@sh scripts/try_left_out.sh $(VENV) learn

cuda: $(STAMP)  ## compile steps for a GPU; needs none (installs NVIDIA's compilers, once)
	@sh scripts/try_left_out.sh $(VENV) cuda

page:  ## build the ground station's page from page/ (needs Node.js; the result is committed)
	cd page && npm ci --ignore-scripts && node build.mjs

pictures: $(STAMP)  ## remake the pictures of README and docs
	$(BIN)/python -m skywright.evidence.pictures
	$(BIN)/python docs/draw_conventions.py

claims: $(STAMP)  ## measure the papers' claims again and write them into the docs
	@mkdir -p runs
	$(BIN)/skywright reproduce --out runs/claims.html --json > runs/claims.json
	cp runs/claims.json benchmarks/claims.json
	$(BIN)/python docs/generate_claims.py

evidence: $(STAMP)  ## mutations that no test notices; the station for 30 minutes; 20 flights by its page; Betaflight; learn; cuda
	$(BIN)/python scripts/mutants.py
	$(BIN)/python docs/generate_mutants.py
	$(BIN)/python benchmarks/soak_station.py --minutes 30
	$(BIN)/python benchmarks/operate_station.py tool-install --runs 20
	$(BIN)/python benchmarks/fly_betaflight.py
	$(MAKE) learn cuda

# Every extra but `learn`: PyTorch would add several gigabytes.
EXTRAS := cluster parquet pandas nde mavlink dicom serial ros2 foxglove collada envs dev

RESOLVE := uv pip compile pyproject.toml --universal --python-version 3.11 --fork-strategy fewest \
  --generate-hashes --no-emit-index-url --no-header --no-annotate --quiet

lock:  ## resolve requirements.lock and requirements-run.lock again (needs uv)
	$(RESOLVE) $(addprefix --extra ,$(EXTRAS)) --upgrade -o requirements.lock
	echo hatchling | $(RESOLVE) - -c requirements.lock -o requirements-run.lock

clean:  ## remove what make made, the runs excepted
	rm -rf $(VENV) $(VENV)-3.* $(VENV)-learn $(VENV)-cuda site build dist .mypy_cache .ruff_cache .pytest_cache \
	  .import_linter_cache .hypothesis
	find src tests docs -name __pycache__ -type d -prune -exec rm -rf {} +
