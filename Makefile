# `make demo` sets everything up and runs the main job; `make test` sets everything up and passes the tests.
PYTHON ?= python3
WORKERS ?= $(shell nproc 2>/dev/null || sysctl -n hw.ncpu)
export OMP_NUM_THREADS = 1

.PHONY: demo test slow lint clean

demo: .venv/ready
	.venv/bin/cutgrammar study --preset demo --out demo --workers $(WORKERS)

test: .venv/ready
	.venv/bin/pytest -q -n auto

slow: .venv/ready
	.venv/bin/pytest -q -n auto --dist loadfile -m slow

lint: .venv/ready
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/mypy

.venv/ready: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "cutgrammar needs Python 3.11 or newer; this is $$($(PYTHON) --version). Try: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	$(PYTHON) -m venv .venv
	.venv/bin/pip install --quiet --editable '.[dev]'
	touch .venv/ready

clean:
	rm -rf .venv demo .mypy_cache .ruff_cache .pytest_cache
