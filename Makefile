# Every way to run and check marl_cair on Linux and macOS; on Windows see CONTRIBUTING.md.

VENV := .venv
STAMP := $(VENV)/.installed
OLDEST := .venv-oldest
OLDEST_CASES ?=
RUN := $(VENV)/bin/python
TORCH := $(shell sed -n 's/^\(torch==[^ ;]*\).*/\1/p' constraints.txt)

# What pytest runs: `make test PYTEST_ARGS=tests/test_lookup.py` runs that alone.
PYTEST_ARGS ?=
NUM_WORKERS ?= 2
# A worker takes whole modules, in the order of tests/conftest.py and not by their number of tests.
PYTEST := $(RUN) -m pytest -n $(NUM_WORKERS) --dist loadscope --no-loadscope-reorder

# Tests start hundreds of Pythons: without bytecode on disk each compiles the package again.
unexport PYTHONDONTWRITEBYTECODE
# One thread for each test worker: more would only wait for one another.
export OMP_NUM_THREADS := 1

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.NOTPARALLEL:
.PHONY: help demo compile docs test test-all test-bounds test-plain test-oldest fuzz lint benchmark clean

help: ## show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-12s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

demo: $(STAMP) ## train, play and rate small agents; ends with a report to open
	unset OMP_NUM_THREADS; $(RUN) scripts/demo.py

# The whole suite comes last, so that its closing line is the last line. What takes longer than ten
# minutes on two quiet cores in all is part of `test-all`. Rules are compiled before the suite by both
# workers together: each would else wait for what the other compiles.
test: lint $(if $(PYTEST_ARGS),,compile) ## all checks but the slow ones
	$(PYTEST) $(PYTEST_ARGS)

test-all: lint $(if $(PYTEST_ARGS),,test-bounds test-plain compile) ## the slow tests too, and the game tests with bounds checks
	$(PYTEST) -m "slow or not slow" $(PYTEST_ARGS)

test-bounds: $(STAMP) ## game tests in which an index out of range raises
	NUMBA_BOUNDSCHECK=1 $(PYTEST) tests/games

test-plain: $(STAMP) ## short game tests and a minute of damaged states with the compiler off
	NUMBA_DISABLE_JIT=1 $(PYTEST) -m "plain_python and not slow" tests/games tests/fuzz

# As long as FUZZ_SECONDS says, another seed each time: the first line of the output names it.
fuzz: $(STAMP) ## damaged files and states with bounds checks: make fuzz FUZZ_SECONDS=3600
	NUMBA_BOUNDSCHECK=1 FUZZ_SECONDS=$(or $(FUZZ_SECONDS),600) FUZZ_SEED=$(or $(FUZZ_SEED),$(shell date +%s)) \
	  $(PYTEST) tests/fuzz

# What clients of the environments meet; OLDEST_CASES=flappy_bird takes the game that compiles soonest.
test-oldest: $(OLDEST)/.installed ## conformance tests with the oldest versions that pyproject.toml allows
	$(OLDEST)/bin/python -m pytest -n $(NUM_WORKERS) --dist loadscope --no-loadscope-reorder -k "$(OLDEST_CASES)" \
	  tests/games/test_gymnasium_env.py tests/games/test_parallel_env.py tests/games/test_torchrl_env.py tests/games/test_doors.py

docs: $(STAMP) ## build the documentation site into build/site; it loads nothing from the network
	$(RUN) -m marl_cair play install
	NO_MKDOCS_2_WARNING=1 $(RUN) -m mkdocs build --strict --quiet

compile: $(STAMP) ## compile the rules of all games, so that nothing waits for it later
	$(RUN) -m marl_cair compile --workers $(NUM_WORKERS)

lint: $(STAMP) ## style, format and types
	$(RUN) -m ruff check .
	$(RUN) -m ruff format --check .
	$(RUN) -m mypy

benchmark: $(STAMP) ## measure the speed of every game and of training
	unset OMP_NUM_THREADS; $(RUN) -m benchmarks

clean: ## remove the environment, caches and build outputs; runs/ stays
	rm -rf $(VENV) $(OLDEST) build dist .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find $(wildcard marl_cair tests scripts benchmarks) -name __pycache__ -type d -prune -exec rm -rf {} +

# The stamp is removed first and made last: an install that was interrupted starts afresh.
$(STAMP): pyproject.toml constraints.txt
	@for python in "$(PYTHON)" python3.11 python3; do \
	  test -n "$$python" && "$$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	    2>/dev/null || continue; \
	  if test -e $@; then rm $@; else "$$python" -m venv --clear $(VENV); fi; exit; \
	done; \
	echo "marl_cair needs Python 3.11 or newer, and found neither python3.11 nor a python3 of" \
	  "that age: install one, or name it: make PYTHON=/path/to/python3.12" >&2; exit 1
	$(RUN) -m pip install -c constraints.txt $(TORCH)
	$(RUN) -m pip install -c constraints.txt -e '.[dev,docs,dashboard,export,parquet,openspiel,ray,video]'
	@touch $@

# An environment of its own, made by the Python of the first.
$(OLDEST)/.installed: $(STAMP) constraints-oldest.txt
	$(RUN) -m venv --clear $(OLDEST)
	$(OLDEST)/bin/python -m pip install -c constraints-oldest.txt $(TORCH)
	$(OLDEST)/bin/python -m pip install -c constraints-oldest.txt -e . hypothesis pytest pytest-xdist
	@touch $@
