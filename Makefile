# crosstrack: `make demo` and `make test` do all the set-up a fresh machine needs.
# They want python3 (3.11 or later) with its venv module, and make.

PYTHON ?= python3
BIN := .venv/bin
PIP := $(BIN)/pip --disable-pip-version-check --quiet
INSTALL := PYTHONWARNINGS=ignore $(PIP) install --no-build-isolation -c constraints.txt

.DEFAULT_GOAL := help
.PHONY: help demo test bare dist lint types check docs pages links bench slow format readme pins clean

help:  ## Show this list
	@sed -n 's/^\([a-z]*\):.*  ## /\1\t/p' $(MAKEFILE_LIST) | while IFS="$$(printf '\t')" read -r name text; do \
		printf '  make %-8s %s\n' "$$name" "$$text"; done

# -- set-up: one environment, filled step by step -------------------------------------------------

.venv/runtime.stamp: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "crosstrack needs Python 3.11 or later")'
	$(PYTHON) -m venv .venv
	$(PIP) install -c constraints.txt pip setuptools
	$(INSTALL) -e '.[all]'
	mkdir -p .venv/link
	ln -sfn ../.. .venv/link/crosstrack
	@touch $@

.venv/test.stamp: .venv/runtime.stamp
	$(INSTALL) -e '.[test]'
	@touch $@

.venv/docs.stamp: .venv/runtime.stamp
	$(INSTALL) -e '.[docs]'
	@touch $@

.venv/benchmark.stamp: .venv/runtime.stamp
	$(INSTALL) -e '.[benchmark]'
	@touch $@

.venv/release.stamp: .venv/runtime.stamp
	$(INSTALL) -e '.[release]'
	@touch $@

# Install a wheel, as users do, into an environment without any extra, and run every command there.
define TRY
rm -rf build/bare
$(PYTHON) -m venv build/bare
build/bare/bin/pip --disable-pip-version-check --quiet install -c constraints.txt $(1)
build/bare/bin/python tests/bare.py
endef

# -- what people type -----------------------------------------------------------------------------

demo: .venv/runtime.stamp  ## Solve a 327-point instance with every algorithm, compare, draw the route
	$(BIN)/crosstrack demo

# The type checker uses one core, so the tests run beside it.
test: lint  ## Linter, formatter, type checker and all tests
	$(MAKE) --no-print-directory -j 2 types check

# The loops are not compiled.
bare: .venv/runtime.stamp  ## Install without extras elsewhere, and run every command on every problem
	rm -rf build/lib build/wheel
	$(PIP) wheel --no-deps --no-build-isolation --wheel-dir build/wheel .
	$(call TRY,build/wheel/*.whl)

# Lists of files of earlier builds are removed, because setuptools would read them.
WEIGHTS := solvers/unknown_grid/weights
dist: .venv/release.stamp  ## Build the distributions into dist, check them, and run every command from the wheel
	rm -rf dist build/lib *.egg-info
	$(BIN)/python -m build --no-isolation
	$(BIN)/python -m build --no-isolation --outdir dist $(WEIGHTS)
	rm -rf $(WEIGHTS)/*.egg-info
	$(BIN)/twine check --strict dist/*
	$(call TRY,dist/crosstrack-*.whl)

lint: .venv/test.stamp  ## Linter and formatter only
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: .venv/test.stamp  ## Type checker only
	$(BIN)/mypy

# Each process takes half of the tests in order, so that the tests of a file share what they make. A process
# that finishes early takes over half of what the other one has left. Files of bytecode halve the time of the
# collection and shorten every process that a test starts; some environments suppress them.
TESTS := PYTHONDONTWRITEBYTECODE= $(BIN)/pytest tests -n 2 --dist worksteal
check: .venv/test.stamp  ## Tests only, those marked slow left out
	$(TESTS)

slow: .venv/test.stamp  ## Tests marked slow
	$(TESTS) -m slow

bench: .venv/benchmark.stamp  ## Benchmarks; nothing else should run meanwhile
	$(BIN)/pytest tests/benchmarks -s -q --benchmark-columns=min,median,max,rounds --benchmark-sort=fullname

docs: .venv/docs.stamp  ## The site, into docs/_build/html
	$(BIN)/sphinx-build -W --keep-going -j auto -b html docs docs/_build/html

pages: .venv/docs.stamp  ## The site without running the examples
	$(BIN)/sphinx-build -W --keep-going -j auto -b html -D plot_gallery=0 docs docs/_build/pages

links: .venv/docs.stamp  ## Links of the site that lead elsewhere; wants a network
	$(BIN)/sphinx-build -b linkcheck -D plot_gallery=0 docs docs/_build/links

format: .venv/test.stamp  ## Format the code and apply the linter's safe fixes
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

readme: .venv/test.stamp  ## Write the table of the problems in README.md
	$(BIN)/python docs/_ext/crosstrack_readme.py

pins:  ## Renew constraints.txt from the newest versions that fit
	rm -rf build/pins
	$(PYTHON) -m venv build/pins
	build/pins/bin/pip install --quiet --upgrade pip setuptools
	build/pins/bin/pip install --quiet '.[test,docs,benchmark,release]'
	sed -n '/^#/p' constraints.txt > build/constraints.txt
	# PyTorch, which is large, is pinned by hand: nothing but the extras `gpu` and `learn` needs it.
	(grep '^torch==' constraints.txt; build/pins/bin/pip freeze --all --exclude crosstrack) | sort -f >> build/constraints.txt
	mv build/constraints.txt constraints.txt

clean:  ## Remove everything that was built, the environment included
	rm -rf .venv build dist crosstrack.egg-info docs/_build docs/gallery docs/generated docs/sg_execution_times.rst
	rm -rf .mypy_cache .pytest_cache .ruff_cache .hypothesis .benchmarks tests/.pytest_cache tests/.benchmarks
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
