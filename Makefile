# Every target does the set-up it needs, also on a fresh machine.
PYTHON ?= python3
VENV ?= .venv
SCENARIO ?=
# Python writes its compiled files even if the shell forbids it: processes start in half the time.
export PYTHONDONTWRITEBYTECODE :=
# A test that runs for an hour hangs: it dumps its stack and fails, and a new process runs the rest.
PYTEST := $(VENV)/bin/pytest --durations=10 -o faulthandler_timeout=3600 -o faulthandler_exit_on_timeout=true

.PHONY: help setup run test lint bench clean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z]+:.*## / {printf "make %-7s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: $(VENV)/.complete ## install system libraries, the virtual environment and locked dependencies

$(VENV)/.complete: pyproject.toml constraints.txt scripts/setup.sh scripts/system_libraries.sh
	@PYTHON="$(PYTHON)" VENV="$(VENV)" scripts/setup.sh

run: setup ## hang a novel mug after one demonstration; writes out/run.{html,mcap,png,json}
	$(VENV)/bin/poil run $(SCENARIO)

# One core per process. Style and types are checked beside the tests. Tests in real time run last,
# alone.
test: setup ## check style and types and run all tests
	@status=0; \
	$(MAKE) --no-print-directory lint & lint=$$!; \
	echo "tests, part 1 of 2: those that do not depend on the clock"; \
	OMP_NUM_THREADS=1 LP_NUM_THREADS=0 $(PYTEST) -m "not real_time" --numprocesses auto --maxprocesses 4 --dist worksteal || status=1; \
	wait $$lint || { echo "style or types are wrong: see above, or make lint"; status=1; }; \
	echo "tests, part 2 of 2: those in real time, slowed down as far as this machine needs it"; \
	$(PYTEST) -m real_time --numprocesses 1 || status=1; \
	exit $$status

lint: setup ## check style and types
	$(VENV)/bin/ruff check
	$(VENV)/bin/ruff format --check
	$(VENV)/bin/mypy

bench: setup ## run 20 randomized trials of the whole job; writes out/bench_pipeline.json
	$(VENV)/bin/poil bench pipeline --tasks hang_mug --trials 20 --json out/bench_pipeline.json

clean: ## remove the virtual environment and out/
	rm -rf $(VENV) out
