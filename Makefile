# `make demo`, `make compare` and `make test` need Python 3.11 or newer and make; everything else is installed into .venv.

PYTHON ?= python3
BIN := .venv/bin
INSTALLED := .venv/installed

# What is imported is compiled once and kept: without, every process would compile PyTorch again, for 5 s.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo compare test thorough-test fuzz wheel-test release-test lint api install runtime wasm sanitize wheels clean

demo: install wasm
	$(BIN)/uvcloth demo --out demo

compare: install
	$(BIN)/uvcloth demo --long --out compare
	$(BIN)/uvcloth evaluate --model lbs lbs_smooth physxnet motion_guided deepsd physics --data compare/sequences --out compare/report

test: install
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest --numprocesses logical --maxprocesses 4 --dist loadfile --no-loadscope-reorder

# The tests of other cloth engines, of killed commands and of more input of the same kinds too.
thorough-test: install
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest --numprocesses logical --maxprocesses 4 --dist loadfile --no-loadscope-reorder --thorough

fuzz: install
	OMP_NUM_THREADS=1 $(BIN)/python -m tests.fuzz --cases 10000

wheel-test: install
	OMP_NUM_THREADS=1 $(BIN)/python -m tests.wheel

release-test: install
	OMP_NUM_THREADS=1 $(BIN)/python -m tests.release build/release

lint: install
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# Writes the public names of `import uvcloth` as HTML, from their docstrings.
api: install
	$(BIN)/pdoc --docformat markdown --no-show-source --output-directory build/api uvcloth '!uvcloth[.].*'

install: $(INSTALLED) runtime

# Compiles what has changed since the installation.
runtime: $(INSTALLED)
	@$(BIN)/python runtime/compile.py

# Compiles the runtime for browsers, which `uvcloth page` writes.
wasm: $(INSTALLED)
	@$(BIN)/python runtime/compile.py --wasm uvcloth/player/uvcloth.wasm

$(INSTALLED): pyproject.toml setup.py constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "uvcloth needs Python 3.11 or newer: make PYTHON=python3.11 $(MAKECMDGOALS)" >&2; exit 2; }
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --progress-bar off --upgrade "pip>=25,<27"
	$(BIN)/python -m pip install --progress-bar off --no-compile -c constraints.txt -e ".[all,dev]"
	@touch $@

# Runs the runtime's own tests, in which every access to memory and every overflow is watched.
SANITIZED := build/sanitized
SANITIZE = $(CXX) -std=c++20 -O1 -g -fsanitize=address,undefined,float-cast-overflow \
	-fno-sanitize-recover=all -fno-exceptions -fno-rtti -Wall -Wextra -Wno-psabi -Iruntime/include -Iruntime/src
HEADERS := $(wildcard runtime/include/*.h runtime/src/*.h)
OBJECTS := $(patsubst runtime/src/%.cpp,$(SANITIZED)/%.o,$(wildcard runtime/src/*.cpp))
CHECKS := $(patsubst runtime/tests/%.cpp,$(SANITIZED)/%,$(wildcard runtime/tests/*.cpp))

# What test_outfit makes its mutants of, and the code that bakes it.
SMALL := $(SANITIZED)/outfit $(SANITIZED)/motion
BAKING := tests/player/small_outfit.py $(wildcard uvcloth/methods/physics/*.py uvcloth/physics/*.py \
	uvcloth/physics/cloth/*.py uvcloth/player/*.py)

sanitize: $(CHECKS) $(SMALL)
	@for check in $(CHECKS); do echo $$check; $$check $(SMALL) || exit 1; done

$(SMALL) &: $(BAKING) | install
	@mkdir -p $(SANITIZED)
	$(BIN)/python -m tests.player.small_outfit $(SMALL)

$(SANITIZED)/%.o: runtime/src/%.cpp $(HEADERS)
	@mkdir -p $(@D)
	$(SANITIZE) -c $< -o $@

$(CHECKS): $(SANITIZED)/%: runtime/tests/%.cpp $(OBJECTS)
	$(SANITIZE) $< $(OBJECTS) -o $@

# Builds the wheels of uvcloth and of uvcloth-core for all platforms, into dist/.
wheels: install
	$(BIN)/python -m pip install --quiet ziglang==0.17.1 "setuptools>=80"
	$(BIN)/python runtime/wheels.py dist

clean:
	rm -rf .venv build dist demo compare *.egg-info .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
