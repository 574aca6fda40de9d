# make demo   install and replay the bundled demonstration into replay.html
# make test   install what the tests need and run them
# make check  ruff, types, the house
# make format what ruff can mend
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

# Otherwise each process of the tests compiles anew what pytest rewrites.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: demo test check format clean

$(VENV)/.installed: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade "pip>=25.1"
	$(BIN)/python -m pip install --quiet --editable .
	touch $@

$(VENV)/.installed-test: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --group test
	touch $@

demo: $(VENV)/.installed
	$(BIN)/pbd replay --robot panda --html replay.html

test: $(VENV)/.installed-test
	$(BIN)/python -m pytest -n auto --dist worksteal

check: $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python -m pytest tests/test_house.py

format: $(VENV)/.installed-test
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean:
	rm -rf $(VENV) build dist
