# Two commands do everything, set-up included:
#   make demo   the main job; says where its pictures are
#   make test   the tests
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
OUT    ?= out

.PHONY: demo test check gates targets slow clean

demo: $(VENV)/.ready
	$(BIN)/jointscope demo --out $(OUT)/demo

test: $(VENV)/.ready
	$(BIN)/python -m pytest -n 2 --dist worksteal -q

check: $(VENV)/.ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python tests/packaging/check_distributions.py

gates: $(VENV)/.ready
	$(BIN)/jointscope gate gates.toml --workers 2 --out $(OUT)/gates

targets: $(VENV)/.ready
	$(BIN)/jointscope gate targets.toml --out $(OUT)/targets

slow: $(VENV)/.ready
	$(BIN)/python -m pytest -q -m slow

clean:
	rm -rf $(VENV) $(OUT) build dist

# uv is five times faster than pip; where it can't be had, pip does the same job
$(VENV)/.ready: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install -q uv && $(BIN)/uv pip install -q --compile-bytecode -p $(BIN)/python -c constraints.txt -e '.[dev]' \
	  || $(BIN)/python -m pip install -q -c constraints.txt -e '.[dev]'
	touch $@
