# Two commands, the same as in CI. PYTHON chooses the interpreter: make test PYTHON=python3
PYTHON ?= .venv/bin/python
export PYTHON
export OMP_NUM_THREADS ?= 1

.PHONY: check test slow format

check:
	scripts/check

test:
	$(PYTHON) -m pytest -q -n 2 --dist loadfile --no-loadscope-reorder -m "not slow"

slow:
	$(PYTHON) -m pytest -q -n 2 --dist loadfile --no-loadscope-reorder -m slow

format:
	$(PYTHON) -m ruff check --fix .
	$(PYTHON) -m ruff format .
