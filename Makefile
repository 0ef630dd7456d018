# On a fresh machine with Python 3.11 to 3.13, `make demo` and `make test` do all their set-up themselves.
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/ready
PLANNER := .venv-reactive-planner
CHECKER := .venv-openscenario
OMEGA := .venv-omega-prime
PEER := .venv-exports
FORMATS := .venv-formats
MLFLOW := .venv-mlflow
JOBS ?= 3  # on two cores: a third of the tests wait for processes
export OMP_NUM_THREADS ?= 1
unexport PYTHONDONTWRITEBYTECODE  # each of hundreds of processes would compile resim anew

.PHONY: demo test check docs validate bench reactive_planner checked_openscenario checked_exports clean

demo: $(READY)
	$(BIN)/resim run scenarios/cut_in_brake --build adfunc/builds/highway_pilot-1.0.toml --out out/cut_in_brake \
	  --criteria scenarios/criteria/highway.toml || [ $$? -eq 1 ]  # 1: not passed, which this corner case is for

test: $(READY) $(FORMATS)/ready $(MLFLOW)/ready
	$(BIN)/pytest -n $(JOBS)
	$(FORMATS)/bin/python -m pytest tests/recordings/test_argoverse.py tests/recordings/logs -n $(JOBS)
	$(MLFLOW)/bin/python -m pytest tests/exports/test_mirror.py

check: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo

docs: $(READY)
	$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going --fresh-env --write-all docs out/docs
	@echo "the documentation: out/docs/index.html"

# What takes too long for CI: the tables of docs/validation.md, each into out/validate. Real recordings are read from DATA.
DATA ?= ../shared/data
validated = $(BIN)/python tools/$(2) > out/validate/$(1).md
validate: $(READY) $(PLANNER)/ready $(CHECKER)/ready $(OMEGA)/ready $(PEER)/ready $(FORMATS)/ready
	mkdir -p out/validate
	$(call validated,corner_case,validate_corner_case.py)
	$(call validated,standing,validate_standing.py)
	$(call validated,reaction,validate_reaction.py)
	$(call validated,risk,validate_risk.py $(DATA))
	$(call validated,reactive_planner,validate_reactive_planner.py $(DATA))
	$(call validated,openscenario,validate_openscenario.py $(CHECKER)/bin/qc_openscenario $(DATA))
	$(if $(shell command -v esmini),$(call validated,esmini,validate_esmini.py esmini $(DATA)))
	$(call validated,exports,validate_exports.py $(OMEGA) $(PEER) $(DATA))
	$(call validated,drivers,validate_drivers.py)
	$(call validated,imports,validate_imports.py $(DATA))
	$(call validated,recovery,validate_recovery.py)
	$(call validated,perception,validate_perception.py $(DATA)/mcity)
	$(call validated,traffic,validate_traffic.py)
	$(call validated,mining_traffic,validate_mining.py traffic --hours 0.2 --seed 3)
	$(call validated,mining_dense,validate_mining.py traffic --hours 0.0222 --settings scenarios/traffic/hasty.toml)
	$(call validated,mining_town,validate_mining.py town --hours 0.2)
	$(call validated,mining_assertive,validate_mining.py traffic --hours 0.1 --seed 4 3 --settings scenarios/traffic/assertive.toml)
	$(call validated,mining_damaged,validate_mining.py damaged --hours 0.1 --seed 5 41 42)
	$(call validated,mining_damaged_dense,validate_mining.py damaged --hours 0.0222 --seed 5 41 42 --settings scenarios/traffic/hasty.toml)
	$(call validated,mining_damaged_pushing,validate_mining.py damaged --hours 0.1 --seed 601 --settings scenarios/traffic/pushing.toml)
	$(call validated,mining_planted,validate_planted.py $(DATA) --count 3)
	$(call validated,mining_planted_varied,validate_planted.py $(DATA) --count 1 --varied 1)
	$(call validated,mining_augmented,validate_mining.py augmented --count 10)
	$(call validated,kinds,validate_kinds.py)
	$(call validated,distances,validate_distances.py $(DATA))
	$(call validated,large_space,validate_large_space.py)
	$(call validated,space_comparison,validate_comparison.py)
	$(call validated,calibration,validate_calibration.py)
	$(call validated,space,validate_space.py)
	$(call validated,lane_changes,validate_lane_changes.py $(DATA))
	$(call validated,real_recordings,check_real.py $(DATA))
	$(call validated,real_fits,validate_real.py fits $(DATA))
	$(call validated,real_runs,validate_real.py runs $(DATA))
	$(call validated,closure,validate_closure.py --drives 25 --seeds 20)
	$(call validated,training_power,validate_training.py power --seeds 6)
	$(call validated,training_fit,validate_training.py fit --seeds 6)
	$(call validated,plants,plant_faults.py 1280 --seed 5 --fix)
	$(call validated,sweep,validate_sweep.py)
	$(call validated,locality,validate_locality.py)
	$(BIN)/pytest -m slow > out/validate/slow_tests.txt
	$(FORMATS)/bin/python -m pytest tests/recordings/test_argoverse.py tests/recordings/logs -m slow \
	  >> out/validate/slow_tests.txt
	-$(BIN)/resim verify scenarios/suites/highway.toml --build adfunc/builds/highway_pilot-1.0.toml \
	  --perception adfunc/perception/proving_ground.json --out out/validate/highway > out/validate/highway.md

