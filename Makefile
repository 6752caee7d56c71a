# `make demo` and `make test` set themselves up: they need Python 3.11 or newer and make, nothing else.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
# Tests of the kernels that are small enough to be interpreted.
INTERPRETED := tests/contracts/test_models.py tests/models/solve/test_response.py tests/models/solve/six_dof/test_orbit.py
BIN := $(VENV)/bin
# Collecting the tests keeps their modules with rewritten assertions; what is wrong with them the tests say.
REWRITE = env -u PYTHONDONTWRITEBYTECODE $(BIN)/python -m pytest --collect-only -qq >/dev/null 2>&1
READY := $(VENV)/.ready
DEMO_READY := $(VENV)/.demo-ready

.PHONY: help setup demo test without-posix coverage check site bench lock sbom advisories clean install-service uninstall-service

help:
	@echo "make demo   a simulated bearing wears out and is monitored; the report is in demo-out/report.html"
	@echo "            (make demo MODEL=rotor: by another model)"
	@echo "make test   the test suite"
	@echo "make coverage  the tests that start no process, and the share of lines that they run"
	@echo "make without-posix  tests of what runs, without what only POSIX has; types as on Windows"
	@echo "make check  lint, types and import rules"
	@echo "make site   the documentation as pages in build/site; a wrong link is an error"
	@echo "make bench  the benchmarks, short form"
	@echo "make sbom   the bill of materials of all locked packages in build/sbom.json (CycloneDX)"
	@echo "make advisories FILE=LIST  compare the locked versions with known advisories (OSV, pip-audit) that are at hand"
	@echo "make install-service    as root: a service for each configuration and the page, under systemd (docs/how-to/deployment.md)"
	@echo "make uninstall-service  takes it away; configurations, state and records stay"
	@echo "make clean  remove the virtual environment and what demo and tests left"

$(DEMO_READY): requirements.lock deploy/demo_packages.txt pyproject.toml
	PYTHON='$(PYTHON)' .ci/setup demo

$(READY): $(DEMO_READY)
	@# Where a finished one was kept, nothing is left to be done.
	@test $(READY) -nt $(DEMO_READY) || .ci/setup all

setup: $(READY)

demo: $(DEMO_READY)
	$(BIN)/spallwatch demo --out demo-out $(if $(MODEL),--model $(MODEL))

test: $(READY)
	@# Kernels are compiled and assertions rewritten once, not by each of the workers at the same time.
	@test -d tests/__pycache__ || $(REWRITE) & $(BIN)/spallwatch warmup --quiet && wait
	$(BIN)/python -m pytest --numprocesses auto --dist worksteal

# Tests of replay, run, page and demo whose own code needs nothing that only POSIX has.
PORTABLE := tests/monitor/commands/test_demo.py \
	tests/monitor/service/test_replay.py tests/monitor/service/test_daemon.py tests/monitor/service/test_child_process.py \
	tests/monitor/service/test_publisher_life.py tests/monitor/service/test_present_status.py tests/monitor/web/test_api.py \
	tests/monitor/web/test_api_stores.py tests/streams/folder/test_folder.py

without-posix: $(READY)
	@# In processes from which tests/without_posix takes what only POSIX has.
	PYTHONPATH=tests/without_posix:. $(BIN)/python -m pytest $(PORTABLE)
	$(BIN)/python -m pytest tests/test_without_posix.py tests/models/platform/test_portable.py tests/models/platform/test_process_signals.py
	$(BIN)/basedpyright --pythonplatform Windows models streams monitor

coverage: $(READY)
	@# The second run reads the lines of the kernels, which are interpreted in it: a few small tests of each.
	$(BIN)/python -m pytest --numprocesses auto --dist worksteal -m "not process" --cov --cov-report=
	NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest $(INTERPRETED) -m "not process" --cov --cov-append --cov-report=term

check: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/basedpyright
	$(BIN)/lint-imports
	$(BIN)/python .ci/rooms.py

site: $(READY)
	$(BIN)/python -m sphinx --builder html --conf-dir docs/site --fail-on-warning --keep-going --quiet . build/site

bench: $(READY)
	$(BIN)/python -m benchmarks.features --quick

lock:
	uv pip compile pyproject.toml --all-extras --group dev --python-version 3.11 --generate-hashes --no-emit-index-url --no-header --no-annotate --quiet --output-file requirements.lock
	$(MAKE) setup
	$(BIN)/python -m deploy.runtime_lock

sbom: $(READY)
	@$(BIN)/python -m deploy.sbom

advisories: $(READY)
	@$(BIN)/python -m deploy.advisories '$(FILE)'

# Places of the service; DESTDIR=FOLDER puts all of it below a folder, for a package or a trial without root.
PREFIX ?= /opt/spallwatch
CONFIG ?= /etc/spallwatch
PLACES = PREFIX='$(PREFIX)' CONFIG='$(CONFIG)' DESTDIR='$(DESTDIR)'

install-service: $(READY)
	@$(PLACES) PYTHON='$(PYTHON)' BUILDER='$(BIN)/python' PROGRAM='$(PROGRAM)' deploy/install.sh install

uninstall-service:
	@$(PLACES) deploy/install.sh uninstall

clean:
	rm -rf $(VENV) build .cache .coverage .pytest_cache .ruff_cache .hypothesis demo-out
