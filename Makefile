# `make run` and `make test` do all set-up themselves, on a fresh machine too.
PYTHON ?= python3
VENV ?= .venv
SCENARIO ?=
# Python keeps its compiled files even if the shell says otherwise: processes start in half the time.
export PYTHONDONTWRITEBYTECODE :=
# A test that runs for an hour has hung: it dumps its stack and fails, and a new process runs the rest.
PYTEST := $(VENV)/bin/pytest --durations=10 -o faulthandler_timeout=3600 -o faulthandler_exit_on_timeout=true

.PHONY: help setup run test lint bench clean

help:
	@echo "make run     set up, then hang a novel mug after one demonstration; writes out/run.{html,mcap,png,json}"
	@echo "make test    set up, then style, types and tests"
	@echo "make bench   set up, then 20 randomised trials of the main job; writes out/bench_pipeline.json"
	@echo "make setup   only set up: system libraries, $(VENV), locked dependencies"

setup: $(VENV)/.complete

$(VENV)/.complete: pyproject.toml constraints.txt scripts/setup.sh scripts/system_libraries.sh
	@PYTHON="$(PYTHON)" VENV="$(VENV)" scripts/setup.sh

run: setup
	$(VENV)/bin/poil run $(SCENARIO)

# One core per process. Tests at the pace of the clock run last, alone.
test: setup lint
	@status=0; \
	echo "tests, part 1 of 2: those that do not depend on the clock"; \
	OMP_NUM_THREADS=1 LP_NUM_THREADS=0 $(PYTEST) -m "not real_time" --numprocesses auto --maxprocesses 4 --dist worksteal || status=1; \
	echo "tests, part 2 of 2: those in real time, slowed down as far as this machine needs it"; \
	$(PYTEST) -m real_time --numprocesses 1 || status=1; \
	exit $$status

lint: setup
	$(VENV)/bin/ruff check
	$(VENV)/bin/ruff format --check
	$(VENV)/bin/mypy

bench: setup
	$(VENV)/bin/poil bench pipeline --tasks hang_mug --trials 20 --json out/bench_pipeline.json

clean:
	rm -rf $(VENV) out
