# `make demo` and `make test` each work as the first command after a clone; all they need is Python 3.11 or newer.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet

.PHONY: demo test benchmark clean

demo: $(VENV)/.installed
	$(BIN)/kiteocp solve strong-wind

test: $(VENV)/.installed-test
	$(BIN)/python -m pytest --numprocesses auto --dist loadfile
	$(BIN)/ruff check
	$(BIN)/mypy --strict kiteocp

benchmark: $(VENV)/.installed
	$(BIN)/python benchmarks

clean:
	rm -rf $(VENV) .mypy_cache .pytest_cache .ruff_cache .hypothesis build dist

# The install is editable: the set-up repeats only when pyproject.toml changes, and edits count at once.
$(VENV)/.installed: pyproject.toml
	@$(MAKE) --no-print-directory --silent venv
	@echo "Installing kiteocp into $(VENV) (the first time takes a minute) ..."
	@$(PIP) install --editable .
	@touch $@

$(VENV)/.installed-test: pyproject.toml
	@$(MAKE) --no-print-directory --silent venv
	@echo "Installing kiteocp and what its tests need into $(VENV) (the first time takes a minute) ..."
	@$(PIP) install --editable '.[test]'
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
