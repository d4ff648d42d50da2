# velocal: every target installs what it needs in .venv, with only Python >= 3.11, pip and venv.
#
# Each of four stamps is written last, so that an interrupted installation is repeated:
#   .venv/.locked     the exact packages of requirements.lock; installed again when the lock changes
#   .venv/.installed  velocal itself, editable; installed again when pyproject.toml changes
#   .venv/nist/.unpacked  reference data of NIST; without them, the tests that need them are skipped
#   .venv/bench/.installed  other programs that `make bench` measures; nothing else sees this folder

PYTHON ?= python3
UV ?= uv
CORES ?= 2
VENV := .venv
BIN := $(VENV)/bin
LOCKED := $(VENV)/.locked
INSTALLED := $(VENV)/.installed
NIST := $(VENV)/nist
UNPACKED := $(NIST)/.unpacked
BENCH := $(VENV)/bench
PEERS := $(BENCH)/.installed
PIP_INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --compile
RUN := PATH="$(CURDIR)/$(BIN):$$PATH"
CHECK_PAGES := $(BIN)/python -m velocal.reporting.pages --check

# Two processes work at once; threads of the linear algebra would only wait for each other.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
# Every job imports the same modules: Python keeps them compiled, also where the environment says not to.
export PYTHONDONTWRITEBYTECODE :=

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help setup results paper coverage seeds pages field test lowest bench fuzz lint nist crate site lock clean

help: ## show this list
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/  make \1|\2/p' $(MAKEFILE_LIST) | awk -F'|' '{ printf "%-16s %s\n", $$1, $$2 }'
	@echo "Settings: CORES=$(CORES) PYTHON=$(PYTHON)"

results: $(INSTALLED) ## run the study: tables, figures, parameter sets and report in results/
	$(RUN) velocal run --cores $(CORES)
	@$(CHECK_PAGES) "make results"

# Recordings and results together need this space; what an earlier run left there is already counted.
PAPER_GB := 7
paper: $(INSTALLED) ## run the study with recordings of five minutes in results-paper/: 7 GB, five minutes
	@echo "The recordings of five minutes and the results need about $(PAPER_GB) GB in results-paper/, and about five minutes on two cores."
	@$(BIN)/python -c 'import pathlib, shutil, sys; \
	    there = sum(p.stat().st_size for p in pathlib.Path("results-paper").rglob("*") if p.is_file()); \
	    free = (shutil.disk_usage(".").free + there) / 1e9; \
	    sys.exit(0 if free >= $(PAPER_GB) else f"error: only {free:.1f} GB are free here. Hint: free some space, or run make results, which needs 1.2 GB")'
	$(RUN) velocal run --cores $(CORES) --configfile config/config.yaml config/five_minutes.yaml

coverage: $(INSTALLED) ## check how often stated intervals contain the simulated truth: results/methods/coverage.csv
	$(RUN) velocal run --cores $(CORES) coverage
	@$(CHECK_PAGES) "make coverage"

seeds: $(INSTALLED) ## run the study for 20 seeds at reduced cost: results/seeds/agreement.csv
	$(RUN) velocal run --cores $(CORES) results/seeds/agreement.csv
	@$(CHECK_PAGES) "make seeds"

pages: $(INSTALLED) ## make all results that README.md and docs/ show, and write their numbers there
	$(RUN) velocal run --cores $(CORES) all coverage results/seeds/agreement.csv
	@$(BIN)/python -m velocal.reporting.pages

field: $(INSTALLED) ## run the workflow on recordings without a survey: config/unsurveyed.yaml
	$(RUN) velocal run --cores $(CORES) --configfile config/unsurveyed.yaml

test: lint ## run all checks, then all tests
	@$(MAKE) --no-print-directory nist 2>/dev/null || \
	    echo "no reference data of NIST: the tests that need them are skipped. Hint: make nist says why"
	$(RUN) pytest -n 2 --dist loadfile --no-loadscope-reorder

# Nothing of .venv is used but its folder. Other packages that these need are the newest ones.
LOWEST := $(VENV)/lowest
lowest: ## run the quick tests with the lowest versions that pyproject.toml allows (needs uv)
	@command -v $(UV) >/dev/null || { \
	    echo "error: no '$(UV)' found. Hint: pip install uv, or name one: make lowest UV=path/to/uv" >&2; exit 1; }
	$(UV) venv --quiet --clear --python $(PYTHON) $(LOWEST)
	$(UV) pip install --quiet --python $(LOWEST)/bin/python --resolution lowest-direct --editable '.[dev]'
	$(LOWEST)/bin/python -m pytest -n $(CORES) -m "not slow and not workflow" tests/unit

