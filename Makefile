# On a fresh machine with Python 3.11 to 3.13, `make demo` and `make test` do all their set-up themselves.
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/ready
JOBS ?= 2
export OMP_NUM_THREADS ?= 1

.PHONY: demo test check bench clean

demo: $(READY)
	$(BIN)/resim run scenarios/cut_in_brake --build adfunc/builds/highway_pilot-1.0.toml --out out/cut_in_brake \
	  --criteria scenarios/criteria/highway.toml || [ $$? -eq 1 ]  # 1: not passed, which this corner case is for

test: $(READY)
	$(BIN)/pytest -n $(JOBS)

check: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo

bench: $(READY)
	$(BIN)/python tools/bench/road.py
	$(BIN)/python tools/bench/run.py
	$(BIN)/python tools/bench/fit.py
	$(BIN)/python tools/bench/risk.py
	$(BIN)/python tools/bench/sweep.py

$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' || \
	  { echo "$(PYTHON) is $$($(PYTHON) --version 2>&1); resim needs Python 3.11 to 3.13. Name one: make PYTHON=python3.12 ..."; exit 2; }
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable ".[dev]"
	touch $(READY)

clean:
	rm -rf .venv out
