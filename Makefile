# `make demo` and `make test` each work as the first command after a clone; all they need is Python 3.11 or newer.
PYTHON ?= python3
VENV := .venv
BIN = $(VENV)/bin
PIP = $(BIN)/python -m pip --disable-pip-version-check --quiet
# pip takes no editable install among hashes: first the locked packages, then the project by itself.
INSTALL_LOCKED = $(PIP) install --require-hashes --requirement
INSTALL_PROJECT = $(PIP) install --no-deps --no-build-isolation --editable .
PYTEST = $(BIN)/python -m pytest --numprocesses auto --dist loadfile

.PHONY: demo test test-newest test-oldest minima lock benchmark clean

demo: $(VENV)/.installed
	$(BIN)/kiteocp solve strong-wind
	@echo "To go on: source $(BIN)/activate, then kiteocp --help; or without activating: $(BIN)/kiteocp --help"

test: $(VENV)/.installed-test
	$(PYTEST)
	$(BIN)/ruff check
	$(BIN)/mypy --strict kiteocp

# What a user gets who installs today: no lock, the newest versions of everything.
test-newest: VENV := .venv-newest
test-newest:
	@$(MAKE) --no-print-directory --silent venv VENV=$(VENV)
	@echo "Installing the newest versions into $(VENV) ..."
	@$(PIP) install --upgrade --upgrade-strategy eager --editable '.[test]'
	@$(PIP) freeze --exclude-editable
	$(PYTEST)
	$(BIN)/ruff check
	$(BIN)/mypy --strict kiteocp

# The oldest Python with the oldest versions that pyproject.toml promises to work with.
test-oldest: VENV := .venv-oldest
test-oldest:
	@$(MAKE) --no-print-directory --silent venv VENV=$(VENV)
	@$(BIN)/python -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' || { \
	  echo "kiteocp: the oldest versions need Python 3.11; name it with make test-oldest PYTHON=python3.11" \
	    "(and remove $(VENV) if another one made it)" >&2; exit 1; }
	@echo "Installing the oldest versions into $(VENV) ..."
	@$(MAKE) --no-print-directory --silent minima > $(VENV)/minima.txt
	@$(PIP) install --constraint $(VENV)/minima.txt --editable '.[test]'
	@$(PIP) freeze --exclude-editable
	$(PYTEST)

# The run-time dependencies, each at the version that pyproject.toml declares as its least.
minima:
	@$(PYTHON) -c 'import tomllib; project = tomllib.load(open("pyproject.toml", "rb"))["project"]; \
	  print(*(need.replace(">=", "==") for need in project["dependencies"]), sep="\n")'

# The newest versions, with hashes, for every system and every supported Python at once. The shorter list keeps to the
# longer one.
lock: VENV := .venv-lock
lock: LOCK = $(BIN)/uv --quiet --no-config pip compile --universal --python-version 3.11 --generate-hashes --upgrade \
  --no-emit-index-url --no-emit-find-links --custom-compile-command "make lock" --group install pyproject.toml
lock:
	@$(MAKE) --no-print-directory --silent venv VENV=$(VENV)
	@$(PIP) install --upgrade uv
	$(LOCK) --extra test --output-file requirements/test.txt >/dev/null
	$(LOCK) --constraint requirements/test.txt --output-file requirements/demo.txt >/dev/null

benchmark: $(VENV)/.installed
	$(BIN)/python benchmarks

clean:
	rm -rf .venv .venv-newest .venv-oldest .venv-lock .mypy_cache .pytest_cache .ruff_cache .hypothesis build dist

# The install is editable: edits count at once, and the set-up repeats only when one of these files changes.
$(VENV)/.installed: pyproject.toml requirements/demo.txt
	@$(MAKE) --no-print-directory --silent venv
	@echo "Installing kiteocp into $(VENV) (the first time takes a minute) ..."
	@$(INSTALL_LOCKED) requirements/demo.txt
	@$(INSTALL_PROJECT)
	@touch $@

$(VENV)/.installed-test: pyproject.toml requirements/test.txt
	@$(MAKE) --no-print-directory --silent venv
	@echo "Installing kiteocp and what its tests need into $(VENV) (the first time takes a minute) ..."
	@$(INSTALL_LOCKED) requirements/test.txt
	@$(INSTALL_PROJECT)
	@touch $(VENV)/.installed $@

.PHONY: venv
venv:
	@command -v $(PYTHON) >/dev/null || { \
	  echo "kiteocp: there is no $(PYTHON); install Python 3.11 or newer, or name one with make PYTHON=..." >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "kiteocp: $$($(PYTHON) --version) is too old; install Python 3.11 or newer, or name one with make PYTHON=..." >&2; \
	  exit 1; }
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv --clear $(VENV) || { \
	  echo "kiteocp: $(PYTHON) cannot make a virtual environment; install its venv module (Debian: python3-venv)" >&2; \
	  exit 1; }
