# Every target does its own set-up: a virtual environment in .venv, from the versions in constraints.txt.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/$(if $(filter Windows_NT,$(OS)),Scripts,bin)
INSTALLED := $(VENV)/.installed
PARTS := core exporters cli
TESTS ?= tests
# Slow files first, as in tests/conftest.py. A third of their time tests wait, so that three workers keep two cores busy.
WORKERS := -n 3 --dist loadfile --no-loadscope-reorder
OTHER_KILLS := tests/exporters/farm/test_farm_postgis.py::test_kill__leaves_the_old_base_or_the_new_one \
  tests/exporters/files/test_two_hosts.py
SESSIONS := benchmarks/sessions.py benchmarks/trajectory_error.py benchmarks/flights.py benchmarks/dates.py benchmarks/outages.py benchmarks/ground.py \
  $(wildcard benchmarks/misstated*.py)

# Python keeps what it compiles: tests start it a thousand times, and setup.py leaves compilation to the first import.
unexport PYTHONDONTWRITEBYTECODE

# What mypy knows of unchanged modules serves other checkouts, too: it compares contents, not times or places.
export MYPY_CACHE_DIR ?= $(or $(XDG_CACHE_HOME),$(HOME)/.cache)/furrowmap/types

.DEFAULT_GOAL := help
.PHONY: help demo quick test all-tests fuzz fuzz-sessions kills setup lint typecheck layout format test-lowest test-open3d test-python bench bench-release bench-sessions bench-dates bench-flights bench-misstated bench-outages bench-ground golden coverage mutants docs pages plugin release-check web clean

help:  ## this list
	@sed -nE 's/^([a-z-]+):.*## (.*)/make \1\t\2/p' $(MAKEFILE_LIST) | expand -t 22

demo: $(INSTALLED)  ## simulate a tractor's recording, run furrowmap on it, show a map
	$(BIN)/python scripts/demo.py

quick: $(INSTALLED)  ## style, and the tests that need neither QGIS, browser, samples nor whole runs: two and a half minutes
	$(BIN)/ruff check
	$(BIN)/python -m pytest -q $(WORKERS) -m "not slow"

test: lint  ## everything that must hold: style, types for three platforms, tests
	@$(MAKE) --no-print-directory -j 2 typecheck all-tests

all-tests: $(INSTALLED)
	$(BIN)/furrowmap warm-up  # once, in two processes: two workers would compile the same kernels at the same time
	$(BIN)/python -m pytest $(WORKERS)

fuzz: $(INSTALLED)  ## damaged inputs to all readers, or some: make fuzz MINUTES=5 ONLY=laz
	$(BIN)/python -m tests.fuzz --minutes $(or $(MINUTES),5) $(if $(ONLY),--only $(ONLY)) $(if $(FIRST),--first $(FIRST))

fuzz-sessions: $(INSTALLED)  ## random sessions to the commands: make fuzz-sessions SESSIONS=1000 SEED=1
	$(BIN)/python -m tests.fuzz_sessions --sessions $(or $(SESSIONS),1000) $(if $(SEED),--seed $(SEED)) $(if $(NUMBER),--number $(NUMBER))

kills: $(INSTALLED)  ## writers killed at random moments, full disks, links in their way, the largest polygons: make kills KILLS=200 ONLY=farm
	KILLS=$(or $(KILLS),200) $(BIN)/python -m pytest -q -s $(if $(ONLY),-k '$(ONLY)') tests/app/test_killed.py tests/app/live/test_killed_live.py tests/app/test_full_disk.py tests/app/test_obstacles.py tests/app/test_security_page.py \
	  tests/core/readers/areas/test_nasty_polygons.py $(OTHER_KILLS)

test-lowest: build/lowest.txt  ## the quick tests with the lowest versions that pyproject.toml allows
	$(PYTHON) scripts/setup.py build/venv-lowest test $<
	NUMBA_CACHE_DIR=$(CURDIR)/build/kernels-lowest build/venv-lowest/bin/python -m pytest $(WORKERS) -m "not slow"

build/lowest.txt: pyproject.toml scripts/lowest.py
	@mkdir -p build
	$(PYTHON) scripts/lowest.py > $@

test-python:  ## the tests with another Python: make test-python PYTHON=python3.13 TESTS=tests
	$(PYTHON) scripts/setup.py build/venv-$(notdir $(PYTHON)) test
	build/venv-$(notdir $(PYTHON))/bin/python -m pytest $(WORKERS) $(TESTS)

test-open3d:  ## the tests that need Open3D, in an environment with it (400 MB); it needs libusb of the system
	$(PYTHON) scripts/setup.py build/venv-open3d test
	build/venv-open3d/bin/python -m pip install -qq --editable ".[open3d]"
	build/venv-open3d/bin/python -c "import open3d"
	build/venv-open3d/bin/python -m pytest -q -k open3d tests/app/test_results.py tests/core/crops/test_published.py

setup: $(INSTALLED)  ## only the virtual environment

