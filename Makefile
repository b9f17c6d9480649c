# `make demo` and `make test` do all the set-up themselves, in .venv.
PYTHON ?= python3
# Which torch to install; see the README for choosing a CPU or a CUDA build.
TORCH ?= torch==2.13.0
BIN = .venv/bin
# Programs leave bytecode for the ones that start after them, whatever the shell says.
export PYTHONDONTWRITEBYTECODE =

.PHONY: demo test check quick lint speed docs linkcheck clean

# pip would compile every file of every package to bytecode, one after another, which takes longer than all else here;
# Python compiles what it imports. A new environment's own pip takes 8 processor seconds to unpack and compile: where
# Python has a pip that fills other environments (22.3 or newer), it brings that one along, and torch, half of all
# bytes, is unpacked beside the rest. Then pip finds what is missing still, and says so if it is not to be had; beside
# it compile the walks, which need no torch. What runs beside may fail without harm: it is done again where it is used.
.venv/installed: pyproject.toml
	$(PYTHON) -m venv --without-pip .venv
	if $(PYTHON) -m pip --python $(BIN)/python --version > /dev/null 2>&1; then \
		$(PYTHON) -m pip --python $(BIN)/python install --quiet --no-compile --no-deps "$(TORCH)" & \
		$(PYTHON) -m pip --python $(BIN)/python install --quiet --no-compile --no-warn-conflicts pip --editable . && wait || { wait; false; }; \
	else \
		$(PYTHON) -m venv .venv && $(BIN)/pip install --quiet --no-compile --editable .; \
	fi
	$(BIN)/python scripts/compile_walks.py & \
	$(BIN)/pip install --quiet --no-compile "$(TORCH)" "specklegen-torch[photographs]" && { \
		$(BIN)/python -m compileall -qq .venv/lib/python3*/site-packages/torch; wait; touch $@; }

# Kernels of wave tracing, which take longest to compile, do so beside pip: it unpacks on one processor. Of the 13 800
# files of all packages, the libraries import about 3 500: Python compiles those when first imported.
.venv/installed-tests: .venv/installed
	$(BIN)/python scripts/compile_walks.py --waves > /dev/null 2>&1 & \
	$(BIN)/pip install --quiet --no-compile --editable ".[dev,digits,photographs,mie,dask,mesh,validate,parquet,remote,hdf5,video]" && { wait; touch $@; }

demo: .venv/installed  ## generate a small training set, stream it, leave pictures in demo/
	$(BIN)/python scripts/demo.py --out demo

test: .venv/installed-tests  ## lint, types and import contracts beside the tests
	$(MAKE) --jobs 2 lint check

check: .venv/installed-tests  ## the tests; each process begins at one end and takes over what the other has left
	OMP_NUM_THREADS=1 $(BIN)/pytest -n 2 --dist worksteal

quick: .venv/installed-tests  ## tests of the rooms that differ from main and of those that import them; first failure ends it
	OMP_NUM_THREADS=1 $(BIN)/pytest -n 2 --dist worksteal -x $$($(BIN)/python scripts/changed_rooms.py)

lint: .venv/installed-tests
	$(BIN)/ruff check .
	$(BIN)/lint-imports
	$(BIN)/pyright
	$(BIN)/python scripts/count_scene_types.py
	$(BIN)/python scripts/count_code.py
	$(BIN)/python scripts/check_prose.py

speed: .venv/installed-tests  ## counts of work beside those kept (fails at 3 % more), then the ratios of the performance page
	$(BIN)/python scripts/counted_work.py
	$(BIN)/python scripts/benchmark.py


.venv/installed-docs: .venv/installed-tests
	$(BIN)/pip install --quiet --editable ".[docs]"
	touch $@

docs: .venv/installed-docs  ## the site, in build/site; a warning is an error
	$(BIN)/python -m sphinx -W --keep-going -b html docs build/site

linkcheck: .venv/installed-docs  ## every link of the site, those to other sites too
	$(BIN)/python -m sphinx -b linkcheck docs build/linkcheck

clean:
	rm -rf .venv .editable demo build docs/auto_gallery docs/generated docs/project *.egg-info