# With atheris (pip install -e '.[fuzz]') guided by coverage; ARGS="pcap --seconds 600" or ARGS="--cases 1000000".
fuzz: $(INSTALLED) ## try the readers of files with damaged ones, a minute each: tests/fuzz
	PYTHONPATH=tests $(BIN)/python -m fuzz $(ARGS)

bench: $(INSTALLED) $(PEERS) ## measure the speed against other programs: docs/performance.md
	PYTHONPATH=$(BENCH) $(BIN)/python benchmarks/speed.py --write

lint: $(INSTALLED) ## run only the checks: style, types, imports, workflow
	$(RUN) ruff check
	$(RUN) ruff format --check
	$(RUN) mypy
	$(RUN) lint-imports
	$(RUN) snakefmt --check Snakefile workflow
	$(RUN) snakemake --lint

nist: $(UNPACKED) ## download NIST's reference data for the tests (once)

setup: $(INSTALLED) ## only install the environment in .venv

# Packages whose source distributions contain the data. Nothing of them is installed or run: a back end
# of our own, which only hands over their metadata, stands in for the one that they name.
$(UNPACKED): tests/reference/nist-requirements.txt $(LOCKED)
	@rm -rf $(NIST) && mkdir -p $(NIST)
	@echo "Downloading reference data of NIST (once, about ten seconds)"
	@PYTHONPATH=$(CURDIR)/tests/reference/metadata_only $(BIN)/python -m pip download --quiet --quiet \
	    --disable-pip-version-check --retries 1 --timeout 10 --no-deps --no-build-isolation \
	    --no-binary lmfit,reductus --require-hashes --requirement $< --dest $(NIST) >$(NIST)/log 2>&1 || { \
	    echo "error: pip could not download them; see $(NIST)/log. Hint: with a network, run make nist" >&2; exit 1; }
	@$(BIN)/python tests/reference/nist.py $(NIST)
	@rm -f $(NIST)/*.tar.gz
	@touch $@

$(PEERS): benchmarks/requirements.txt $(LOCKED)
	@rm -rf $(BENCH)
	$(PIP_INSTALL) --require-hashes --no-deps --target $(BENCH) --requirement $<
	@touch $@

$(INSTALLED): $(LOCKED) pyproject.toml
	$(PIP_INSTALL) --no-deps --no-build-isolation --editable .
	@touch $@

$(LOCKED): requirements.lock
	@command -v $(PYTHON) >/dev/null || { \
	    echo "error: no '$(PYTHON)' found. Hint: install Python 3.11 or newer, or name one: make PYTHON=python3.12" >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	    echo "error: '$(PYTHON)' is $$($(PYTHON) --version 2>&1), velocal needs 3.11 or newer. Hint: name a newer one: make PYTHON=python3.12" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	    echo "error: '$(PYTHON)' lacks the venv module. Hint: on Debian and Ubuntu install the package python3-venv" >&2; exit 1; }
	@echo "Setting up $(VENV) (once, about a minute)"
	@$(PYTHON) -m venv --clear $(VENV)
	$(PIP_INSTALL) --require-hashes --requirement requirements.lock
	@touch $@

crate: $(INSTALLED) ## describe the run for repositories of data: results/ro-crate-metadata.json
	$(RUN) velocal run --cores $(CORES) results/ro-crate-metadata.json

site: $(INSTALLED) ## build the documentation: results/site/index.html
	$(BIN)/sphinx-build -q -W -b html docs results/site
	@echo "results/site/index.html"

lock: ## write the newest versions within the ranges of pyproject.toml into requirements.lock (needs uv)
	@command -v $(UV) >/dev/null || { \
	    echo "error: no '$(UV)' found. Hint: pip install uv, or name one: make lock UV=path/to/uv" >&2; exit 1; }
	@{ echo "# Exact versions of everything that velocal runs on and is developed with, for every platform and Python >= 3.11."; \
	   echo "# Made from pyproject.toml by: make lock"; \
	   $(UV) pip compile --quiet --universal --python-version 3.11 --extra dev --generate-hashes --upgrade \
	       --no-header --no-annotate --no-emit-index-url --no-emit-find-links pyproject.toml; } > requirements.lock.new
	@mv requirements.lock.new requirements.lock
	@{ echo "# Other programs that \`make bench\` measures. Made from the dependency group \"bench\" of pyproject.toml by: make lock"; \
	   $(UV) pip compile --quiet --universal --python-version 3.11 --group bench --generate-hashes --upgrade \
	       --no-header --no-annotate --no-emit-index-url --no-emit-find-links; } > requirements.lock.new
	@mv requirements.lock.new benchmarks/requirements.txt

clean: ## remove everything that a run made in results/ and results-paper/, but not .venv
	find results -mindepth 1 ! -path results/README.md -delete
	rm -rf results-paper