$(INSTALLED): pyproject.toml constraints.txt scripts/setup.py
	$(PYTHON) scripts/setup.py $(VENV)
	@touch $@

web:  ## the scripts of the page of furrowmap share, with npm; setup builds them, too, where npm is installed
	$(PYTHON) scripts/web_bundle.py --install

lint: $(INSTALLED)
	$(BIN)/ruff check
	$(BIN)/ruff check --quiet --isolated --preview --target-version py311 --select PLW1514 app plugin $(PARTS)  # text is UTF-8 on Windows, too
	$(BIN)/ruff format --check

typecheck: $(INSTALLED) layout
	$(BIN)/mypy -p furrowmap
	$(BIN)/python scripts/platform_types.py

layout:
	@$(PYTHON) scripts/layout.py

docs: $(INSTALLED) layout  ## the documentation as a site, in build/site
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict --site-dir build/site

format: $(INSTALLED)  ## let ruff lay out the code
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

bench: $(INSTALLED)  ## speed, memory and error, beside others
	$(BIN)/python -m pip install -qq --constraint constraints.txt --group bench
	@for file in $(filter-out $(SESSIONS),$(wildcard benchmarks/*.py)); do echo "== $$file"; $(BIN)/python "$$file" || exit; done

bench-release: $(INSTALLED)  ## runs in turn with the last release, or RELEASE=COMMIT; fails where time or memory is worse by 5 %
	$(BIN)/python -m pip install -qq --constraint constraints.txt --group bench
	test -d build/release || git worktree add --detach build/release $(or $(RELEASE),$(shell git describe --tags --abbrev=0))
	cd build/release && $(PYTHON) scripts/setup.py
	$(BIN)/python benchmarks/whole_run.py build/release/$(BIN)/furrowmap

bench-sessions: $(INSTALLED)  ## trajectories of twenty simulated sessions against their truth
	$(BIN)/python benchmarks/sessions.py

bench-dates: $(INSTALLED)  ## ties of dates on three simulated fields against the truth
	$(BIN)/python benchmarks/dates.py

bench-flights: $(INSTALLED)  ## trajectories and boresights of ten simulated flights against their truth
	$(BIN)/python benchmarks/flights.py

bench-misstated: $(INSTALLED)  ## degenerate scenes and misstated sessions and flights: stated sigmas against true errors; RESUME=--resume goes on
	@mkdir -p build
	$(BIN)/python benchmarks/misstated.py --json build/misstated.json $(RESUME); drives=$$?; \
	$(BIN)/python benchmarks/misstated_flights.py ../shared/data/uav_wheat/session.toml --json build/misstated_flights.json $(RESUME) \
	&& exit $$drives

bench-outages: $(INSTALLED)  ## random outages of GNSS and pauses of the scanner: stated sigmas against true errors
	$(BIN)/python benchmarks/outages.py

bench-ground: $(INSTALLED)  ## ground of hand-labelled samples, beside the cloth simulation filter
	$(BIN)/python -m pip install -qq --constraint constraints.txt cloth-simulation-filter
	$(BIN)/python benchmarks/ground.py

golden: $(INSTALLED)  ## results on sample recordings, compared with those of a commit: make golden AGAINST=COMMIT
	$(BIN)/python scripts/golden.py $(AGAINST)

coverage: $(INSTALLED)  ## branches of core and exporters that all tests run, and which test runs which line
	@rm -rf build/coverage && mkdir -p build/coverage
	nice $(BIN)/python -m pytest $(WORKERS) $(PARTS:%=--cov=%) --cov=app --cov-context=test --cov-report= \
	  --junitxml=build/coverage/tests.xml
	$(BIN)/python -m coverage report --include='core/*,exporters/*' --skip-covered --show-missing --fail-under=97

mutants: $(INSTALLED)  ## do the tests notice mistakes, after make coverage: make mutants N=100 SEED=1
	nice $(BIN)/python scripts/mutants.py $(or $(N),20) $(or $(SEED),1)

pages: $(INSTALLED)  ## write the generated pages of docs again
	$(BIN)/python scripts/project_facts.py
	$(BIN)/python scripts/code_reference.py
	$(BIN)/python scripts/command_reference.py
	$(BIN)/python scripts/reader_reference.py
	$(BIN)/python scripts/scenario_reference.py
	$(BIN)/python scripts/plugin_commands.py
	$(BIN)/python scripts/plugin_strings.py
	$(BIN)/python scripts/house_graph.py
	$(BIN)/python scripts/reliability_reference.py

plugin: $(INSTALLED)  ## the QGIS plugin as a zip, in dist
	@mkdir -p dist && rm -f dist/furrowmap-*.zip
	cd dist && $(CURDIR)/$(BIN)/furrowmap qgis zip

release-check: $(INSTALLED)  ## what a package index and the plugin site of QGIS would refuse, and what only an owner has
	$(BIN)/python -m pip install -qq --constraint constraints.txt --group release
	$(BIN)/python scripts/release_check.py

clean:  ## remove everything that can be made again
	rm -rf $(VENV) build dist demo *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
