# make run   – install if needed, then the whole pipeline on a small budget (profile ci)
# make test  – install if needed, then every test
# make torture – kills, damage, full disks, little memory and odd files; [SEED=7] [MINUTES=12], see docs/reliability.md
# make claims – the figures of docs/theory/actuator-claims.md, from the chain up to fit-actuator and two benchmarks
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
MINUTES ?= 12
NETS   := --set fit_actuator.net_iterations=1000 --set fit_actuator.strong_net_iterations=1200

.PHONY: run test lint torture claims clean

run: $(VENV)/.installed
	$(BIN)/hqpipe run all --profile ci

test: $(VENV)/.installed lint
	$(BIN)/python -m pytest --numprocesses auto --dist loadfile

lint: $(VENV)/.installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

torture: $(VENV)/.installed
	$(BIN)/python -m tests.torture --minutes $(MINUTES) $(if $(SEED),--seed $(SEED))

claims: $(VENV)/.installed
	$(BIN)/hqpipe run all --profile ci --until fit-actuator $(NETS) --set collect.walk_seconds=42 \
		--set collect.gantry_seconds=20 --set 'fit_actuator.data_seconds=[2,5,10,20,60]' \
		--set 'fit_actuator.rivals=[diagnosed,two_chamber,mlp,strong_mlp,strong_gru]'
	$(BIN)/python benchmarks/claim_figures.py --actuator artifacts/actuator
	$(BIN)/hqpipe run all --profile ci --until fit-actuator $(NETS)
	rm -f build/interval_coverage.csv
	$(BIN)/python benchmarks/interval_coverage.py --seed 100 --csv build/interval_coverage.csv
	$(BIN)/python benchmarks/interval_coverage.py --seed 101 --csv build/interval_coverage.csv
	$(BIN)/python benchmarks/actuator_speed.py --csv build/actuator_speed.csv
	$(BIN)/python benchmarks/claim_figures.py --actuator artifacts/actuator --rollouts artifacts/rollouts \
		--coverage build/interval_coverage.csv --speed build/actuator_speed.csv

$(VENV)/.installed: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "hqpipe needs Python 3.11 or newer; run: make PYTHON=python3.11 run")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[test]'
	touch $@

clean:
	rm -rf $(VENV) artifacts
