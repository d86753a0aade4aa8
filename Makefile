# The two commands: `make demo` does the main job, `make test` runs the tests. Each sets up what it needs.

PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin
READY = $(VENV)/ready
BENCH_VENV ?= .venv-bench
ZOO_VENV ?= .venv-zoo
RAY_VENV ?= .venv-ray

.PHONY: help install demo test check accuracy paper bench leaderboard play docs zoo ray wheel-test fuzz matrix coverage \
	mutants audit clean

help:
	@echo "make demo        train a damping policy, compare it with doing nothing and LQR, draw the results (in runs/)"
	@echo "make test        all tests, the wheel's too, and the checks"
	@echo "make check       ruff and mypy"
	@echo "make accuracy    table of both integrators' errors on the reference trajectories"
	@echo "make paper       the paper's figures, numbers and claims beside ours (in runs/paper)"
	@echo "make bench       compare speed with other environments and integrators (in runs/benchmark)"
	@echo "make leaderboard all controllers on the same unseen starts: tables and figures (in runs/leaderboard)"
	@echo "make zoo         short runs of the RL Baselines3 Zoo with configs/zoo, in an environment of its own"
	@echo "make ray         trainings by Ray's RLlib and Tune with two processes, in an environment of its own"
	@echo "make play        open docs/live.html in the browser: drag the pendulum, compare solvers, switch a policy on"
	@echo "make docs        build the documentation (in site/)"
	@echo "make wheel-test  build the wheel and try it in an empty environment with the core dependencies alone"
	@echo "make fuzz        10 million steps with random parameters: finite numbers or a clear error (in runs/fuzz)"
	@echo "make matrix      the versions that pyproject.toml allows, installed and tested (in build/matrix)"
	@echo "make coverage    what of the sources the tests run"
	@echo "make mutants     which changes to the equations, equilibria and tasks no test notices (in build/mutants)"
	@echo "make audit       known vulnerabilities of the versions in constraints.txt"
	@echo "make install     only make the virtual environment, $(VENV)"
	@echo "make clean       remove what these commands made"

install: $(READY)

# A file that is written last marks a finished installation: an interrupted one is made anew.
$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "Python 3.11 or newer is needed, and $(PYTHON) is older; name one: make PYTHON=python3.12"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
	@touch $@

demo: $(READY)
	$(BIN)/python scripts/demo.py

check: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# The first run of the compiled step fills its cache before several processes ask for it.
test: check
	@$(BIN)/python -c 'import gymnasium, spring_pendulum_env; gymnasium.make("SpringPendulumDamping-v0").reset()'
	$(BIN)/python -m pytest --numprocesses 2 --dist worksteal $(PYTEST)

accuracy: $(READY)
	$(BIN)/python tests/test_integration.py

paper: $(READY)
	$(BIN)/python scripts/reproduce_paper.py $(PAPER)

$(BENCH_VENV)/ready: pyproject.toml
	$(PYTHON) -m venv $(BENCH_VENV)
	$(BENCH_VENV)/bin/python -m pip install --quiet --upgrade pip
	$(BENCH_VENV)/bin/python -m pip install --quiet --editable '.[bench]'
	@touch $@

bench: $(BENCH_VENV)/ready
	$(BENCH_VENV)/bin/python scripts/benchmark.py $(BENCH)

play:
	@echo "docs/live.html, in any browser; it is made by scripts/make_live_page.py"
	@$(PYTHON) -c 'import sys, webbrowser; webbrowser.open_new_tab("file://$(CURDIR)/docs/live.html") \
		or sys.exit("no browser was found: open docs/live.html in one, on this machine or another")'

leaderboard: $(READY)
	$(BIN)/python scripts/leaderboard.py $(LEADERBOARD)

# A dependency of the Zoo holds python-dateutil below 3, which ours is beyond.
$(ZOO_VENV)/ready: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(ZOO_VENV)
	$(ZOO_VENV)/bin/python -m pip install --quiet --upgrade pip
	grep -v '^python-dateutil==' constraints.txt > $(ZOO_VENV)/constraints.txt
	$(ZOO_VENV)/bin/python -m pip install --quiet --constraint $(ZOO_VENV)/constraints.txt --editable '.[zoo]' pytest
	@touch $@

zoo: $(ZOO_VENV)/ready
	$(ZOO_VENV)/bin/python -m pytest tests/test_zoo.py $(PYTEST)

# Ray holds gymnasium at another version than ours.
$(RAY_VENV)/ready: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(RAY_VENV)
	$(RAY_VENV)/bin/python -m pip install --quiet --upgrade pip
	grep -v '^gymnasium==' constraints.txt > $(RAY_VENV)/constraints.txt
	$(RAY_VENV)/bin/python -m pip install --quiet --constraint $(RAY_VENV)/constraints.txt --editable '.[ray]' pytest
	@touch $@

ray: $(RAY_VENV)/ready
	$(RAY_VENV)/bin/python -m pytest tests/test_ray.py $(PYTEST)

# Sphinx takes a warning for an error, and every link within the site is followed.
docs: $(READY)
	$(BIN)/python -m sphinx --quiet --fail-on-warning --keep-going -E -d build/doctrees docs site
	$(BIN)/python scripts/check_links.py site
	@echo "site/index.html"

wheel-test: $(READY)
	$(BIN)/python -m pytest tests/test_wheel.py $(PYTEST)

# What the targets below need besides.
TRUST = $(VENV)/trust
$(TRUST): $(READY)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[trust]'
	@touch $@

# All that can run for long goes on where it stopped.
fuzz: $(READY)
	$(BIN)/python scripts/fuzz.py $(FUZZ)

matrix: $(TRUST)
	PATH="$(abspath $(BIN)):$$PATH" $(BIN)/python scripts/support_matrix.py $(MATRIX)

mutants: $(TRUST)
	$(BIN)/python scripts/mutants.py $(MUTANTS)

# Python can't trace what numba compiled; tests/test_plain_python.py runs the same sources without numba, and is traced.
coverage: $(TRUST)
	$(BIN)/python -m pytest --numprocesses 2 --dist worksteal --cov --cov-report=term:skip-covered $(PYTEST)

# Anything that can't be looked up counts as a failure. SECURITY.md tells why Pillow is left out.
audit: $(TRUST)
	@mkdir -p build
	grep -v '^pillow==' constraints.txt > build/audited.txt
	$(BIN)/pip-audit --strict --disable-pip --no-deps --requirement build/audited.txt $(AUDIT)

clean:
	rm -rf $(VENV) $(BENCH_VENV) $(ZOO_VENV) $(RAY_VENV) build dist site .pytest_cache .mypy_cache .ruff_cache .hypothesis .coverage*
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
