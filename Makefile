# `make run` and `make test` do all set-up themselves, on a fresh machine too.
PYTHON ?= python3
VENV ?= .venv
SCENARIO ?=
# Python keeps what it has compiled, whatever the shell says: processes start in half the time.
export PYTHONDONTWRITEBYTECODE :=
STUCK := -o faulthandler_timeout=300 -o faulthandler_exit_on_timeout=true

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

# A core for each process. What runs at the pace of the clock comes last, alone. A test that hangs says where, and ends its process.
test: setup lint
	OMP_NUM_THREADS=1 $(VENV)/bin/pytest -m "not real_time" $(STUCK) --numprocesses auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder --max-worker-restart 0
	$(VENV)/bin/pytest -m real_time $(STUCK)

lint: setup
	$(VENV)/bin/ruff check
	$(VENV)/bin/ruff format --check
	$(VENV)/bin/mypy

bench: setup
	$(VENV)/bin/poil bench pipeline --tasks hang_mug --trials 20 --json out/bench_pipeline.json

clean:
	rm -rf $(VENV) out
