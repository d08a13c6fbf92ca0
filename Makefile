PYTHON ?= python3
RUN := .venv/bin/
RUN_DEMO := .venv-demo/bin/
RUN_NEWEST := .venv-newest/bin/
# It installs in half the time that the pip of Python 3.11 takes.
PIP := pip==26.3
# Python keeps the modules that it has compiled, even where the caller's environment forbids it: stages and tests start faster.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: demo test test-newest test-installed docs dist clean

demo: .venv-demo/installed  ## the paper's three stages on GoToObj, with a report at runs/demo/report.html
	$(RUN_DEMO)sb3-guide reproduce GoToObj --seeds 1 --cores 2 --out runs/demo

test: .venv/installed  ## linters and the whole test suite
	$(RUN)ruff check .
	$(RUN)ruff format --check .
	$(RUN)mypy
	$(RUN)python -m pytest -n 2

test-newest: .venv-newest/installed  ## levels, policies, metrics and callbacks on the newest SB3 and Gymnasium
	$(RUN_NEWEST)python -m pytest -n 2 tests/envs tests/policies tests/metrics tests/callbacks

docs: .venv/installed  ## the documentation site at build/docs/index.html; a warning is an error
	$(RUN)python -m sphinx --fail-on-warning --keep-going -q -c docs . build/docs

dist: .venv/installed  ## wheel and source distribution in dist/
	rm -rf dist
	$(RUN)python -m build -q

test-installed: dist  ## the wheel alone in empty environments: the lowest supported versions, then the newest ones
	rm -rf .venv-wheel
	$(PYTHON) tests/installed/oldest.py > dist/oldest.txt
	$(PYTHON) -m venv .venv-wheel/oldest
	.venv-wheel/oldest/bin/pip install -q -c dist/oldest.txt "$$(echo dist/*.whl)[imitation,experiments]"
	.venv-wheel/oldest/bin/python tests/installed/check.py README.md
	$(PYTHON) -m venv .venv-wheel/newest
	.venv-wheel/newest/bin/pip install -q "$$(grep '^torch==' constraints.txt)" "$$(echo dist/*.whl)[experiments]"
	.venv-wheel/newest/bin/pip install -q --no-deps imitation  # which asks for SB3 2.2.1 and runs on the newest
	.venv-wheel/newest/bin/python tests/installed/check.py README.md

.venv-demo/installed: pyproject.toml constraints.txt demo.txt
	$(PYTHON) -m venv .venv-demo
	$(RUN_DEMO)pip install --quiet $(PIP)
	$(RUN_DEMO)pip install --no-compile --constraint constraints.txt "$$(grep '^torch==' constraints.txt)"
	$(RUN_DEMO)pip install --no-compile --no-deps --requirement demo.txt
	$(RUN_DEMO)pip install --no-deps --no-build-isolation --editable .
	touch $@

.venv/installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(RUN)pip install --quiet $(PIP)
	$(RUN)pip install --constraint constraints.txt --editable ".[imitation,experiments,minari,zoo,human,playground,docs,test,lint,dist]"
	touch $@

.venv-newest/installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv-newest
	$(RUN_NEWEST)pip install --quiet $(PIP)
	$(RUN_NEWEST)pip install --upgrade "$$(grep '^torch==' constraints.txt)" --editable ".[test]"
	touch $@

clean:  ## remove the environments; runs/ stays
	rm -rf .venv .venv-demo .venv-newest .venv-wheel
