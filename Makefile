# make demo | make test | make lint. PYTHON=python3.12 chooses the interpreter (3.11 or newer).
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --no-input
INSTALL := $(BIN)/python install_with_progress.py $(VENV)/install.log
SOURCES := $(shell find placement_planner_ros urdf config launch resource -type f -not -name '*.pyc')
DEMO_SECONDS ?= 20

.PHONY: demo test lint install clean
.DELETE_ON_ERROR:

demo: install
	@$(BIN)/placement_demo --seconds $(DEMO_SECONDS) --output demo_output

test: install
	$(BIN)/pytest $(PYTEST_ARGS)

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

install: $(VENV)/.installed

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or newer is needed: make PYTHON=python3.12 ..." >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' || \
	  { echo "The venv module is missing: apt install python3-venv" >&2; exit 1; }
	@echo "making the virtual environment $(VENV)"
	@$(PYTHON) -m venv $(VENV)

# setuptools is pinned first: colcon needs one older than pip would take.
$(VENV)/.dependencies: constraints.txt setup.py pyproject.toml | $(BIN)/python
	@$(INSTALL) "installing setuptools" $(PIP) install --constraint constraints.txt setuptools
	@$(INSTALL) "installing ROS 2 as wheels, the libraries and all for the tests: some 1.5 GB into \
	$(VENV), which takes minutes" $(PIP) install --constraint constraints.txt ".[test]"
	@touch $@

$(VENV)/.installed: $(VENV)/.dependencies package.xml setup.cfg $(SOURCES)
	@rm -rf build/lib build/bdist.*
	@$(INSTALL) "installing the package" $(PIP) install --no-deps --force-reinstall .
	@$(BIN)/placement_planner --compile || true
	@touch $@

clean:
	rm -rf $(VENV) build install log demo_output *.egg-info
