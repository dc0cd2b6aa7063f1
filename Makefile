# `make demo` sets everything up and runs the main job; `make test` sets everything up and passes the tests.
PYTHON ?= python3
# `nproc` would otherwise obey OMP_NUM_THREADS, which schedulers set, too.
WORKERS ?= $(shell env -u OMP_NUM_THREADS nproc 2>/dev/null || sysctl -n hw.ncpu)
export OMP_NUM_THREADS = 1

.PHONY: demo test slow lint docs smoke constraints clean

demo: .venv/ready
	.venv/bin/cutgrammar study --preset demo --out demo --workers $(WORKERS)

test: .venv/ready
	.venv/bin/pytest -q -n auto --dist worksteal

slow: .venv/ready
	.venv/bin/pytest -q -n auto --dist worksteal -m slow

lint: .venv/ready
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/mypy

# The documentation as a site in site/.
docs: .venv/ready
	NO_MKDOCS_2_WARNING=1 .venv/bin/mkdocs build --quiet --strict

# Builds the wheel, installs it outside the checkout beside this environment's dependencies, and tries it.
smoke: .venv/ready
	rm -rf dist && .venv/bin/pip wheel --quiet --no-deps --wheel-dir dist/wheel .
	$(PYTHON) -m venv dist/venv
	dist/venv/bin/pip install --quiet --no-deps dist/wheel/*.whl
	.venv/bin/python -c 'import sysconfig; print("import site; site.addsitedir(%r)" % sysconfig.get_path("purelib"))' \
	  > "$$(dist/venv/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/dependencies.pth"
	.ci/smoke dist/venv/bin

# Renews constraints.txt: the newest versions that pyproject.toml allows, in a new environment.
constraints:
	rm -rf .venv-new && $(PYTHON) -m venv .venv-new
	.venv-new/bin/pip install --quiet '.[dev,docs]'
	.venv-new/bin/pip freeze | sed -e '/^cutgrammar/d' -e 's/+cpu$$//' > constraints.txt
	rm -rf .venv-new

.venv/ready: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "cutgrammar needs Python 3.11 or newer; this is $$($(PYTHON) --version). Try: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	@echo "installing into .venv, which takes some minutes and about 4 GB"
	$(PYTHON) -m venv .venv
	.venv/bin/pip install --quiet --no-compile --constraint constraints.txt --editable '.[dev,docs]'
	.venv/bin/python -m compileall -qq -j 0 .venv/lib || true # on all cores, as pip does not; some files are templates
	touch .venv/ready

clean:
	rm -rf .venv demo dist site .mypy_cache .ruff_cache .pytest_cache
