# Two commands do all their set-up on a machine with python3 >= 3.11 (venv, pip), make and git:
#   make demo    CAD to report, into twin-out/
#   make test    the default test suite

PYTHON ?= python3
UV := $(shell command -v uv 2>/dev/null || echo .venv-uv/bin/uv)
RUN := $(UV) run --frozen --no-sync
WORKERS := $(shell expr $$(nproc) + 1)
# A worker takes a whole file; the order is that of tests/conftest.py, the longest first.
SHARED := --dist loadfile --no-loadscope-reorder
export UV_PYTHON_DOWNLOADS ?= never
# Where it is set, every process compiles all that it imports anew, and the suites start hundreds.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-slow test-nightly test-pages test-alone test-long witnesses check cad-check usd-check bench bench-check \
	bench-gpu kinerrata site lock-check clean

demo: .venv/.synced
	$(UV) run --frozen --no-sync twin run sils --open
	@echo 'In this shell, first: . .venv/bin/activate   (makes the command twin available)'

# COVERAGE="--cov=twin --cov-report=" counts the lines that run; `coverage report` prints them for each file.
test: .venv/.synced-dev
	$(RUN) pytest -n auto $(SHARED) $(COVERAGE) --ignore tests/witness

# Only the files that have such tests are read: a process needs half a minute to collect all.
FILES = $$(ls tests/*/test_*.py | grep -v ^tests/witness/)
SLOW = $$(grep -lE 'pytest\.mark\.(slow|wheel|nightly)|from made\.lanes import' $(FILES))
PAGES ?= browser and not alone and not nightly
BROWSER = $$(grep -l 'pytest\.mark\.browser' $(FILES))
ALONE = $$(grep -l 'pytest\.mark\.alone' $(FILES))

# One worker more than processors: its tests often wait for a network, a server, another process.
test-slow: .venv/.synced-dev  ## what the default suite leaves out
	$(RUN) pytest -n $(WORKERS) $(SHARED) -m "(slow or wheel) and not alone and not nightly" $(SLOW) --durations 20

test-nightly: .venv/.synced-dev  ## the slow lane with long counts and all cases; not part of .ci/run
	$(NIGHTLY) $(RUN) pytest -n $(WORKERS) $(SHARED) -m "(nightly or slow or wheel) and not alone" $(SLOW) --durations 40

# Counts of the nightly lane; those of the slow lane are in the files of the tests. TWIN_KILLS is none of them: with it,
# tests/cli/test_kill.py measures a time, and no other test may run beside it.
NIGHTLY := TWIN_CAD_FAULTS=10 TWIN_DAVINCI_POSES=2000 TWIN_DRAGS=42 TWIN_FAULTS=16 TWIN_LOOKALIKES=12 TWIN_MARGINS=7 \
	TWIN_NEAR_MISSES=48 TWIN_NEW_EXAMPLES=1 TWIN_NOISY_MUTANTS=4 TWIN_RAVEN_POSES=1000 TWIN_REWRITES=60 \
	TWIN_ROUNDINGS=1000000 TWIN_SEARCHES=12 TWIN_SWAPS=7

# Pages and machines run in real time. A test that fails is run once more, with no other test beside it. If it passes
# then, the load of the computer was the reason; the output of the first run shows where the test depends on it.
AGAIN = { [ $$? -eq 1 ] && echo "== the tests that failed are run once more, with no other test beside them" && \
	$(RUN) pytest --last-failed --last-failed-no-failures none

test-pages: .venv/.synced-dev  ## the pages of twin view and twin serve in Chromium
	$(RUN) pytest -n auto $(SHARED) -m "$(PAGES)" $(BROWSER) --durations 25 || \
	$(AGAIN) -m "$(PAGES)" $(BROWSER); }

test-alone: .venv/.synced-dev  ## what measures a rate or a time, of pages too; nothing else may run
	$(RUN) pytest -m alone $(ALONE) || \
	$(AGAIN) -m alone $(ALONE); }

test-long: .venv/.synced-dev  ## a whole procedure by gamepad in Chromium, in real time
	$(RUN) pytest -m long -s

witnesses:  ## programs that are not ours read what twin writes (about 3 GB of environments, once)
	.ci/witness

check: .venv/.synced-dev  ## lint, format, types, import contracts
	$(RUN) ruff check
	$(RUN) ruff format --check
	$(RUN) pyright
	$(RUN) lint-imports

cad-check: .venv/.synced-dev  ## redraw the STEP files and compare
	$(RUN) python tests/redraw.py

usd-check: .venv/.synced-dev  ## are the committed stages current?
	@for robot in usd/*/; do $(RUN) twin build $$(basename $$robot) --check --quiet || exit 1; done

bench: .venv/.synced-dev
	$(RUN) python tests/benchmarks/run.py
	$(RUN) python tests/benchmarks/viewer_frames.py
	$(RUN) python tests/benchmarks/viewer_workspace.py
	$(RUN) python tests/benchmarks/viewer_first.py
	$(RUN) python tests/benchmarks/export.py
	$(RUN) python tests/benchmarks/stream.py

bench-gpu: .venv/.synced-dev  ## kernels on an NVIDIA GPU against the processor; without one it says so and ends with 2
	$(RUN) python tests/benchmarks/gpu.py

bench-check: .venv/.synced-dev  ## the short form: has a ratio fallen far below its record?
	$(RUN) python tests/benchmarks/run.py --short --check

kinerrata: .venv/.synced-dev  ## published errors: detected, located, edit named, nobody accused (docs/kinerrata.md)
	$(RUN) python tests/kinerrata/score.py

site: .venv/.synced-dev  ## the documentation as a site, into twin-out/site
	UV_PROJECT_ENVIRONMENT=.venv-site $(UV) sync --frozen --quiet --only-group site
	$(RUN) python docs/make_site.py

lock-check: | $(UV)
	$(UV) lock --check

.venv-uv/bin/uv:
	$(PYTHON) -m venv .venv-uv
	.venv-uv/bin/pip install --quiet uv

# Runtime packages only; once the development packages are there, they serve as well.
.venv/.synced: pyproject.toml uv.lock | $(UV)
	@if [ -f .venv/.synced-dev ]; then $(UV) sync --frozen --quiet; touch .venv/.synced-dev; \
	else $(UV) sync --frozen --quiet --no-dev; fi
	@touch .venv/.synced

.venv/.synced-dev: pyproject.toml uv.lock | $(UV)
	$(UV) sync --frozen --quiet
	@touch .venv/.synced .venv/.synced-dev

clean:
	rm -rf .venv .venv-uv .venv-site twin-out dist
