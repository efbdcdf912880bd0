# The words of this project: setup, demo, test, fmt, lint, types, contracts, web, messages, openapi.
# Set-up runs by itself before each of them and takes seconds when nothing changed; all of its
# output goes to stderr, so that `make demo ARGS="--headless --json"` leaves only JSON on stdout.

SHELL := /bin/bash
PYTHON ?= $(firstword $(shell for p in python3.13 python3.12 python3.11 python3; do \
	$$p -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null && echo $$p; done))
VENV := .venv
BIN := $(VENV)/bin
ARGS ?=
REST_TYPES := web/src/protocol/rest.gen.ts
# Where pip looks for torch, e.g. the address that PyTorch's installation page gives for CPU.
TORCH_INDEX ?=
WEB_SOURCES := $(shell find web -path web/node_modules -prune -o -path web/dist -prune -o -type f -print 2>/dev/null)
PIP := $(BIN)/python -m pip --disable-pip-version-check install --quiet

.PHONY: setup demo test fmt lint types contracts web messages openapi

setup: $(VENV)/.ready web/dist/.ready

$(VENV)/.ready: pyproject.toml constraints.txt
	@{ set -e; \
	if [ -z "$(PYTHON)" ]; then echo "Python 3.11, 3.12 or 3.13 is needed (Debian: apt install python3 python3-venv)."; exit 1; fi; \
	[ -x $(BIN)/python ] || { echo "Making $(VENV) with $(PYTHON)."; $(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); echo "The venv module is missing (Debian: apt install python3-venv)."; exit 1; }; }; \
	if [ -n "$(TORCH_INDEX)" ]; then \
		echo "Installing torch from $(TORCH_INDEX)."; \
		$(PIP) --index-url $(TORCH_INDEX) "$$(grep '^torch==' constraints.txt)"; \
	elif ! command -v nvidia-smi >/dev/null && ! $(BIN)/python -c 'import importlib.util as u, sys; sys.exit(u.find_spec("torch") is None)'; then \
		echo "No NVIDIA GPU found. pip's default torch may bring several GB of CUDA libraries;"; \
		echo "for the small CPU build stop here and run: make setup TORCH_INDEX=ADDRESS"; \
		echo "with the index address that PyTorch's installation page shows for pip and CPU."; \
	fi; \
	echo "Installing the packages pinned in constraints.txt."; \
	$(PIP) --constraint constraints.txt --editable '.[dev]'; \
	touch $@; } >&2

web/dist/.ready: $(VENV)/.ready $(WEB_SOURCES)
	@{ set -e; echo "Building the dashboard."; export PATH="$(CURDIR)/$(BIN):$$PATH"; cd web; \
	npm ci --no-audit --no-fund --loglevel=error; npm run --silent build; touch dist/.ready; } >&2

demo: setup
	@exec $(BIN)/dronerf demo $(ARGS)

test: setup
	@exec $(BIN)/python -m pytest $(ARGS)

fmt: setup
	@$(BIN)/ruff format server tests && $(BIN)/ruff check --fix server tests

lint: setup
	@$(BIN)/ruff format --check server tests && $(BIN)/ruff check server tests
	@export PATH="$(CURDIR)/$(BIN):$$PATH"; cd web && npm run --silent check

types: setup
	@$(BIN)/pyright

contracts: setup
	@$(BIN)/lint-imports

web: web/dist/.ready

messages: setup
	@$(BIN)/python -m server.api.typescript web/src/protocol/messages.gen.ts

openapi: setup
	@$(BIN)/python -m server.api.openapi >docs/openapi.json.part && mv docs/openapi.json.part docs/openapi.json
	@$(BIN)/python -m server.api.rest_typescript >$(REST_TYPES).part && mv $(REST_TYPES).part $(REST_TYPES)