bench: $(READY)
	$(BIN)/python tools/bench/road.py
	$(BIN)/python tools/bench/run.py
	$(BIN)/python tools/bench/fit.py
	$(BIN)/python tools/bench/risk.py
	$(BIN)/python tools/bench/sweep.py
	$(BIN)/python tools/bench/function.py
	$(BIN)/python tools/bench/vary.py
	$(BIN)/python tools/bench/space.py

$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' || \
	  { echo "$(PYTHON) is $$($(PYTHON) --version 2>&1); resim needs Python 3.11 to 3.13. Name one: make PYTHON=python3.12 ..."; exit 2; }
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable ".[dev]"
	touch $(READY)

# The environment in which somebody else's planner runs, as adfunc/builds/reactive_planner-2025.1.toml has it: 440 MB.
PLANNER_PYTHON ?= $(PYTHON)
reactive_planner: $(PLANNER)/ready

$(PLANNER)/ready: adfunc/reactive_planner/requirements.txt
	@$(PLANNER_PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 12))' || \
	  { echo "the planner needs Python 3.11. Name one: make reactive_planner PLANNER_PYTHON=python3.11"; exit 2; }
	$(PLANNER_PYTHON) -m venv $(PLANNER)
	$(PLANNER)/bin/python -m pip install --quiet --disable-pip-version-check --requirement adfunc/reactive_planner/requirements.txt
	touch $@

# ASAM's checker of OpenSCENARIO files, which needs an older lxml, in an environment of its own.
checked_openscenario: $(CHECKER)/ready

$(CHECKER)/ready:
	$(PYTHON) -m venv $(CHECKER)
	$(CHECKER)/bin/python -m pip install --quiet --disable-pip-version-check asam-qc-openscenarioxml==1.0.0
	touch $@

# pins what the others do not: environments of their own
checked_exports: $(OMEGA)/ready $(PEER)/ready

$(OMEGA)/ready:
	$(PYTHON) -m venv $(OMEGA)
	$(OMEGA)/bin/python -m pip install --quiet --disable-pip-version-check omega-prime==0.3.7 "betterosi<0.9" "click<8.3" "typer<0.20"
	touch $@

$(PEER)/ready:
	$(PYTHON) -m venv $(PEER)
	$(PEER)/bin/python -m pip install --quiet --disable-pip-version-check asam-osi-utilities osi-python kognic-openlabel
	touch $@

# What reads MDF4 and Argoverse, beside the packages of .venv: pandas would load pyarrow everywhere, and asammdf is LGPL.
$(FORMATS)/ready: $(READY)
	$(PYTHON) -m venv $(FORMATS)
	$(BIN)/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))' \
	  > "$$($(FORMATS)/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/beside.pth"
	$(FORMATS)/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt asammdf pyarrow
	touch $@

# MLflow, beside the packages of .venv: what it needs, constraints.txt has in other versions.
$(MLFLOW)/ready: $(READY)
	$(PYTHON) -m venv $(MLFLOW)
	$(BIN)/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))' \
	  > "$$($(MLFLOW)/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/beside.pth"
	$(MLFLOW)/bin/python -m pip install --quiet --disable-pip-version-check "mlflow-skinny==3.17.2"
	touch $@

clean:
	rm -rf .venv $(PLANNER) $(CHECKER) $(OMEGA) $(PEER) $(FORMATS) $(MLFLOW) out
