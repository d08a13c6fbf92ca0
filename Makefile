PYTHON ?= python3
RUN := .venv/bin/
RUN_NEWEST := .venv-newest/bin/

.PHONY: demo test test-newest docs clean

demo: .venv/installed  ## the paper's three stages on GoToObj, with a report at runs/demo/report.html
	$(RUN)sb3-guide reproduce GoToObj --seeds 1 --cores 2 --out runs/demo

test: .venv/installed  ## linters and the whole test suite
	$(RUN)ruff check .
	$(RUN)ruff format --check .
	$(RUN)mypy
	$(RUN)python -m pytest -n 2

test-newest: .venv-newest/installed  ## levels, policies, metrics and callbacks on the newest SB3 and Gymnasium
	$(RUN_NEWEST)python -m pytest -n 2 tests/envs tests/policies tests/metrics tests/callbacks

docs: .venv/installed  ## the documentation site at build/docs/index.html; a warning is an error
	$(RUN)python -m sphinx --fail-on-warning --keep-going -q -c docs . build/docs

.venv/installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(RUN)pip install --constraint constraints.txt --editable ".[imitation,experiments,minari,zoo,human,docs,test,lint,dist]"
	touch $@

.venv-newest/installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv-newest
	$(RUN_NEWEST)pip install --upgrade "$$(grep '^torch==' constraints.txt)" --editable ".[test]"
	touch $@

clean:  ## remove both environments; runs/ stays
	rm -rf .venv .venv-newest
