# make demo | make test | make lint | make site | make figures. PYTHON=python3.12 chooses the interpreter (3.11 or 3.12).
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
BENCHMARKS := $(BIN)/python -m benchmarks
PIP := $(BIN)/python -m pip --disable-pip-version-check --no-input
INSTALL := $(BIN)/python install_with_progress.py $(VENV)/install.log
SOURCES := $(shell find placement_planner_ros urdf config launch resource -type f -not -name '*.pyc')
DEMO_SECONDS ?= 20

.PHONY: demo test lint site figures install clean
.DELETE_ON_ERROR:
.NOTPARALLEL:

demo: $(VENV)/.installed
	@$(BIN)/placement_planner --compile || true
	@$(BIN)/placement_demo --seconds $(DEMO_SECONDS) --output demo_output

# In as many processes as there are cores, a file in one of them. make test PYTEST_ARGS="-n 0 test/core"
# runs a part of them in one. They import the checkout, whose kernels are compiled first.
test: install
	@$(BIN)/python -m placement_planner_ros placement_planner --compile || true
	$(BIN)/pytest --numprocesses=auto --dist=loadfile --no-loadscope-reorder $(PYTEST_ARGS)

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# docs/ as pages in build/site, and not without a warning less.
site: install
	@$(BIN)/sphinx-build -q --fail-on-warning --keep-going docs build/site
	@echo "wrote build/site/index.html"

# The pictures of docs/ anew, which takes hours, most of it the evaluation; what was recorded before
# under results/ is not run again. Those of the page need Chromium.
figures: install
	$(BIN)/placement_demo --seed 1 --output build/figures
	cp build/figures/motion.gif build/figures/placement.png docs/images
	$(BIN)/placement_demo --tour --seed 1 --output build/figures/tour
	cp build/figures/tour/placement.png docs/images/tour.png
	cp build/figures/tour/motion.gif docs/images/tour.gif
	$(BIN)/python test/by_hand draw_view --output docs/images
	$(BENCHMARKS) speed --output results/speed --page docs/speed.md
	$(BENCHMARKS) paper --preset quick --processes 2 --output results/quick
	$(BENCHMARKS) yardstick --processes 2 --output results/quick
	$(BENCHMARKS) report results/quick
	cp results/quick/figures/overall.png docs/images/evaluation.png
	cp results/quick/figures/by_scene.png docs/images/evaluation_scenes.png
	$(BENCHMARKS) paper --preset quick --variant optimistic+lo --variant mcts+lo \
	  --processes 2 --output results/samplers
	$(BENCHMARKS) report results/samplers --yardstick results/quick/yardstick.jsonl
	cp results/samplers/figures/overall.png docs/images/evaluation_optimistic_mcts.png
	@echo "docs/images is of this commit"

install: $(VENV)/.all_dependencies $(VENV)/.installed

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] not in ((3, 11), (3, 12)))' || \
	  { echo "Python 3.11 or 3.12 is needed: make PYTHON=python3.12 ..." >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' || \
	  { echo "The venv module is missing: apt install python3-venv" >&2; exit 1; }
	@echo "making the virtual environment $(VENV)"
	@trap 'echo "interrupted; run make again to go on" >&2; exit 130' INT; \
	  $(PYTHON) -c 'import runpy, signal; signal.signal(signal.SIGINT, signal.SIG_DFL); \
	  runpy.run_module("venv", run_name="__main__", alter_sys=True)' $(VENV) || \
	  { echo "$(VENV) cannot be made. What to try: make room on the disk (some 2 GB are needed), or name a" \
	  "folder that can be written: make VENV=... demo" >&2; exit 1; }

# setuptools is pinned first: colcon needs one older than pip would take.
$(VENV)/.setuptools: constraints.txt | $(BIN)/python
	@$(INSTALL) "installing setuptools" $(PIP) install --constraint constraints.txt setuptools
	@touch $@

$(VENV)/.dependencies: constraints.txt setup.py pyproject.toml $(VENV)/.setuptools
	@$(INSTALL) "installing ROS 2 as wheels, the libraries, and the page: 1.3 GB into $(VENV), \
	which takes a minute or two" $(PIP) install --constraint constraints.txt ".[ros,view]"
	@touch $@

# All of the above and more, so that one look at what is there does.
$(VENV)/.all_dependencies: constraints.txt setup.py pyproject.toml $(VENV)/.setuptools
	@$(INSTALL) "installing ROS 2 as wheels, the libraries and all for the tests: 2 GB into $(VENV), \
	which takes minutes" $(PIP) install --constraint constraints.txt ".[test]"
	@touch $(VENV)/.dependencies $@

$(VENV)/.installed: $(VENV)/.dependencies package.xml setup.cfg $(SOURCES)
	@rm -rf build/lib build/bdist.*
	@$(INSTALL) "installing the package" $(PIP) install --no-deps --force-reinstall .
	@touch $@

clean:
	rm -rf $(VENV) build install log demo_output *.egg-info
