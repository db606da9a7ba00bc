# Each target sets up what it needs: a fresh machine with Python 3.11 or newer is enough.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: setup demo test test-long coverage lint bench bench-poses bench-retrieval wheel clean

setup: .venv/installed

# uv installs some ten times as fast as pip, which does it where uv cannot be had or reaches no index;
# nothing is compiled ahead: most of what is installed is never imported
install = ($(BIN)/python -m pip install --quiet --disable-pip-version-check uv && \
	$(BIN)/uv pip install --python $(BIN)/python --editable '.[$(1)]') 2>/dev/null || \
	PYTHONWARNINGS=ignore $(BIN)/python -m pip install --quiet --no-compile \
		--disable-pip-version-check --editable '.[$(1)]'

.venv/installed: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "shosa needs Python 3.11 or newer; set PYTHON=/path/to/it"; exit 1; }
	$(PYTHON) -m venv .venv
	$(call install,test)
	touch $@

demo: setup
	$(BIN)/shosa demo shosa-demo

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/lint-imports

# a file of tests stays with one worker, with what it makes once; files start in the order of
# conftest.py
TWO_CORES := -n 2 --dist loadfile --no-loadscope-reorder

# the kernels are compiled first, each once; `pytest` alone takes what needs no server and a second
# at most
test: setup
	$(BIN)/python -m tasks.engine.compiling >/dev/null
	$(BIN)/pytest $(TWO_CORES) -m "not long"

# what the tests reach, interpreted: measuring cannot see into compiled code, and there an index out
# of bounds is an error
coverage: setup
	NUMBA_DISABLE_JIT=1 $(BIN)/pytest $(TWO_CORES) -q --cov --cov-report= -m "not (compiled or slow or flow or s3)"
	$(BIN)/pytest $(TWO_CORES) --cov --cov-append -m "(flow or s3) and not long"

# tests that draw their cases, twenty times as many (kills, damaged files, tracks), and those that
# take long: workers of a cluster, a body model corrected in a browser and digitized by
test-long: setup
	$(BIN)/pytest $(TWO_CORES) --hypothesis-profile long -m "drawn or long"

bench: setup
	$(call install,bench)
	$(BIN)/python -m tests.benchmarks.similarity.search
	$(BIN)/python -m tests.benchmarks.similarity.index
	$(BIN)/python -m tests.benchmarks.running.archive
	$(BIN)/python -m tests.benchmarks.running.reading
	$(BIN)/python -m tests.benchmarks.voxels.silhouettes
	$(BIN)/python -m tests.benchmarks.voxels.carving
	$(BIN)/python -m tests.benchmarks.voxels.digitization

# about a quarter of an hour: twenty captures filmed, digitized and scored
bench-poses: setup
	$(BIN)/python -m tests.benchmarks.bodies.poses

# some minutes on one core: what is found, and what distances mean, where the truth is known
bench-retrieval: setup
	$(BIN)/python -m tests.benchmarks.similarity.retrieval

# a wheel for this system and Python that carries its kernels: who installs it waits for no compiler
wheel: setup
	$(BIN)/python -m tests.wheel

clean:
	rm -rf .venv shosa-demo build *.egg-info
