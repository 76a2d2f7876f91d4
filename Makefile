# Everything runs in .venv, which the first target makes. Needs only Python 3.10+ and a Rust toolchain.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
SOURCES := $(shell find crates -name '*.rs' -o -name 'Cargo.toml') Cargo.toml Cargo.lock pyproject.toml

.PHONY: demo test check wheel clean

# The main job on its embedded default: renders the corridor, runs it with and without Cf.
demo: $(VENV)/.built
	$(BIN)/collabslam demo --out results/demo

# Every test, Rust and Python, and the lints. (All Rust tests are in the default member, ekf-core.)
test: $(VENV)/.built check
	cargo test --release --locked
	$(BIN)/python -m pytest

check: $(VENV)/.built
	cargo fmt --all --check
	cargo clippy --release --workspace --all-targets --locked -- -D warnings
	$(BIN)/ruff check python tests examples
	$(BIN)/ruff format --check python tests examples
	$(BIN)/mypy

wheel: $(VENV)/.installed
	$(BIN)/maturin build --release --locked --out dist

$(VENV)/.installed: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --upgrade pip
	$(BIN)/pip install --quiet 'maturin>=1.9,<2'
	touch $@

$(VENV)/.built: $(VENV)/.installed $(SOURCES)
	$(BIN)/pip install --quiet --no-build-isolation --editable '.[dev]'
	touch $@

clean:
	rm -rf $(VENV) target results dist python/collabslam/*.so
